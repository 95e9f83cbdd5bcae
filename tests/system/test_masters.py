"""Both masters of a real site on emulated boards, as processes: homed, free, locked, killed, with their grippers."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests import stock
from tests.system.robot import AT_250_HZ, Robot, wait_for
from tests.system.test_kinematic import echo
from trocar.procs.kinematics.forward import Kinematics
from trocar.shm.memory.segment import Segment, segment_name
from trocar.shm.system import directory

pytestmark = [pytest.mark.slow, pytest.mark.simulated("hosted")]
MAX_JUMP = 0.5e-3  # m
TO_JOINT = np.eye(7)
TO_JOINT[2, 1], TO_JOINT[3, 1], TO_JOINT[3, 2] = -1.0, 0.6697, -0.6697


def reported(robot: Robot, arm: str, event: str) -> list[float]:
    """Values of all events of this name so far."""
    reader = directory.reader(robot.name, arm, "events")
    values = [float(row["value"]) for row in reader.last(1000) if row["event"] == event.encode()]
    reader.close()
    return values


def jump(robot: Robot, arm: str, first_axis: int, since: int) -> float:
    """How far the tip was from where it was in io's cycle `since`, at most, m."""
    reader = directory.reader(robot.name, "IO1", "state")
    history = reader.last(4000)
    positions = history[history["cycle"] >= since]["position"][:, first_axis : first_axis + 7] @ TO_JOINT.T
    reader.close()
    chain = Kinematics(stock.chain(arm))
    tips = np.array([chain.fk(np.ascontiguousarray(q), np.eye(4))[:3, 3] for q in positions[::10]])
    return float(np.linalg.norm(tips - tips[0], axis=1).max())


def first_axis(robot: Robot, arm: str) -> int:
    """In io's record."""
    with Segment(segment_name(robot.name, "IO1", "state")) as segment:
        return int(segment.header.info["robots"][arm]["first"])


def cycle(robot: Robot) -> int:
    reader = directory.reader(robot.name, "IO1", "state")
    assert reader.newest()
    now = int(reader.field("cycle"))
    reader.close()
    return now


def test_both_masters_home_and_are_free_locked_and_held(robot: Robot, data: Callable[[str], Path]) -> None:
    robot.up(data("dvrk-site/jhu-dVRK/system-MTML-MTMR.json"), "--boards", "emulated", "--path",
             str(data("dvrk-share")), *AT_250_HZ)
    robot.trocar("power-on", timeout=300.0)
    robot.trocar("home", timeout=300.0)
    for arm in ("MTML", "MTMR"):
        error = np.abs(echo(robot, f"{arm}/measured_js")["position"])
        assert (error[:6] < np.radians(4.0)).all() and error[6] < np.radians(6.0)
    robot.trocar("send", "boards", "set_position", "MTML_gripper", "-0.1")
    wait_for(lambda: reported(robot, "MTML", "gripper/closed") == [1.0], 20, "closed")
    assert len(reported(robot, "MTML", "gripper/pinch")) == 1 and reported(robot, "MTMR", "gripper/closed") == []
    assert echo(robot, "MTML/gripper/measured_js")["position"] == [pytest.approx(-0.1, abs=0.01)]

    for arm in ("MTML", "MTMR"):
        robot.trocar("send", arm, "body/servo_cf", *"000000", "--wait")
        robot.trocar("send", arm, "lock_orientation", "--wait")
        assert reported(robot, arm, "orientation_locked")[-1] == 1.0
        since, old = cycle(robot), robot.kill(arm)
        wait_for(lambda: robot.pid(arm) != old and robot.state(arm) == "RUNNING", 30, "restart")  # noqa: B023
        wait_for(lambda: reported(robot, arm, "orientation_locked")[-1] == 0.0, 30, "unlocked")  # noqa: B023
        wait_for(lambda: cycle(robot) > since + 500, 30, "time")  # noqa: B023
        far = jump(robot, arm, first_axis(robot, arm), since)
        assert far < MAX_JUMP and echo(robot, f"{arm}/operating_state")["is_homed"] is True
    robot.trocar("power-off")
