"""The arm's process by its front door: real shared memory, with this test in the place of io and supervisor."""

from __future__ import annotations

import dataclasses
import subprocess
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from tests.arm.arm_configs import fixed_arm
from tests.arm.fake_io import FakeIo, View
from trocar.procs.document.system import Actuator, IoConfig, Linear, Process, Robot, SystemConfig
from trocar.procs.supervisor import memory
from trocar.procs.tables import codes
from trocar.shm.commands import COMMANDS
from trocar.shm.mailbox.client import Client
from trocar.shm.mailbox.mailbox import Mailbox
from trocar.shm.system import directory
from trocar.shm.system.events import Events
from trocar.shm.time.clock import monotonic_ns
from trocar.shm.time.control_page import ControlPage

pytestmark = pytest.mark.slow
PATIENCE = 30_000  # cycles of 1 ms, of which a busy machine has fewer
ARM = """
import runpy, sys
import trocar.procs.arm.readings
readings = trocar.procs.arm.readings  # io is this test, which a busy machine delays
readings.LATE_NS = readings.ArmReadings.LATE_NS = 5_000_000_000
sys.argv[1:] = ["--system", sys.argv[1], "--name", "PSM1"]
runpy.run_module("trocar.procs.arm.loop", run_name="__main__")
"""
ACTUATOR = Actuator(0, 0, "REVOLUTE", 1.0, Linear(), Linear(), 1.0)


def document(name: str) -> SystemConfig:
    """An io with two robots, the arm's is the second."""
    other = Robot("MTM", "1", "QLA1", (ACTUATOR,) * 2)
    psm = Robot("PSM1", "2", "QLA1", (ACTUATOR,) * 7)
    io = IoConfig("IO1", "udp:127.0.0.1", "", 1 / 1500, 0.03, True, (other, psm), (), ())
    processes = (Process("IO1", "io", 1 / 1500), Process("PSM1", "arm", 1 / 1500, ("IO1",), late_s=5.0))
    return SystemConfig(name, "", "wall", (io,), (fixed_arm(),), None, processes, supervisor_lost_s=30.0)


class ArmLoopBench:
    """io and supervisor, played by the test on the wall clock."""

    def __init__(self, world: Any) -> None:
        self.world = world
        system = document(world.name)
        memory.create_all(system)
        self.supervisor = ControlPage(world.name, "supervisor", write=True)
        self.ring = directory.writer(world.name, "IO1", "state", "io")
        self.events = Events(directory.writer(world.name, "IO1", "events", "io"), monotonic_ns)
        self.mailbox = Mailbox(world.name, "IO1", COMMANDS["io"])
        self.setpoint = directory.reader(world.name, "PSM1", "setpoint")
        self.desired = View(self.setpoint.field)
        self.state = directory.reader(world.name, "PSM1", "state")
        self.io = FakeIo()
        position = self.io.position.copy()
        self.io.record = View(self.ring.field)
        self.io.position[...] = position
        self.happened = directory.reader(world.name, "PSM1", "events")
        self.client = Client(world.name, "PSM1")
        self.child = self.start()

    def start(self) -> subprocess.Popen[str]:
        return self.world.start(ARM)

    def cycle(self) -> None:
        now = monotonic_ns()
        self.supervisor.field("heartbeat_ns")[...] = now
        for command in self.mailbox.drain():
            self.io.on_behalf(command.origin)
            self.io.send(command.name, command.values, command.text)
            command.done()
        self.setpoint.newest()
        self.io.cycle(now, self.desired)
        self.ring.publish(now)
        self.state.newest()

    def until(self, condition: Callable[[], object], what: str) -> None:
        for _ in range(PATIENCE):
            if condition():
                return
            assert self.child.poll() is None, f"the arm's process has ended: {what}"
            self.cycle()
            time.sleep(0.001)
        pytest.fail(f"did not happen: {what}; the arm is {self.text('sub_state')}")

    def text(self, name: str) -> str:
        return bytes(self.state.field(name).item()).decode()

    def ask(self, name: str, values: Any = (), text: str = "") -> str:
        number = self.client.send(name, values, text)
        replies: list[tuple[str, str]] = []
        self.until(lambda: replies.extend((r.outcome, r.text) for r in self.client.poll() if r.id == number) or
                   (replies and replies[-1][0] != "accepted"), f"{name} {text}")
        print(replies)  # shown if the test fails
        return replies[-1][0]

    def close(self) -> None:
        self.world.kill(self.child)
        for part in (self.supervisor, self.ring, self.mailbox, self.setpoint, self.state, self.happened, self.client):
            part.close()
        self.events._ring.close()
        self.world.remove()


