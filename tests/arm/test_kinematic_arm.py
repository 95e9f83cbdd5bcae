"""A KINEMATIC PSM: the arm and the io that plays its robot, on one stepped clock."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import pytest

from tests.arm.fake_io import Record
from tests.arm.fake_requests import PERSON, FakeReports, FakeRequest
from tests.command_rows import row_named
from trocar.procs.arm.arm import ArmLogic
from trocar.procs.arm.context import ArmContext
from trocar.procs.arm.ecm import EcmLogic
from trocar.procs.arm.psm.psm import PsmLogic
from trocar.procs.config import PROJECT_CONFIGS, load_system
from trocar.procs.document.system import SystemConfig
from trocar.procs.io.assemble import IoContext
from trocar.procs.io.kinematic import kinematic_io
from trocar.procs.io.record import IoRecord as IoRecord
from trocar.procs.io.setpoint_rings import DesiredFields
from trocar.procs.tables.arm_types import ARM_TYPES
from trocar.shm.mailbox.client import Reply
from trocar.shm.mailbox.origins import SenderId
from trocar.shm.topics import ARM_STATE, IO_STATE, SETPOINT

PERIOD_NS = 2_000_000


@cache
def kinematic_system(file: str = "kinematic") -> SystemConfig:
    system = load_system(PROJECT_CONFIGS / f"systems/{file}.yaml").system
    assert system is not None
    return system


class Source:
    """The arm's setpoint record, as io reads it."""

    def __init__(self, record: Record) -> None:
        self.stamp_ns = 0
        for name in ("mode", "has_velocity", "count", "in_effort", "bias_generation", "pid_generation", "position",
                     "velocity", "effort", "feed_forward"):
            setattr(self, name, record[name])
        self.desired = DesiredFields(record.field)

    def newest(self) -> bool:
        return self.stamp_ns != 0


class Order:
    """A command on its way to io, its answers on their way back."""

    def __init__(self, number: int, name: str, values: Any, text: str, replies: list[Reply]) -> None:
        self.id, self.name, self.text, self.values = number, name, text, np.array(values, dtype=float)
        self._replies = replies
        self.origin, self.sender, self.command = PERSON, SenderId(0), row_named(name, "io")

    def accept(self, text: str = "") -> None:
        self._replies.append(Reply(self.id, "accepted", text))

    def refuse(self, reason: str) -> None:
        self._replies.append(Reply(self.id, "refused", reason))

    def done(self, text: str = "") -> None:
        self._replies.append(Reply(self.id, "done", text))

    def fail(self, reason: str) -> None:
        self._replies.append(Reply(self.id, "failed", reason))


class KinematicPair:
    """Both, and a sender between them."""

    def __init__(self, file: str = "kinematic", kind: type[ArmLogic] = PsmLogic, period_ns: int = PERIOD_NS,
                 **changes: Any) -> None:
        """`changes` of the arm's document."""
        self.period_ns = period_ns
        self.system, self.now_ns, self.epoch = kinematic_system(file), 5_000_000_000, 1
        self.document, self.kind = dataclasses.replace(self.system.arms[0], **changes), kind
        axes = ARM_TYPES[self.document.type].actuators
        self.memory = Record(IO_STATE, axes=axes, drives=axes, robots=1, inputs=0, outputs=0)
        self.state, self.setpoint = Record(ARM_STATE), Record(SETPOINT)
        self.source, self.orders, self.replies = Source(self.setpoint), [], []
        self.number = 0
        self.steps: list[float] = []
        self.start_io()
        self.start_arm()

    def start_io(self) -> None:
        self.record = IoRecord(self.memory.field)
        self.core = kinematic_io(IoContext(self.system.io("io"), lambda: self.now_ns, self.record, [self.source]))
        self.orders.clear()

    def start_arm(self) -> None:
        self.reports = FakeReports()
        self.arm: ArmLogic | None = self.kind(self.document, ArmContext(
            self.memory.field, 0, 0, {}, False, self, self.state.field, self.setpoint.field, self.reports, str))

    def send(self, name: str, values: Any, text: str) -> int:
        self.number += 1
        self.orders.append(Order(self.number, name, values, text, self.replies))
        return self.number

    def on_behalf(self, origin: object) -> None:
        """The arm's process has a mailbox for that."""

    def poll(self) -> list[Reply]:
        replies, self.replies[:] = list(self.replies), []
        return replies

    def step(self, *requests: FakeRequest) -> None:
        self.now_ns += self.period_ns
        before = self.record.position.copy()
        orders, self.orders[:] = list(self.orders), []
        self.core.cycle(orders)
        self.steps.append(float(np.abs(self.record.position - before).max()))
        if self.arm is not None:
            self.arm.step(self.now_ns, self.core.stamp_ns, self.epoch, requests)
            self.source.stamp_ns = self.now_ns

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds * 1e9 / self.period_ns)):
            self.step()

    def until(self, state: str, seconds: float = 10.0) -> float:
        start = self.now_ns
        while self.arm.state != state:
            assert self.now_ns - start < seconds * 1e9, f"not within {seconds} s; it is {self.arm.state}"
            self.step()
        return (self.now_ns - start) * 1e-9

    def ask(self, name: str, values: Any = (), text: str = "") -> FakeRequest:
        request = FakeRequest(name, values, text)
        self.step(request)
        return request

    def homed(self) -> KinematicPair:
        self.run(0.02)
        self.ask("state_command", text="enable")
        self.until("ENABLED")
        self.ask("state_command", text="home")
        self.until("HOMED")
        self.run(0.1)
        return self


