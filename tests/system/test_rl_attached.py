"""The same policy in a host and on a running system goes nearly the same way; after a fault it asks for a person."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import trocar
from procs.rl.attached import RunningSystem
from procs.rl.backend import RobotStopped
from procs.rl.tasks import EcmAim, PsmReach
from shm import directory
from tests.rl.playing import toward
from tests.system.robot import DEMO, Robot, wait_for

pytestmark = [pytest.mark.slow, pytest.mark.simulated]
TIP_M = 0.001
"""How far ways of the tip may be from each other: it goes 40 mm/s, and boards began at another moment."""
STEPS = 30


def played(env: PsmReach, steps: int = STEPS) -> tuple[np.ndarray[Any, Any], dict[str, Any]]:
    """Places of the tip (steps, 3) on the way to a goal, and what was said at the end."""
    observation, _ = env.reset(seed=11, options={"start": 2})
    places = []
    for _ in range(steps):
        observation, _, terminated, _, info = env.step(toward(observation, 7))
        places.append(observation["achieved_goal"])
        assert not terminated and not info["refused"], info
    return np.array(places), info


def test_a_policy_does_on_a_running_system_what_it_did_in_a_host(robot: Robot) -> None:
    robot.up(DEMO, "--boards", "emulated", "--clock", "paced", "--set", "io.period_s=0.002", "--set",
             "arm.period_s=0.002", "--set", "emulation.period_s=0.002")
    where = RunningSystem(robot.name, reset_ratio=0.5)
    with pytest.raises(RobotStopped, match=r"PSM1 is DISABLED and not homed.*first: trocar home PSM1"):
        PsmReach(backend=where)
    with pytest.raises(ValueError, match=r"arms are PSM1 \(PSM\); it takes 1 different ECM"):
        EcmAim(backend=RunningSystem(robot.name, arms=("PSM1",)))
    robot.home("PSM1")
    hosted, attached = PsmReach(backend="boards"), PsmReach(backend=where)
    expected, told = played(hosted)
    found, info = played(attached)
    assert told["is_success"] and info["is_success"], (told, info)
    assert np.linalg.norm(found - expected, axis=1).max() < TIP_M
    ratio = directory.reader(robot.name, "PSM1", "state")
    assert ratio.newest() and ratio.field("trajectory_ratio")[()] == 1.0, "as it was before the slow move"
    ratio.close()
    hosted.close()

    a_hold_up_ends_it(attached)
    attached.close()
    attached = PsmReach(backend=where)
    a_base_that_moves_ends_it(robot, attached)
    attached.close()
    attached = PsmReach(backend=where)
    played(attached, 3)
    a_fault_ends_it(robot, attached)
    attached.close()
    with pytest.raises(RobotStopped, match=r"PSM1 is .* and not homed"):
        PsmReach(backend=where)


def a_hold_up_ends_it(env: PsmReach) -> None:
    observation, _ = env.reset(seed=11)
    env.step(toward(observation, 7))
    end_ns = env.robot.now_ns() + 300_000_000  # of the system's time, which may be slower than ours
    wait_for(lambda: env.robot.now_ns() > end_ns, 60.0, "time passes")
    _, _, terminated, _, info = env.step(np.zeros(7))
    assert terminated and "this program was held up for 0." in info["fault"], info
    for call in (env.reset, lambda: env.step(np.zeros(7))):
        with pytest.raises(RobotStopped, match="make a new environment"):
            call()


def a_base_that_moves_ends_it(robot: Robot, env: PsmReach) -> None:
    played(env, 2)
    raised = np.eye(4)
    raised[2, 3] = 0.02
    with trocar.psm("PSM1", robot.name) as psm:
        before = psm.setpoint_jp()[0]
        psm.set_base_frame(raised, "PSM1_base")
        _, _, terminated, _, info = env.step(np.zeros(7))
        assert terminated and info["fault"].startswith("the base of PSM1 has moved"), info
        assert np.abs(psm.setpoint_jp()[0] - before).max() < 1e-6
        psm.set_base_frame(np.eye(4), "PSM1_base")
    with pytest.raises(RobotStopped, match=r"the base of PSM1 has moved"):
        env.reset()


def a_fault_ends_it(robot: Robot, env: PsmReach) -> None:
    robot.trocar("send", "boards", "emergency_stop", "1")
    for _ in range(100):
        _, _, terminated, _, info = env.step(np.zeros(7))
        if terminated:
            break
    assert terminated and "PSM1 is FAULT" in info["fault"], info
    robot.trocar("send", "boards", "emergency_stop", "0")
    with pytest.raises(RobotStopped, match=r"PSM1 is FAULT.*trocar status"):
        env.reset()
    robot.home("PSM1")
    with pytest.raises(RobotStopped, match="make a new environment"):  # though a person has homed it meanwhile
        env.reset()
    robot.trocar("power-off", "PSM1")
