"""Whether a move arrived: what its answer, `goal_reached` and homing say of joints that are not where it took them."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from tests.arm.arm_configs import bare_arm, fixed_arm
from tests.arm.fake_io import ArmHarness
from tests.arm.fake_requests import FakeRequest
from tests.arm.on_boards import HomedOnBoards
from trocar.procs.tables.arm_types import ARM_TYPES

DEEP = (0.0, 0.0, 0.12, 0.0, 0.0, 0.0)


@pytest.fixture
def harness() -> ArmHarness:
    """Homed with an instrument, inserted."""
    made = ArmHarness(fixed_arm()).homed()
    made.go(DEEP)
    made.reports.events.clear()
    return made


def over(harness: ArmHarness, move: FakeRequest) -> float:
    return harness.until(lambda: move.outcomes[-1] != "accepted")


def reached(harness: ArmHarness) -> list[bool]:
    return [event[1] for event in harness.reports.of("goal_reached")]


@pytest.mark.parametrize("name", ["move_jp", "move_jr", "move_cp", "move_cr", "jaw/move_jp"])
@pytest.mark.slow
def test_a_move_that_does_not_arrive_says_by_how_much_and_loses_no_power(harness: ArmHarness, name: str) -> None:
    pose = harness.state["measured_cp"].copy()
    pose[0] += 0.02
    values: Any = {"move_jp": (0.0, 0.3, *DEEP[2:]), "move_jr": (0.0, 0.3, 0.0, 0.0, 0.0, 0.0), "move_cp": pose,
                   "move_cr": (0.02, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0), "jaw/move_jp": (0.9,)}[name]
    harness.io.stuck = True
    move = harness.send(name, values)
    over(harness, move)
    assert move.outcomes == ["accepted", "done"] and " short (" in move.replies[-1][1]
    assert reached(harness) == [False]
    assert harness.arm.state == "HOMED" and not harness.reports.of("error")
    assert not harness.state["is_busy"]


def test_it_names_the_joint_and_how_far_it_is_off(harness: ArmHarness) -> None:
    harness.io.stuck = True
    move = harness.send("move_jp", (0.0, 0.3, 0.14, 0.0, 0.0, 0.0))
    over(harness, move)
    assert move.replies[-1] == ("done", "17.2° short (pitch), 20.0 mm short (insertion)")


def test_a_clipped_goal_and_a_short_way_are_both_in_the_answer(harness: ArmHarness) -> None:
    harness.io.stuck = True
    move = harness.send("move_jp", (0.0, 0.0, 5.0, 0.0, 0.0, 0.0))
    over(harness, move)
    assert move.replies[-1] == ("done", "clipped: insertion 5.000 → 0.240 m; 120.0 mm short (insertion)")


def test_a_joint_that_arrives_a_little_later_has_arrived(harness: ArmHarness) -> None:
    harness.io.stuck = True
    move = harness.send("move_jp", (0.0, 0.3, *DEEP[2:]))
    harness.until(lambda: not harness.arm.control.motion.moving)
    harness.run(0.2)
    assert move.outcomes == ["accepted"] and harness.state["is_busy"]
    harness.io.stuck = False
    over(harness, move)
    assert move.replies[-1] == ("done", "") and reached(harness) == [True]


@pytest.mark.parametrize("off", [0.9, 1.1])
def test_the_bound_is_the_one_in_the_table_of_arms(harness: ArmHarness, off: float) -> None:
    way = off * ARM_TYPES["PSM"].moves.arrival[1]
    harness.io.stuck = True
    move = harness.send("move_jp", (0.0, way, *DEEP[2:]))
    over(harness, move)
    assert reached(harness) == [off < 1.0]


@pytest.mark.parametrize("name", ["servo_jp", "servo_jf", "hold", "move_jp"])
def test_what_comes_before_the_joints_have_arrived_replaces_the_move(harness: ArmHarness, name: str) -> None:
    harness.io.stuck = True
    move = harness.send("move_jp", (0.0, 0.3, *DEEP[2:]))
    harness.until(lambda: not harness.arm.control.motion.moving)
    harness.send(name, {"servo_jp": (0.0, 0.3, *DEEP[2:]), "servo_jf": (0.0,) * 6, "hold": ()}.get(name, DEEP))
    assert move.outcomes == ["accepted", "failed"]
    assert reached(harness) == ([] if name == "move_jp" else [False])


def test_homing_that_does_not_arrive_names_the_joint() -> None:
    harness = ArmHarness(bare_arm(homing_zero_position=True))
    harness.run(0.1)
    harness.io.stuck = True
    harness.state_command("enable")
    harness.until(lambda: harness.arm.state == "ENABLED")
    harness.state_command("home")
    harness.until(lambda: harness.arm.state == "FAULT")
    (error,) = harness.reports.of("error")
    assert error[1] == "homing-timeout"
    assert "11.5° short (pitch)" in error[2] and "50.0 mm short (insertion)" in error[2]


# -- on emulated boards ------------------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize(("file", "name", "way"), [
    ("jhu-dVRK/system-PSM1", "PSM1", (0.6, 0.6, 0.1, 0.8, 0.5, 0.5, 0.5)),
    ("jhu-daVinci-Si/system-PSM1", "PSM1", (0.6, 0.6, 0.1, 0.8, 0.5, 0.5, 0.5)),
    ("jhu-daVinci/system-ECM", "ECM", (0.6, 0.6, 0.1, 0.5)),
    ("jhu-dVRK/system-MTML", "MTML", (0.3, 0.3, 0.2, 0.5, 0.5, 0.3, 1.0)),
])
def test_a_healthy_arm_arrives_against_weight_and_friction(
    homed_on_boards: Callable[[str, str], HomedOnBoards], file: str, name: str, way: tuple[float, ...]
) -> None:
    robot = homed_on_boards(file, name).again()
    arrival = np.array(robot.arm.joints.arrival)
    for part in (1.0, 0.2):
        move = robot.do("move_jp", part * np.array(way))
        robot.until(lambda: not robot.arm.control.motion.moving)
        assert move.replies[-1] == ("done", ""), "at once, at the end of the trajectory"
        robot.run(1.0)
        rest = np.abs(robot.arm.control.motion.goal - robot.arm.io.position)
        assert (rest < 0.5 * arrival).all(), rest / arrival


@pytest.mark.slow
def test_a_jammed_joint_within_its_tracking_tolerance_ends_the_move_short(
    homed_on_boards: Callable[[str, str], HomedOnBoards]
) -> None:
    robot = homed_on_boards("jhu-dVRK/system-PSM1", "PSM1").again()
    robot.harness.plant.jam("PSM1", 1, True)
    here = robot.arm.io.position.copy()
    here[1] += 0.3
    move = robot.do("move_jp", here)
    robot.until(lambda: move.outcomes[-1] != "accepted")
    assert move.outcomes[-1] == "done" and "17.2° short (pitch)" in move.replies[-1][1]
    assert robot.arm.state == "HOMED" and robot.reports.of("goal_reached") == [("goal_reached", False)]
    assert math.isclose(robot.truth[1], here[1] - 0.3, abs_tol=0.01)