def test_power_comes_within_a_few_cycles_and_the_controller_stays_on() -> None:
    pair = KinematicPair()
    pair.run(0.02)
    pair.ask("state_command", text="enable")
    assert pair.until("ENABLED") < 0.01
    pair.run(0.2)
    assert pair.record.pid_enabled[0] and pair.state["valid"] and not pair.record.tracking_check[0]
    assert pair.record.pid_generation[0] == 2, "enabled once, with the power"
    assert pair.state["simulated"] and not pair.reports.of("error", "warning")


def test_homing_inserts_the_endoscope_in_the_time_of_the_reference() -> None:
    pair = KinematicPair("kinematic-ecm", EcmLogic)
    pair.run(0.02)
    pair.ask("state_command", text="enable")
    pair.until("ENABLED")
    pair.ask("state_command", text="home")
    assert pair.until("HOMED") == pytest.approx(3.0, abs=0.02)
    pair.run(0.1)
    assert pair.state["position"][:4] == pytest.approx((0, 0, 0.12, 0)) and pair.state["is_homed"]
    assert not pair.reports.of("error", "warning")


def test_homing_inserts_the_instrument_in_the_time_of_the_reference() -> None:
    pair = KinematicPair()
    pair.run(0.02)
    pair.ask("state_command", text="enable")
    pair.until("ENABLED")
    assert not pair.state["position"].any()
    pair.ask("state_command", text="home")
    took = pair.until("HOMED")
    assert took == pytest.approx(1.549, abs=0.02)
    pair.run(0.2)
    assert pair.state["position"][:6] == pytest.approx((0, 0, 0.12, 0, 0, 0))
    assert pair.state["is_homed"] and pair.record.limits_enforced[0] and pair.record.tracking_check[0]
    states = [event[2] for event in pair.reports.of("operating_state")]
    assert [s for i, s in enumerate(states) if i == 0 or s != states[i - 1]] == [
        "DISABLED", "POWERING", "ENABLED", "CALIBRATING_ENCODERS_FROM_POTS", "ENCODERS_BIASED", "HOMING", "HOMED"]
    assert not pair.reports.of("error", "warning")


@pytest.mark.parametrize(("pair", "event", "attached"), [
    (lambda: KinematicPair(), "tool_type", "LARGE_NEEDLE_DRIVER:400006"),
    (lambda: KinematicPair("kinematic-ecm", EcmLogic), "endoscope_type", "Classic_SD_STRAIGHT")])
def test_each_homing_reports_what_the_arm_carries(pair: Callable[[], KinematicPair], event: str, attached: str) -> None:
    arm = pair().homed()
    for _ in range(2):
        kinds = [each[0] for each in arm.reports.events]
        homed = arm.reports.events.index(next(each for each in arm.reports.of("operating_state") if each[2] == "HOMED"))
        assert event in kinds[homed:], "a client that waits from the moment on when it is homed hears it"
        assert arm.reports.of(event)[-1][1].startswith(attached)
        arm.ask("state_command", text="unhome")
        arm.reports.events.clear()
        arm.homed()


@pytest.mark.slow
def test_moves_are_followed_through_the_coupling_with_their_velocity() -> None:
    pair = KinematicPair().homed()
    goal = (0.2, -0.1, 0.15, 0.4, 0.3, -0.2)
    move = pair.ask("move_jp", goal)
    pair.run(0.3)
    fast = pair.state["velocity"][:6].copy()
    pair.run(2.0)
    assert move.outcomes[-1] == "done"
    assert pair.state["position"][:6] == pytest.approx(goal, abs=1e-9)
    assert np.abs(fast).max() > 0.1 and np.abs(pair.state["velocity"]).max() < 1e-9
    assert not np.allclose(pair.record.position[3:6], goal[3:]), "an instrument couples its actuators"


