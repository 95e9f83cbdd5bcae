"""A PSM with an instrument on: out of the cannula, its jaw, every stock instrument, snakes, and the weight of an Si."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from tests import stock
from tests.arm.arm_configs import fixed_arm
from tests.arm.fake_io import ArmHarness
from tests.cases import cases
from trocar.procs.arm.cartesian import Cartesian
from trocar.procs.arm.joints import joints
from trocar.procs.document.system import ArmConfig, ArmInputs
from trocar.procs.kinematics.poses import pose_from_matrix

DEEP = (0.0, 0.0, 0.12, 0.0, 0.0, 0.0)
ALL_TOOLS = sorted(path.stem for path in stock.find("dvrk-share/tool").glob("*_[0-9]*.json"))


def psm(tool: str, **changes: Any) -> ArmConfig:
    """A PSM that always carries a stock instrument, for which it is a Classic or an Si."""
    carried = stock.tool(tool)
    generation, kinematic = ("Si", "PSM_Si") if carried.model.startswith("42") else ("Classic", "PSM")
    return ArmConfig("PSM1", "PSM", generation, "1", "IO1", "PSM1", "NONE", 1 / 1500, stock.chain(kinematic),
                     tool_detection="FIXED", tool=carried, tools=(carried,), **changes)


def at(harness: ArmHarness, place: tuple[float, ...]) -> ArmHarness:
    with harness.hurried():
        for name, goal in (("move_jp", place), ("jaw/move_jp", (0.0,))):
            move = harness.send(name, goal)
            harness.until(lambda: move.outcomes[-1] in ("done", "failed"))  # noqa: B023
    harness.run(0.15)
    harness.reports.events.clear()
    return harness


@pytest.fixture
def harness() -> ArmHarness:
    """Homed, a large needle driver 0.12 m deep."""
    return at(ArmHarness(fixed_arm()).homed(), DEEP)


def tip_at(harness: ArmHarness, depth: float) -> np.ndarray:
    """The present pose, with the tip this deep below the remote centre."""
    pose = harness.state["setpoint_cp"].copy()
    pose[:3] = (0.0, 0.0, -depth)
    return pose


# the cannula

@pytest.mark.parametrize("depth", (0.0335, 0.05, 0.0475))
def test_the_wrist_stays_out_of_the_cannula(harness: ArmHarness, depth: float) -> None:
    for tip in np.arange(0.1135, depth, -0.001):
        harness.send("servo_cp", tip_at(harness, tip))
        harness.step()
        assert harness.io.setpoint[2] >= 0.0606 - 1e-9
    harness.send("servo_cp", tip_at(harness, depth))
    harness.run(0.01)
    assert harness.io.setpoint[2] == pytest.approx(0.0606, abs=1e-6)
    assert harness.state["setpoint_cp"][:3] == pytest.approx((0.0, 0.0, -0.0541), abs=1e-5)


def test_a_goal_that_is_deep_enough_is_reached(harness: ArmHarness) -> None:
    harness.go((0.0, 0.0, 0.07, 0.0, 0.0, 0.0))
    harness.send("servo_cp", tip_at(harness, 0.06))
    harness.run(0.05)
    assert harness.io.setpoint[2] == pytest.approx(0.0665, abs=1e-6)


def test_moves_stay_out_of_it_as_well(harness: ArmHarness) -> None:
    move = harness.send("move_cp", tip_at(harness, 0.0335))
    harness.until(lambda: "done" in move.outcomes)
    harness.step()
    assert harness.io.setpoint[2] == pytest.approx(0.0606, abs=1e-6)


def test_an_arm_that_has_begun_closer_goes_no_further_out() -> None:
    harness = at(ArmHarness(fixed_arm()).homed(), (0.0, 0.0, 0.0595, 0.0, 0.0, 0.0))
    before = harness.io.setpoint[2]
    assert harness.send("servo_cp", tip_at(harness, 0.04)).outcomes == ["done"]
    harness.run(0.01)
    assert harness.io.setpoint[2] == pytest.approx(before, abs=1e-9)
    harness.send("servo_cp", tip_at(harness, 0.0538))
    harness.run(0.01)
    assert harness.io.setpoint[2] == pytest.approx(0.0603, abs=1e-6)


@pytest.mark.parametrize(("insertion", "allowed"), ((0.05, False), (0.0584, False), (0.0588, True)))
def test_cartesian_control_begins_beyond_the_cannula_only(insertion: float, allowed: bool) -> None:
    harness = at(ArmHarness(fixed_arm()).homed(), (0.0, 0.0, insertion, 0.0, 0.0, 0.0))
    before = harness.io.setpoint.copy()
    requests = [harness.send(name, values) for name, values in (
        ("servo_cp", tip_at(harness, insertion - 0.0065)), ("move_cp", tip_at(harness, insertion - 0.0065)),
        ("body/servo_cf", (0.0,) * 6))]
    assert all((request.outcomes[0] != "refused") is allowed for request in requests)
    if not allowed:
        assert all("past the cannula" in request.replies[0][1] for request in requests)
        assert len(harness.reports.of("warning")) == 1 and np.array_equal(harness.io.setpoint, before)
        assert [e[4] for e in harness.reports.of("operating_state")] == [True, False]


def test_nothing_moves_for_a_goal_at_the_remote_centre(harness: ArmHarness) -> None:
    before = harness.io.setpoint.copy()
    for depth in (0.0, 0.0009):
        request = harness.send("servo_cp", tip_at(harness, depth))
        assert request.outcomes == ["done"] and "too close to RCM" in request.replies[0][1]
        assert harness.send("move_cp", tip_at(harness, depth)).outcomes == ["refused"]
    harness.run(0.01)
    assert np.array_equal(harness.io.setpoint, before)


# instruments

@cases("name", ALL_TOOLS)
def test_every_stock_instrument_can_be_carried(name: str) -> None:
    tool = stock.tool(name)
    space = joints(psm(name), tool)
    assert (space.count, space.size) == ((8, 9) if tool.snake else (6, 7))
    discs = np.array((0.1, -0.2, 0.15, 0.3, -0.2, 0.1, 0.25))
    assert space.to_actuator @ (space.to_joint @ discs) == pytest.approx(discs, abs=1e-12)
    effort = np.linspace(-0.4, 0.7, space.size)
    rate = space.to_joint @ discs
    assert (space.to_joint.T @ effort) @ discs == pytest.approx(effort @ rate), "the same power on both sides"


@pytest.mark.parametrize("name", ALL_TOOLS)
def test_every_stock_instrument_is_engaged_within_what_its_discs_can_do(name: str) -> None:
    arm = psm(name, inputs=ArmInputs(tool="tool"))
    harness = ArmHarness(arm, inputs={"tool": 0})
    with harness.hurried():
        harness.run(0.6)
    harness.homed()
    harness.go((0.0, 0.0, 0.005, *harness.state["setpoint_position"][3:7]))
    harness.press("tool")
    harness.until(lambda: harness.arm.state == "ENGAGING_TOOL", 1.0)
    furthest = np.zeros(4)
    with harness.hurried():
        while harness.arm.state == "ENGAGING_TOOL":
            harness.step()
            furthest = np.maximum(furthest, np.abs(harness.io.setpoint[3:]))
    assert (furthest <= math.pi).all() and furthest.max() > 1.0, "half a turn at most, and not nothing"
    harness.run(0.1)
    assert harness.state["is_homed"] and harness.state.text("tool") == name
    assert harness.state["position"][3 : harness.state["count"]] == pytest.approx(0.0, abs=1e-5)


@pytest.fixture
def snake() -> ArmHarness:
    """A needle driver of 5 mm, 0.12 m deep."""
    return at(ArmHarness(psm("NEEDLE_DRIVER_400117")).homed(), (0.0, 0.0, 0.12, 0.1, 0.2, -0.1, -0.1, 0.2))


def test_a_snake_is_shown_in_eight_joints_that_bend_in_pairs(snake: ArmHarness) -> None:
    assert snake.state["count"] == 8 and snake.state["has_jaw"]
    assert snake.state["position"] == pytest.approx((0.0, 0.0, 0.12, 0.1, 0.2, -0.1, -0.1, 0.2), abs=1e-9)
    assert snake.send("servo_jp", (0.0,) * 6).outcomes == ["refused"]
    snake.send("servo_jp", (0.0, 0.0, 0.12, 0.1, 0.3, -0.1, -0.1, 0.1))
    snake.run(0.01)
    assert snake.state["setpoint_position"][4:] == pytest.approx((0.2, -0.1, -0.1, 0.2), abs=1e-9), "the mean of both"


def test_the_tip_of_a_snake_follows_poses_with_their_velocity(snake: ArmHarness) -> None:
    kinematics = snake.arm.joints.kinematics
    goal = snake.state["setpoint_cp"].copy()
    twist = np.array((0.01, -0.005, 0.002, 0.0, 0.1, 0.05))
    goal[:3] += (0.004, -0.003, 0.002)
    assert snake.send("servo_cp", (*goal, *twist)).outcomes == ["done"]
    rates = np.array(snake.arm.control.motion.velocity[:8])
    assert rates[4] == pytest.approx(rates[7]) and rates[5] == pytest.approx(rates[6])
    body = snake.state["jacobian"] @ rates
    rotation = snake.arm.control.cartesian.rotation
    assert (body.reshape(2, 3) @ rotation.T).reshape(6) == pytest.approx(twist, abs=1e-9)
    snake.run(0.1)
    assert snake.state["setpoint_cp"][:3] == pytest.approx(goal[:3], abs=1e-8)
    position = np.array(snake.io.setpoint)
    q = snake.arm.joints.to_joint @ position
    assert pose_from_matrix(kinematics.fk(q[:8].copy(), np.eye(4)))[:3] == pytest.approx(goal[:3], abs=1e-8)


def test_efforts_of_a_snake_amount_to_the_wrench_that_was_asked_for(snake: ArmHarness) -> None:
    wrench = np.array((0.3, -0.2, 1.0, 0.001, 0.002, -0.003))
    assert snake.send("body/servo_cf", wrench).outcomes == ["done"]
    snake.io.record["effort"][2:] = snake.setpoint["effort"][:7]
    snake.arm.control.cartesian.want(Cartesian.WRENCHES)
    snake.step()
    assert snake.state["body_measured_cf"] == pytest.approx(wrench, abs=1e-6)


def test_the_wrist_of_a_snake_stays_out_of_the_cannula(snake: ArmHarness) -> None:
    at(snake, (0.0, 0.0, 0.12, 0.0, 0.0, 0.0, 0.0, 0.0))
    kinematics = snake.arm.joints.kinematics
    for depth in np.arange(0.11, 0.0, -0.002):
        pose = snake.state["setpoint_cp"].copy()
        pose[:3] = (0.0, 0.0, -depth)
        snake.send("servo_cp", pose)
        snake.step()
        q = (snake.arm.joints.to_joint @ snake.io.setpoint)[:8].copy()
        assert np.linalg.norm(kinematics.fk_to(q, 4)[:3, 3]) >= 0.045 - 1e-9


# Si

def test_an_si_lets_its_brakes_go_and_bears_its_weight() -> None:
    arm = psm("LARGE_NEEDLE_DRIVER_420006", links=stock.chain("PSM_Si_physical"),
              mounting_pitch=math.radians(-45.0))
    harness = at(ArmHarness(arm, has_brakes=True).homed(), (0.2, -0.3, 0.15, 0.0, 0.0, 0.0))
    assert harness.io.flag("brakes_released")
    harness.run(0.01)
    assert harness.setpoint["feed_forward"][:3] == pytest.approx((-1.16738, -0.56542, -5.44301), abs=1e-4)
    assert not harness.setpoint["feed_forward"][3:7].any()
    assert harness.send("use_gravity_compensation", (0.0,)).outcomes == ["done"]
    harness.run(1.1)
    assert not harness.setpoint["feed_forward"].any()


def test_a_move_before_homing_is_told_that_the_arm_is_not_ready_whatever_its_size() -> None:
    harness = ArmHarness()
    for count in (6, 7):
        (answer,) = harness.send("move_jp", (0.0,) * count).replies
        assert answer[0] == "refused" and "must be in HOMED" in answer[1]
