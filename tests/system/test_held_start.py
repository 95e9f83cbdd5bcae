"""A system that is started to be held back: its time stands at the beginning until somebody holds it."""

from __future__ import annotations

import subprocess
from collections.abc import Callable

import pytest

from tests.system.robot import ROOT, UP_S, Robot, wait_for
from trocar.shm.time.held_time import HeldTime
from trocar.shm.time.lockstep import EPOCH_NS
from trocar.tools.systems.supervising import StartRequest

pytestmark = [pytest.mark.slow, pytest.mark.simulated]
KINEMATIC = ROOT / "configs/systems/kinematic.yaml"
NEXT_NS, LATER_NS = EPOCH_NS + 50_000_000, EPOCH_NS + 150_000_000


def test_time_stands_at_its_beginning_until_a_program_holds_it_however_late(robots: Callable[[], Robot]) -> None:
    robot = robots()
    request = StartRequest(KINEMATIC, robot.name, sets=("clock=lockstep",), held=True)
    with (robot.logs / "supervisor.txt").open("a") as out:
        robot.supervisor = subprocess.Popen(request.command(), cwd=ROOT, env=robot.environment, stdout=out, stderr=out,
                                            text=True)
    wait_for(robot.is_up, UP_S, "the system")
    robot.trocar("hz", "PSM1/state", "--window", "0.3", code=None)  # meanwhile time that nobody stops would go on
    with HeldTime(robot.name) as held:
        assert held.now_ns() == EPOCH_NS
        assert held.run_until(NEXT_NS, 60.0)
        assert EPOCH_NS < held.now_ns() <= NEXT_NS

    def went_on() -> bool:
        with HeldTime(robot.name) as held:
            return held.now_ns() > LATER_NS

    wait_for(went_on, 60, "time goes on once it was let go")
