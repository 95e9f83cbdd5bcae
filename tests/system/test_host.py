"""What a host computes is what processes in lock-step do: every record of an arm, bit by bit."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence

import pytest

from tests.system.robot import DEMO, Robot
from tests.system.same_run import LockstepRun
from trocar.shm.time.held_time import HeldTime

pytestmark = [pytest.mark.slow, pytest.mark.simulated]
TELEOP = DEMO.parent / "kinematic-teleop.yaml"
SLICE_NS = 100_000_000


@contextlib.contextmanager
def looking_in_time(robot: Robot, others: Sequence[str] = ()) -> Iterator[LockstepRun]:
    """A run in which time stands between two looks: rings keep 0.7 s, however late a busy machine lets us look."""
    with pytest.MonkeyPatch.context() as patch, HeldTime(robot.name) as held, \
            LockstepRun(robot.name, "PSM1", others) as run:
        patch.setattr("tests.system.same_run.pause", lambda _: held.run_until(held.now_ns() + SLICE_NS, 60.0))
        yield run


def test_a_host_does_bit_by_bit_what_processes_do(robot: Robot) -> None:
    robot.up(TELEOP, "--clock", "lockstep")
    with looking_in_time(robot) as run:
        for word in ("enable", "home"):
            run.ask("PSM1", "state_command", (), word)
        run.look()
        assert robot.down() == 0
        assert len(run.records) > 1500
        assert run.differences() == []


def test_a_fault_comes_at_the_same_cycle_in_a_host_and_in_processes(robot: Robot) -> None:
    robot.up(DEMO, "--boards", "emulated", "--clock", "lockstep")
    with looking_in_time(robot, ("boards",)) as run:
        for word in ("enable", "home"):
            run.ask("PSM1", "state_command", (), word)
        run.ask("PSM1", "move_jp", (0.1, -0.1, 0.12, 0.0, 0.0, 0.0))
        run.ask("boards", "jam", (0.0, 1.0), "PSM1")
        run.send("PSM1", "move_jp", (-0.5, -0.1, 0.12, 0.0, 0.0, 0.0))
        run.wait(lambda: run.state() == "FAULT", "the fault")
        run.look()
        assert robot.down() == 0
        assert len(run.records) > 1500
        assert run.differences() == []
