"""Masters of a real site on emulated boards, stepped: homed, left alone by their process, free, and locked."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from tests.arm.fake_requests import FakeRequest
from tests.arm.on_boards import SLOW, HomedOnBoards, OnBoards, of_site
from trocar.procs.kinematics.poses import rotation_vector

pytestmark = pytest.mark.slow
WAY = ["CALIBRATING_ENCODERS_FROM_POTS", "ENCODERS_BIASED", "CALIBRATING_ROLL", "RESETTING_ROLL_ENCODER", "HOMING"]
MAX_JUMP = 0.5e-3  # m


def tip(robot: OnBoards) -> np.ndarray:
    """Where the tip really is."""
    return robot.chain.fk(robot.arm.joints.to_joint @ robot.truth, np.eye(4))


@pytest.fixture
def robot(homed_on_boards: Callable[[str, str], HomedOnBoards]) -> OnBoards:
    """Homed, at zero."""
    return homed_on_boards("jhu-dVRK/system-MTML", "MTML").again()


@pytest.mark.parametrize("name", ("MTML", "MTMR"))
def test_a_master_of_a_real_site_homes(
    homed_on_boards: Callable[[str, str], HomedOnBoards], name: str
) -> None:
    homed = homed_on_boards(f"jhu-dVRK/system-{name}", name)
    robot, spent = homed.again(), homed.spent
    assert list(spent) == WAY
    assert spent["CALIBRATING_ROLL"] < 4.5 and spent["RESETTING_ROLL_ENCODER"] < 0.1
    assert spent["HOMING"] == pytest.approx(480 / 360 + 1, abs=0.1)
    assert np.abs(robot.truth).max() < math.radians(3.0)
    assert robot.harness.errors() == [] and not robot.reports.of("error", "warning")
    assert robot.state["gripper_valid"] and robot.state["is_homed"]


def test_a_process_that_dies_on_the_way_home_jerks_nothing() -> None:
    robot = of_site("jhu-dVRK/system-MTML", "MTML", *SLOW)
    for state in ("CALIBRATING_ROLL", "RESETTING_ROLL_ENCODER", "HOMING"):
        dies_on_the_way_home(robot, state)
    robot.homed()
    assert np.abs(robot.truth).max() < math.radians(3.0) and robot.harness.errors() == []


def dies_on_the_way_home(robot: OnBoards, state: str) -> None:
    robot.run(0.1)
    if robot.arm.state == "DISABLED":
        robot.do("state_command", (), "enable")
    robot.until(lambda: robot.arm.state == "ENABLED")
    robot.do("state_command", (), "home")
    robot.until(lambda: robot.arm.state == state)
    if state != "RESETTING_ROLL_ENCODER":
        robot.run(1.0)
    asked, before = robot.io.setpoint_position[robot.axes].copy(), tip(robot)[:3, 3]
    robot.away(0.5)
    robot.run(0.5)
    assert robot.arm.state == "ENABLED", state
    if state == "HOMING":  # it was moving: it stops where it was asked to be
        before = robot.chain.fk(robot.arm.joints.to_joint @ asked, np.eye(4))[:3, 3]
    assert np.abs(tip(robot)[:3, 3] - before).max() < (2e-3 if state == "HOMING" else MAX_JUMP), state


def free(robot: OnBoards) -> None:
    assert robot.do("body/servo_cf", (0.0,) * 6).outcomes == ["done"]


@pytest.mark.parametrize(("borne", "least", "most"), ((True, 0.0, 0.005), (False, 0.05, 1.0)))
def test_a_free_master_stays_where_it_is_as_long_as_its_weight_is_borne(robot, borne, least, most) -> None:
    free(robot)
    robot.do("use_gravity_compensation", (float(borne),))
    before = tip(robot)[:3, 3]
    robot.run(1.0)
    way = np.linalg.norm(tip(robot)[:3, 3] - before)
    assert least <= way < most


@pytest.mark.parametrize("locked", (False, True))
def test_a_process_that_dies_in_effort_mode_jerks_nothing(robot: OnBoards, locked: bool) -> None:
    free(robot)
    if locked:
        robot.do("lock_orientation")
    robot.run(0.5)
    before = tip(robot)[:3, 3]
    jump = 0.0
    for _ in range(round(1.0 / robot.period_s)):
        robot.step(alive=False)
        jump = max(jump, float(np.abs(tip(robot)[:3, 3] - before).max()))
    robot.start_arm()
    for _ in range(round(1.0 / robot.period_s)):
        robot.step()
        jump = max(jump, float(np.abs(tip(robot)[:3, 3] - before).max()))
    assert robot.arm.state == "HOMED" and jump < MAX_JUMP
    assert not robot.setpoint["in_effort"].any() and robot.harness.errors() == []


def test_a_locked_orientation_is_kept_while_a_hand_pulls(robot: OnBoards) -> None:
    free(robot)
    robot.run(0.3)
    before = tip(robot)
    robot.do("lock_orientation")
    request = FakeRequest("body/set_cf_orientation_absolute", (1,))
    robot.step(request)
    for _ in range(20):
        robot.do("body/servo_cf", (0.0, 0.0, 0.5, 0.0, 0.0, 0.0))
        robot.run(0.05)
    after = tip(robot)
    assert np.linalg.norm(after[:3, 3] - before[:3, 3]) > 0.2
    assert np.linalg.norm(rotation_vector(before[:3, :3].T @ after[:3, :3])) < math.radians(1.0)
