"""The death of each process in the running demo: what is named as the remedy helps.

What `trocar status` names is typed, then an operator enables teleoperation again, and the demo's hand draws on. Faults
of emulated robots, the emergency stop among them: tests/tools/test_hand.py.
"""

from __future__ import annotations

import os
import re
import signal
from collections.abc import Iterator

import pytest

from tests.system.conftest import systems
from tests.system.robot import COARSE_ON_BOARDS, STANDING, Robot, wait_for
from trocar.shm.time.held_time import HeldTime
from trocar.tools.examples.operator_sim import SimTeleop

pytestmark = [pytest.mark.slow, pytest.mark.simulated]
LONG_S = 300.0  # of a busy machine
TELEOP = "MTMR_PSM1"
STRUCK = {"boards": signal.SIGKILL, "IO1": signal.SIGSTOP, "MTMR": signal.SIGKILL, "PSM1": signal.SIGKILL,
          TELEOP: signal.SIGKILL, "console": signal.SIGKILL, "system": signal.SIGKILL}
"""The supervisor kills a stopped process once it was silent for too long."""


def named(status: str) -> list[str]:
    """The commands at the end of what is to be done first, or next; `status` in one line."""
    return re.findall(r"trocar (home(?: [A-Z]+\d?)*)", re.split("first: |next: ", status)[-1])


class RunningDemo:
    """`trocar demo` as a person starts it, looked at from outside."""

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        robot.supervisor = robot.popen("demo", "--system", robot.name, "--clock", "lockstep", *COARSE_ON_BOARDS,
                                       "--set", f"processes.{TELEOP}.period_s=0.01")
        wait_for(lambda: self.lives() and "following after" in robot.output(), LONG_S, "the demo follows")
        STANDING[robot.name] = HeldTime(robot.name)
        self.teleop = SimTeleop(robot.name, TELEOP)

    def lives(self) -> bool:
        """Fails with what it printed when it has ended."""
        assert self.robot.supervisor is not None and self.robot.supervisor.poll() is None, self.robot.output()
        return True

    def follows(self) -> bool:
        """Whether the slave does."""
        return self.lives() and self.teleop.is_following

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


@pytest.fixture(scope="module")
def demo(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningDemo]:
    """One for all, each of which leaves it following."""
    with systems(tmp_path_factory.mktemp("demo")) as make:
        made = RunningDemo(make())
        yield made
        made.teleop.ring.close()


@pytest.mark.parametrize("name", STRUCK)
def test_a_process_that_dies_while_the_demo_follows_is_recovered_by_what_is_named(demo: RunningDemo, name: str) -> None:
    demo.robot.passes(0.3)
    pid = demo.robot.pid(name)
    os.kill(pid, STRUCK[name])
    demo.robot.comes_back(name, pid)
    if name != "system":
        wait_for(lambda: not demo.follows(), LONG_S, "following ends")
    demo.robot.passes(0.3)
    demo.recover()
