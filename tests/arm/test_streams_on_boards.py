"""A robot never loses power because a client sent a wrong number: an emulated PSM with plant, io and arm, stepped."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from tests.arm.on_boards import OnBoards
from trocar.procs.arm.governor import MAX_LAG_S
from trocar.procs.config import PROJECT_CONFIGS, load_system
from trocar.procs.host.objects import RememberedObjects

DEEP = np.array((0.0, 0.0, 0.12, 0.0, 0.0, 0.0))
RANGE = np.array((1.0, 0.8, 0.08, 4.0, 1.3, 1.3))  # from there, either way


@pytest.fixture(scope="module")
def made() -> tuple[OnBoards, RememberedObjects]:
    """Deep, following a steady stream; and what puts it back there."""
    loaded = load_system(PROJECT_CONFIGS / "systems" / "demo.yaml", boards="emulated")
    assert loaded.system is not None
    robot = OnBoards(loaded.system, "PSM1")
    robot.run(0.6)
    robot.homed()
    robot.do("emulate_adapter_present", (1.0,))
    robot.do("emulate_tool_present", (1.0,))
    robot.until(lambda: robot.state["is_homed"] and robot.state["count"] == 6)
    move = robot.do("move_jp", DEEP)
    robot.until(lambda: move.outcomes[-1] != "accepted")
    robot.run(0.6)
    for _ in range(20):
        request = robot.do("servo_jp", DEEP)
        assert request.outcomes == ["done"], (request.replies, move.replies)
    return robot, RememberedObjects({"robot": robot})


@pytest.fixture
def robot(made: tuple[OnBoards, RememberedObjects]) -> Iterator[OnBoards]:
    """Deep, following a steady stream; at the end it has lost nothing."""
    robot, then = made
    then.put_back()
    yield robot
    assert robot.arm.state == "HOMED" and not robot.harness.errors() and not robot.reports.of("error")
    assert robot.io.power_requested.all() and robot.io.amps_on.all() and robot.io.pid_enabled.all()


def largest_error(robot: OnBoards) -> float:
    """As a share of what is tolerated."""
    return float((np.abs(robot.io.position_error) / robot.harness.core.pid.tolerance)[robot.axes].max())


@pytest.mark.slow
def test_the_largest_jumps_that_a_stream_may_make_are_followed(robot: OnBoards) -> None:
    far = np.minimum(0.99 * MAX_LAG_S * robot.arm.joints.servo_speed[:6], RANGE / 3)
    worst = 0.0
    for sign in (1, -1, 1, 0, 1, -1, 0):
        goal = DEEP + sign * far / 2
        for _ in range(120):
            assert robot.do("servo_jp", goal).outcomes == ["done"]
            worst = max(worst, largest_error(robot))
    assert worst < 0.8


@pytest.mark.slow
def test_the_worst_stream_that_is_not_ended_is_followed(robot: OnBoards) -> None:
    chance, worst, goal = np.random.default_rng(7), 0.0, DEEP
    span = np.minimum(0.49 * MAX_LAG_S * robot.arm.joints.servo_speed[:6], RANGE)
    for count in range(1500):
        if count % 40 == 0:
            goal = DEEP + span * chance.choice((-1.0, 1.0), 6)
        robot.do("servo_jp", goal)
        worst = max(worst, largest_error(robot))
    assert worst < 0.95


@pytest.mark.parametrize("wrong", (0.8, -0.8, 1e6))
def test_three_goals_that_are_far_off_cost_no_power(robot: OnBoards, wrong: float) -> None:
    goal = DEEP + wrong
    assert [robot.do("servo_jp", goal).outcomes for _ in range(3)] == [["refused"]] * 3
    robot.run(0.3)


def test_a_velocity_that_no_joint_can_reach_costs_no_power(robot: OnBoards) -> None:
    for _ in range(300):
        robot.do("servo_jv", (100.0, -100.0, 100.0, 0.0, 0.0, 0.0))
    robot.run(0.3)


def test_another_base_frame_under_a_steady_pose_costs_no_power(robot: OnBoards) -> None:
    pose = robot.state["setpoint_cp"].copy()
    for x in (0.0, 0.03, 0.0, -0.03, 0.004, 0.0):
        robot.do("set_base_frame", (x, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0), "table")
        for _ in range(60):
            robot.do("servo_cp", pose)
    robot.do("set_base_frame", (0.0,) * 6 + (1.0,), "table")
    robot.run(0.3)


def test_a_setpoint_record_that_is_wild_for_a_while_costs_no_power(robot: OnBoards) -> None:
    """Whatever wrote it, io's own bound holds."""
    for _ in range(10):
        robot.arm.control.motion.rows[0, :3] = (1.5, -0.9, 0.24)
        robot.step()
    robot.arm.control.motion.goal[...] = robot.arm.control.motion.target
    robot.run(0.3)
