"""An arm, its io and emulated boards with their plant on one stepped clock: all of a robot but the processes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from tests import stock
from tests.arm.fake_io import Record
from tests.arm.fake_requests import FakeReports, FakeRequest
from tests.arm.test_kinematic_arm import Order
from tests.io.boards_harness import BoardsHarness
from trocar.procs.arm.arm import ArmLogic
from trocar.procs.arm.context import ArmContext
from trocar.procs.arm.effort_limits import motor_efforts
from trocar.procs.arm.loop import gripper_in, place_in
from trocar.procs.config import load_system
from trocar.procs.document.system import SystemConfig
from trocar.procs.host.objects import RememberedObjects
from trocar.procs.io.setpoint_rings import DesiredFields
from trocar.procs.kinematics.forward import Kinematics
from trocar.procs.node.fault_report import FaultReport
from trocar.procs.tables import codes
from trocar.procs.tables.arm_types import ARM_TYPES, class_of
from trocar.shm.mailbox.client import Reply
from trocar.shm.topics import ARM_STATE, SETPOINT

SETPOINTS = ("mode", "has_velocity", "count", "in_effort", "bias_generation", "pid_generation", "position", "velocity",
             "effort", "feed_forward")


class OnBoards:
    """One arm of a system; `truth` is where its actuators really are."""

    def __init__(self, system: SystemConfig, name: str) -> None:
        self.system = system
        self.document = system.emulated().arm(name)
        self.harness = BoardsHarness(system, self.document.io)
        self.io, self.clock = self.harness.record, self.harness.clock
        self.setpoint, self.state = Record(SETPOINT), Record(ARM_STATE)
        self.source = self.harness.arms[self.document.robot]
        for field in SETPOINTS:
            setattr(self.source, field, self.setpoint[field])
        self.source.desired = DesiredFields(self.setpoint.field)
        place = place_in(self.harness.io, self.document)
        self.place, self.axes = place.row, place.axes
        self.period_s = self.harness.io.period_s
        self.orders: list[Order] = []
        self.replies: list[Reply] = []
        self.count = 0
        self.start_arm()

    def start_arm(self) -> None:
        """A new arm process on the records as they are."""
        io, robot = self.harness.io, self.harness.io.robots[self.place]
        self.reports = FakeReports()
        self.arm: Any = class_of(ARM_TYPES[self.document.type].process, ArmLogic)(self.document, ArmContext(
            lambda name: getattr(self.io, name), self.place, self.axes.start,
            {row.name: i for i, row in enumerate(io.digital_inputs)}, bool(robot.brakes), self, self.state.field,
            self.setpoint.field, self.reports, lambda code: FaultReport(codes.IO_FAULT, f"fault number {code}"),
            gripper=gripper_in(io, self.document), motors=motor_efforts(robot)))

    def send(self, name: str, values: Any, text: str) -> int:
        """The arm asks io."""
        self.count += 1
        self.orders.append(Order(self.count, name, values, text, self.replies))
        return self.count

    def on_behalf(self, origin: object) -> None:
        """The arm's process has a mailbox for that."""

    def poll(self) -> list[Reply]:
        """io answers."""
        replies, self.replies[:] = self.replies[:], []
        return replies

    @property
    def truth(self) -> np.ndarray:
        return self.harness.plant.position[self.harness.world.wiring.robots[self.document.robot]]

    @cached_property
    def chain(self) -> Kinematics:
        """Of the arm without an instrument."""
        return Kinematics(self.document.chain)

    def step(self, *requests: FakeRequest, alive: bool = True) -> None:
        """One cycle of boards, io and arm; not `alive`: the arm's process is away."""
        self.clock.ns += self.harness.period_ns
        self.harness.world.advance(self.clock.ns)
        orders, self.orders[:] = self.orders[:], []
        self.harness.core.cycle(orders)
        self.harness.events += self.harness.core.reports.events
        self.harness.core.reports.events.clear()
        if alive:
            self.arm.step(self.clock.ns, self.clock.ns, 1, requests)
            self.source.stamp_ns = self.clock.ns

    def run(self, seconds: float, each: Callable[[], None] = lambda: None) -> None:
        """Let time pass."""
        for _ in range(round(seconds / self.period_s)):
            self.step()
            each()

    def do(self, name: str, values: Any = (), text: str = "") -> FakeRequest:
        """One cycle with a command in it."""
        request = FakeRequest(name, values, text)
        self.step(request)
        return request

    def until(self, condition: Callable[[], object], seconds: float = 30.0) -> float:
        """Let time pass until the condition holds; returns how long that took in s."""
        start = self.clock.ns
        while not condition():
            assert self.clock.ns - start < seconds * 1e9, (self.arm.state, self.harness.errors(),
                                                           self.reports.events[-3:])
            self.step()
        return (self.clock.ns - start) * 1e-9

    def homed(self) -> dict[str, float]:
        """From nothing to homed; returns the seconds spent in each state on the way."""
        self.run(0.1)
        if self.arm.state == "DISABLED":
            self.do("state_command", (), "enable")
        self.until(lambda: self.arm.state == "ENABLED")
        self.do("state_command", (), "home")
        spent: dict[str, float] = {}
        while self.arm.state != "HOMED":
            state = str(self.arm.state)
            assert state != "FAULT", (self.reports.of("error"), self.harness.errors())
            spent[state] = self.until(lambda before=state: self.arm.state != before)
        return spent

    def away(self, seconds: float) -> None:
        """kill -9, and a new process after a while."""
        for _ in range(round(seconds / self.period_s)):
            self.step(alive=False)
        self.start_arm()


SLOW = ("io.period_s=0.002", "arm.period_s=0.002", "emulation.period_s=0.002")
"""Settings for long ways: a third of the cycles, half the steps of the plant."""


def of_site(file: str, name: str, *sets: str) -> OnBoards:
    """An arm of a real site."""
    loaded = load_system(stock.find(f"dvrk-site/{file}.json"), search=[stock.find("dvrk-share")], boards="emulated",
                         sets=sets)
    assert loaded.system is not None, loaded.errors
    return OnBoards(loaded.system, name)


@dataclass(frozen=True)
class HomedOnBoards:
    """An arm that was homed once, the s that it spent in each state, and the s from the first command on."""

    robot: OnBoards
    spent: dict[str, float]
    seconds: float
    then: RememberedObjects

    @classmethod
    def of_site(cls, file: str, name: str) -> HomedOnBoards:
        """One that is homed now, which takes seconds; tests take it from the fixture `homed_on_boards`."""
        robot = of_site(file, name, *SLOW)
        robot.run(0.1)
        start = robot.clock.ns
        spent = robot.homed()
        return cls(robot, spent, (robot.clock.ns - start) * 1e-9, RememberedObjects({"robot": robot}))

    def again(self) -> OnBoards:
        """The arm as it was when it was homed."""
        self.then.put_back()
        return self.robot
