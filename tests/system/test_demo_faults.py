"""An emergency stop, and the death of each process, in the running demo: what is named as the remedy helps.

What `trocar status` names is typed, then an operator enables teleoperation again, and the demo's hand draws on. All
other faults of emulated robots: tests/tools/test_hand.py.
"""

from __future__ import annotations

import os
import re
import signal
from collections.abc import Iterator

import pytest

from tests.system.conftest import systems
from tests.system.robot import SLOWER, Robot, wait_for
from trocar.shm.time.system_time import SystemTime
from trocar.tools.examples.operator_sim import SimTeleop

pytestmark = [pytest.mark.slow, pytest.mark.simulated]
LONG_S = 300.0  # of a busy machine
TELEOP = "MTMR_PSM1"
STOP = "emergency_stop"
KILLED = ("IO1", "boards", "MTMR", "PSM1", TELEOP, "console", "system")


def named(status: str) -> list[str]:
    """The commands at the end of what is to be done first, or next; `status` in one line."""
    return re.findall(r"trocar (home(?: [A-Z]+\d?)*)", re.split("first: |next: ", status)[-1])


class RunningDemo:
    """`trocar demo` as a person starts it, looked at from outside."""

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        robot.supervisor = robot.popen("demo", "--system", robot.name, "--clock", "lockstep", *SLOWER)
        wait_for(lambda: self.lives() and "following after" in robot.output(), LONG_S, "the demo follows")
        self.teleop, self.time = SimTeleop(robot.name, TELEOP), SystemTime(robot.name)

    def lives(self) -> bool:
        """Fails with what it printed when it has ended."""
        assert self.robot.supervisor is not None and self.robot.supervisor.poll() is None, self.robot.output()
        return True

    def follows(self) -> bool:
        """Whether the slave does."""
        return self.lives() and self.teleop.is_following

    def passes(self, seconds: float) -> None:
        """So long in the system's time."""
        end_ns = self.time.now_ns() + round(seconds * 1e9)
        wait_for(lambda: self.lives() and self.time.now_ns() >= end_ns, LONG_S, f"{seconds} s of the system's time")

    def kill(self, name: str, number: signal.Signals) -> None:
        """Strike a process and wait until another one runs in its place."""
        pid = self.robot.pid(name)
        self.robot.pids.add(pid)
        os.kill(pid, number)
        wait_for(lambda: self.robot.pid(name) != pid and self.robot.state(name) == "RUNNING", LONG_S, f"{name} is back")
        self.robot.pids.add(self.robot.pid(name))

    def status(self) -> str:
        """In one line."""
        said = self.robot.types("status")
        return " ".join(f"{said.stdout} {said.stderr}".split())

    def recover(self) -> None:
        """Type what status says until all is well; then ask for teleoperation."""
        for _ in range(3):
            wait_for(lambda: named(self.status()) or "all well" in self.status(), LONG_S, "a remedy is named")
            for words in named(self.status()):
                self.robot.trocar(*words.split(), timeout=LONG_S)
        assert "all well" in self.status(), self.status()
        self.robot.trocar("send", "console", "teleop_enable", "1")
        wait_for(self.follows, LONG_S, f"it follows again; {self.status()}")

    def close(self) -> None:
        """Unmap."""
        self.teleop.ring.close()
        self.time.close()


@pytest.fixture(scope="module")
def demo(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningDemo]:
    """One for all, each of which leaves it following."""
    with systems(tmp_path_factory.mktemp("demo")) as make:
        made = RunningDemo(make())
        yield made
        made.close()


def test_an_emergency_stop_while_the_demo_follows_is_recovered_by_what_is_named(demo: RunningDemo) -> None:
    demo.passes(1.0)
    demo.robot.trocar("send", "boards", STOP, "1")
    wait_for(lambda: not demo.follows(), LONG_S, "following ends")
    demo.passes(0.5)
    demo.robot.trocar("send", "boards", STOP, "0")
    demo.recover()


@pytest.mark.parametrize(("name", "number"), [
    *((name, signal.SIGKILL) for name in KILLED), ("IO1", signal.SIGSTOP), ("MTMR", signal.SIGSTOP)])
def test_a_process_that_dies_while_the_demo_follows_is_recovered_by_what_is_named(
    demo: RunningDemo, name: str, number: signal.Signals,
) -> None:
    demo.passes(1.0)
    demo.kill(name, number)
    if name != "system":
        wait_for(lambda: not demo.follows(), LONG_S, "following ends")
    demo.passes(0.5)
    demo.recover()