def test_dead_arm_is_held_and_its_successor_goes_on_without_a_jump() -> None:
    pair = KinematicPair().homed()
    pair.ask("move_jp", (0.2, -0.1, 0.15, 0.4, 0.3, -0.2))
    pair.run(0.5)
    pair.arm = None
    pair.run(0.01)
    held = pair.record.position.copy()
    pair.run(0.5)
    assert pair.record.holding[0] and np.array_equal(pair.record.position, held)
    pair.steps.clear()
    pair.start_arm()
    pair.run(0.5)
    assert pair.arm.state == "HOMED" and pair.state["is_homed"] and not pair.record.holding[0]
    assert max(pair.steps) < 1e-12


@pytest.mark.slow
def test_restarted_io_is_a_fault_and_can_be_homed_again() -> None:
    pair = KinematicPair().homed()
    pair.start_io()
    pair.epoch += 1
    pair.step()
    assert pair.arm.state == "FAULT" and ("error", "io-restarted", "PSM1: io was restarted") in pair.reports.events
    pair.run(0.3)
    assert not pair.record.powered[0]
    pair.homed()
    assert pair.state["position"][2] == pytest.approx(0.12)


@pytest.mark.slow
def test_power_again_begins_at_zero_as_in_the_reference() -> None:
    pair = KinematicPair().homed()
    pair.ask("state_command", text="disable")
    pair.run(0.2)
    assert pair.record.position[2] == pytest.approx(0.12) and not pair.record.powered[0]
    pair.homed()
    assert pair.record.position[2] == pytest.approx(0.12) and max(pair.steps) == pytest.approx(0.12)


def test_unhome_keeps_power_and_holds() -> None:
    pair = KinematicPair().homed()
    pair.ask("state_command", text="unhome")
    pair.run(0.2)
    assert pair.arm.state == "ENABLED" and pair.record.pid_enabled[0] and not pair.state["is_homed"]
    pair.ask("state_command", text="home")
    pair.until("HOMED")
    assert not pair.reports.of("error")


def test_adapter_and_instrument_are_engaged_at_once_and_nobody_sees_it_busy() -> None:
    tool = kinematic_system().arm("PSM1").tool
    pair = KinematicPair(tool_detection="MANUAL", tool=None, tools=(tool,)).homed()
    assert pair.state["count"] == 7 and pair.state["is_homed"]
    pair.reports.events.clear()
    pair.steps.clear()
    pair.ask("emulate_adapter_present", (1.0,))
    pair.ask("emulate_tool_present", (1.0,))
    pair.run(0.1)
    assert pair.reports.of("tool_type_request") and not pair.state["is_homed"]
    assert pair.ask("set_tool_type", text="LARGE_NEEDLE_DRIVER:400006").outcomes == ["done"]
    assert pair.state["count"] == 6 and pair.state["cartesian_valid"] and pair.state["is_homed"]
    assert pair.state["adapter"] == pair.state["instrument"] == 4
    assert not any(busy for *_, busy in pair.reports.of("operating_state")) and max(pair.steps) < 1e-12
    pair.ask("emulate_tool_present", (0.0,))
    pair.run(0.1)
    assert pair.state["count"] == 7 and pair.state["is_homed"] and max(pair.steps) < 1e-12


def test_a_kinematic_arm_comes_home_with_its_instrument() -> None:
    pair = KinematicPair()
    pair.homed()
    homed = [event for event in pair.reports.of("operating_state") if event[2] == "HOMED"]
    assert len(homed) <= 2 and all(event[3:] == (True, False) for event in homed), "entered, and the answer to home"


def test_a_fixed_instrument_of_a_kinematic_arm_can_be_exchanged_and_removed() -> None:
    tool = kinematic_system().arm("PSM1").tool
    assert tool is not None
    other = dataclasses.replace(tool, name="MEGA_NEEDLE_DRIVER_400194", names=("MEGA_NEEDLE_DRIVER",), model="400194")
    pair = KinematicPair(tool_detection="FIXED", tool=tool, tools=(tool, other)).homed()
    assert pair.state["count"] == 6
    assert pair.ask("set_tool_type", text="MEGA_NEEDLE_DRIVER:400194").outcomes == ["done"]
    assert pair.state.text("tool") == other.name and pair.state["cartesian_valid"]
    pair.reports.events.clear()
    assert pair.ask("emulate_tool_present", (0.0,)).outcomes == ["done"]
    pair.run(0.1)
    assert pair.reports.of("tool_type") == [("tool_type", "", 0.0)]
    assert pair.state.text("tool") == "" and pair.state["count"] == 7 and not pair.state["cartesian_valid"]
    pair.ask("emulate_tool_present", (1.0,))
    pair.run(0.1)
    assert pair.state.text("tool") == other.name, "the one that was named last, as in the reference"
    assert pair.state["count"] == 6 and pair.state["is_homed"]