@pytest.fixture
def bench(world: Any) -> Any:
    made = ArmLoopBench(world)
    yield made
    made.close()


def homed(bench: ArmLoopBench) -> None:
    bench.until(lambda: bench.text("sub_state") == "DISABLED", "the arm's first record")
    bench.until(lambda: bench.happened.head > 0, "the arm's first event")
    assert bench.ask("state_command", text="enable") == "done"
    assert bench.ask("state_command", text="home") == "done"
    bench.until(lambda: bench.state.field("is_homed"), "a record that says so: what a successor sees")


def come_back(bench: ArmLoopBench) -> None:
    """A new process after the death of the old one, till its first record says that it is homed."""
    last = bench.state.head
    bench.child = bench.start()
    bench.until(lambda: bench.state.head > last and bench.state.field("is_homed"), "homed again")


def test_arm_process_homes_moves_and_survives_its_death(bench: ArmLoopBench) -> None:
    homed(bench)
    goal = np.array((0.3, 0.1, 0.1, 0.0, 0.0, 0.0))
    assert bench.ask("move_jp", goal) == "done"
    bench.until(lambda: np.allclose(bench.state.field("position")[:6], goal), "the goal, measured")
    bench.world.kill(bench.child)
    held = bench.io.setpoint.copy()
    to_the_dead = [bench.client.send("servo_jp", goal * 1.1) for _ in range(5)]
    come_back(bench)
    for _ in range(20):
        bench.cycle()
        time.sleep(0.002)
    assert [(r.id, r.outcome) for r in bench.client.poll()] == [(number, "refused") for number in to_the_dead]
    assert np.allclose(bench.io.setpoint, held, atol=1e-12)
    assert bench.ask("move_jp", goal * 0.5) == "done"


def test_arm_process_gives_the_words_of_io_for_a_fault(bench: ArmLoopBench) -> None:
    homed(bench)
    bench.events.report(codes.POTENTIOMETER, "PSM1: potentiometer 3 is off by 0.3 rad", "PSM1", 2)
    bench.io.flag("fault", 7)
    bench.io.flag("pid_enabled", False)
    bench.until(lambda: bench.text("state") == "FAULT", "FAULT")
    errors = [row["text"].decode() for row in bench.happened.last(50) if row["event"] == b"error"]
    assert errors == ["PSM1: potentiometer 3 is off by 0.3 rad"]


def test_arm_process_that_comes_back_without_power_names_the_stall_of_its_io(bench: ArmLoopBench) -> None:
    homed(bench)
    bench.world.kill(bench.child)
    bench.events.report(codes.HELD_UP, "IO1 stalled for 0.31 s", "IO1")
    bench.io.restart()
    bench.child = bench.start()
    bench.until(lambda: bench.text("state") == "FAULT", "FAULT")
    errors = [(row["code"], row["text"].decode()) for row in bench.happened.last(50) if row["event"] == b"error"]
    assert errors == [(b"io-restarted", "PSM1: IO1 stalled for 0.31 s; the arm's process was restarted")]


def test_an_arm_of_another_type_says_that_it_cannot_be(world: Any) -> None:
    system = document(world.name)
    other = dataclasses.replace(system.arms[0], type="ECM")
    memory.create_all(dataclasses.replace(system, arms=(other,)))
    child = world.start(ARM)
    page = ControlPage(world.name, "PSM1")
    world.until(lambda: child.poll() is not None, "its end")
    assert page.state == "FAILED" and "ECM" in str(page.get("error"))
    child.communicate()
    page.close()
    world.remove()
