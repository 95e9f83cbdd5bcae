"""The same policy in a host and on a running system goes nearly the same way; after a fault it asks for a person."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.rl.playing import toward
from tests.system.robot import DEMO, SLOWER, Robot
from trocar.procs.rl.attached import RunningSystem
from trocar.procs.rl.backend import RobotStopped
from trocar.procs.rl.tasks import PsmReach
from trocar.shm.system import directory

pytestmark = [pytest.mark.slow, pytest.mark.simulated]
TIP_M = 0.003  # paced time is not lock-step: the policy sees records some cycles old
"""How far ways of the tip may be from each other: it goes 40 mm/s, and boards began at another moment."""
STEPS = 30


def played(env: PsmReach) -> tuple[np.ndarray[Any, Any], dict[str, Any]]:
    """Places of the tip (steps, 3) on the way to a goal, and what was said at the end."""
    observation, _ = env.reset(seed=11, options={"start": 2})
    places = []
    for _ in range(STEPS):
        observation, _, terminated, _, info = env.step(toward(observation, 7))
        places.append(observation["achieved_goal"])
        assert not info["refused"], info
        if terminated:
            break
    return np.array(places), info


def test_a_policy_does_on_a_running_system_what_it_did_in_a_host(robot: Robot) -> None:
    robot.up(DEMO, "--boards", "emulated", "--clock", "paced", *SLOWER)
    where = RunningSystem(robot.name, reset_ratio=0.5)
    with pytest.raises(RobotStopped, match=r"PSM1 is DISABLED and not homed.*first: trocar home PSM1"):
        PsmReach(backend=where)
    robot.home("PSM1")
    hosted = PsmReach(backend="boards")
    expected, told = played(hosted)
    hosted.close()
    found, attached = np.empty(0), PsmReach(backend=where)

    def play() -> str:
        nonlocal found, attached
        attached.close()
        attached = PsmReach(backend=where)
        try:
            found, info = played(attached)
        except RobotStopped as stopped:  # on the way to where it begins
            return str(stopped)
        return "" if info["is_success"] else str(info)

    problem = robot.retry(play, "a policy plays")
    assert told["is_success"] and not problem, (told, problem)
    assert np.linalg.norm(found - expected, axis=1).max() < TIP_M
    state = directory.reader(robot.name, "PSM1", "state")
    assert state.newest() and state.field("trajectory_ratio")[()] == 1.0, "as it was before the slow move"
    state.close()
    a_fault_ends_it(robot, attached)
    attached.close()


def a_fault_ends_it(robot: Robot, env: PsmReach) -> None:
    robot.trocar("send", "boards", "emergency_stop", "1")
    for _ in range(100):
        _, _, terminated, _, info = env.step(np.zeros(7))
        if terminated:
            break
    assert terminated and ("PSM1 is FAULT" in info["fault"] or "stalled" in info["fault"]), info  # by the verb
    robot.trocar("send", "boards", "emergency_stop", "0")
    with pytest.raises(RobotStopped, match=r"trocar status"):
        env.reset()
    robot.home("PSM1")
    with pytest.raises(RobotStopped, match="make a new environment"):  # though a person has homed it meanwhile
        env.reset()
