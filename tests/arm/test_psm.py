"""A PSM with an instrument on: out of the cannula, its jaw, every stock instrument, snakes, and the weight of an Si."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from procs.arm.joints import joints
from procs.document.system import ArmConfig, ArmInputs
from procs.kinematics.poses import pose_from_matrix
from tests import stock
from tests.arm.fake_io import Rig, fixed_arm

DEEP = (0.0, 0.0, 0.12, 0.0, 0.0, 0.0)
ALL_TOOLS = sorted(path.stem for path in stock.find("dvrk-share/tool").glob("*_[0-9]*.json"))


def psm(tool: str, **changes: Any) -> ArmConfig:
    """A PSM that always carries a stock instrument, for which it is a Classic or an Si."""
    carried = stock.tool(tool)
    generation, kinematic = ("Si", "PSM_Si") if carried.model.startswith("42") else ("Classic", "PSM")
    return ArmConfig("PSM1", "PSM", generation, "1", "IO1", "PSM1", "NONE", 1 / 1500, stock.chain(kinematic),
                     tool_detection="FIXED", tool=carried, tools=(carried,), **changes)


def at(rig: Rig, place: tuple[float, ...]) -> Rig:
    move = rig.send("move_jp", place)
    rig.until(lambda: move.outcomes[-1] in ("done", "failed"))
    jaw = rig.send("jaw/move_jp", (0.0,))
    rig.until(lambda: jaw.outcomes[-1] in ("done", "failed"))
    rig.run(0.15)
    rig.reports.events.clear()
    return rig


@pytest.fixture
def rig() -> Rig:
    """Homed, a large needle driver 0.12 m deep."""
    return at(Rig(fixed_arm()).homed(), DEEP)


def tip_at(rig: Rig, depth: float) -> np.ndarray:
    """The present pose, with the tip this deep below the remote centre."""
    pose = rig.state["setpoint_cp"].copy()
    pose[:3] = (0.0, 0.0, -depth)
    return pose


# the cannula

@pytest.mark.parametrize("depth", (0.0335, 0.05, 0.0475))
def test_the_wrist_stays_out_of_the_cannula(rig: Rig, depth: float) -> None:
    for tip in np.arange(0.1135, depth, -0.001):
        rig.send("servo_cp", tip_at(rig, tip))
        rig.step()
        assert rig.io.setpoint[2] >= 0.0606 - 1e-9
    rig.send("servo_cp", tip_at(rig, depth))
    rig.run(0.01)
    assert rig.io.setpoint[2] == pytest.approx(0.0606, abs=1e-6)
    assert rig.state["setpoint_cp"][:3] == pytest.approx((0.0, 0.0, -0.0541), abs=1e-5)


def test_a_goal_that_is_deep_enough_is_reached(rig: Rig) -> None:
    rig.go((0.0, 0.0, 0.07, 0.0, 0.0, 0.0))
    rig.send("servo_cp", tip_at(rig, 0.06))
    rig.run(0.01)
    assert rig.io.setpoint[2] == pytest.approx(0.0665, abs=1e-6)


def test_moves_stay_out_of_it_as_well(rig: Rig) -> None:
    move = rig.send("move_cp", tip_at(rig, 0.0335))
    rig.until(lambda: "done" in move.outcomes)
    rig.step()
    assert rig.io.setpoint[2] == pytest.approx(0.0606, abs=1e-6)


def test_an_arm_that_has_begun_closer_goes_no_further_out() -> None:
    rig = at(Rig(fixed_arm()).homed(), (0.0, 0.0, 0.0595, 0.0, 0.0, 0.0))
    before = rig.io.setpoint[2]
    assert rig.send("servo_cp", tip_at(rig, 0.04)).outcomes == ["done"]
    rig.run(0.01)
    assert rig.io.setpoint[2] == pytest.approx(before, abs=1e-9)
    rig.send("servo_cp", tip_at(rig, 0.0538))
    rig.run(0.01)
    assert rig.io.setpoint[2] == pytest.approx(0.0603, abs=1e-6)


@pytest.mark.parametrize(("insertion", "allowed"), ((0.05, False), (0.0584, False), (0.0588, True)))
def test_cartesian_control_begins_beyond_the_cannula_only(insertion: float, allowed: bool) -> None:
    rig = at(Rig(fixed_arm()).homed(), (0.0, 0.0, insertion, 0.0, 0.0, 0.0))
    before = rig.io.setpoint.copy()
    requests = [rig.send(name, values) for name, values in (
        ("servo_cp", tip_at(rig, insertion - 0.0065)), ("move_cp", tip_at(rig, insertion - 0.0065)),
        ("body/servo_cf", (0.0,) * 6))]
    assert all((request.outcomes[0] != "refused") is allowed for request in requests)
    if not allowed:
        assert all("past the cannula" in request.replies[0][1] for request in requests)
        assert len(rig.reports.of("warning")) == 1 and np.array_equal(rig.io.setpoint, before)
        assert [e[4] for e in rig.reports.of("operating_state")] == [True, False]


def test_nothing_moves_for_a_goal_at_the_remote_centre(rig: Rig) -> None:
    before = rig.io.setpoint.copy()
    for depth in (0.0, 0.0009):
        request = rig.send("servo_cp", tip_at(rig, depth))
        assert request.outcomes == ["done"] and "too close to RCM" in request.replies[0][1]
        assert rig.send("move_cp", tip_at(rig, depth)).outcomes == ["refused"]
    rig.run(0.01)
    assert np.array_equal(rig.io.setpoint, before)


# the jaw

def test_jaw_goals_are_kept_by_the_arm_and_the_other_way_round(rig: Rig) -> None:
    rig.send("jaw/servo_jp", (0.6,))
    rig.send("servo_jp", (0.01, 0.0, 0.12, 0.0, 0.0, 0.0))
    rig.send("servo_cp", tip_at(rig, 0.1134))
    rig.run(0.01)
    assert rig.state["jaw_setpoint_position"] == pytest.approx(0.6)
    rig.send("jaw/servo_jp", (0.3,))
    rig.run(0.01)
    assert rig.state["setpoint_cp"][2] == pytest.approx(-0.1134, abs=1e-9)
    assert rig.state["jaw_setpoint_position"] == pytest.approx(0.3)


def test_jaw_limits_hold_while_the_tip_is_followed(rig: Rig) -> None:
    rig.send("servo_cp", tip_at(rig, 0.1134))
    assert rig.send("jaw/servo_jp", (-2.0,)).replies == [("done", "clipped: jaw")]
    rig.run(0.01)
    assert rig.state["jaw_setpoint_position"] == pytest.approx(-0.698132)


def test_a_jaw_command_freezes_a_moving_arm_where_it_is(rig: Rig) -> None:
    move = rig.send("move_jp", (0.8, 0.0, 0.12, 0.0, 0.0, 0.0))
    rig.run(0.3)
    here = rig.io.setpoint[0]
    rig.send("jaw/servo_jp", (0.1,))
    rig.run(0.3)
    assert move.outcomes == ["accepted", "failed"] and rig.io.setpoint[0] == pytest.approx(here, abs=0.003)


def test_a_jaw_move_goes_on_when_the_arm_is_sent_elsewhere(rig: Rig) -> None:
    jaw = rig.send("jaw/move_jp", (1.0,))
    first = rig.send("move_jp", (0.3, 0.0, 0.12, 0.0, 0.0, 0.0))
    rig.run(0.05)
    second = rig.send("move_jp", (0.1, 0.0, 0.12, 0.0, 0.0, 0.0))
    rig.until(lambda: second.outcomes[-1] == "done")
    assert first.outcomes == ["accepted", "failed"] and jaw.outcomes == ["accepted", "done"]
    rig.step()
    assert rig.state["jaw_position"] == pytest.approx(1.0) and rig.state["position"][0] == pytest.approx(0.1)


def test_a_jaw_effort_begins_cartesian_effort_control(rig: Rig) -> None:
    assert rig.send("jaw/servo_jf", (0.05,)).outcomes == ["done"]
    rig.step()
    assert rig.state["control_mode"] == 3 and rig.state["control_space"] == 2
    to_disc = np.eye(7)
    to_disc[3:, 3:] = rig.document.tool.actuator_to_joint
    assert rig.setpoint["effort"][:7] == pytest.approx(to_disc.T @ np.array((0, 0, 0, 0, 0, 0, 0.05)))
    rig.send("body/servo_cf", (0.0, 0.0, 1.0, 0.0, 0.0, 0.0))
    effort = np.linalg.inv(to_disc.T) @ rig.setpoint["effort"][:7]
    assert effort[6] == pytest.approx(0.05) and np.abs(effort[:6]).max() > 0.5
    rig.send("hold")
    rig.run(0.01)
    rig.send("free")
    assert not rig.setpoint["effort"].any(), "leaving effort mode has cleared the jaw's"


def test_a_jaw_effort_is_refused_in_the_cannula_and_kept_from_other_efforts() -> None:
    rig = at(Rig(fixed_arm()).homed(), (0.0, 0.0, 0.05, 0.0, 0.0, 0.0))
    assert "past the cannula" in rig.send("jaw/servo_jf", (0.05,)).replies[0][1]
    rig.send("servo_jf", (0.0, 0.0, 0.5, 0.0, 0.0, 0.0))
    assert rig.send("jaw/servo_jf", (0.05,)).outcomes == ["done"]
    assert rig.state["control_space"] == 1 and rig.setpoint["effort"][2] == pytest.approx(0.5)


# instruments

@pytest.mark.parametrize("name", ALL_TOOLS)
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
    rig = Rig(arm, inputs={"tool": 0})
    rig.run(0.6)
    rig.homed()
    move = rig.send("move_jp", (0.0, 0.0, 0.005, *rig.state["setpoint_position"][3:7]))
    rig.until(lambda: "done" in move.outcomes)
    rig.press("tool")
    rig.until(lambda: rig.arm.state == "ENGAGING_TOOL", 1.0)
    furthest = np.zeros(4)
    while rig.arm.state == "ENGAGING_TOOL":
        rig.step()
        furthest = np.maximum(furthest, np.abs(rig.io.setpoint[3:]))
    assert (furthest <= math.pi).all() and furthest.max() > 1.0, "half a turn at most, and not nothing"
    rig.run(0.1)
    assert rig.state["is_homed"] and rig.state.text("tool") == name
    assert rig.state["position"][3 : rig.state["count"]] == pytest.approx(0.0, abs=1e-5)


@pytest.fixture
def snake() -> Rig:
    """A needle driver of 5 mm, 0.12 m deep."""
    return at(Rig(psm("NEEDLE_DRIVER_400117")).homed(), (0.0, 0.0, 0.12, 0.1, 0.2, -0.1, -0.1, 0.2))


def test_a_snake_is_shown_in_eight_joints_that_bend_in_pairs(snake: Rig) -> None:
    assert snake.state["count"] == 8 and snake.state["has_jaw"]
    assert snake.state["position"] == pytest.approx((0.0, 0.0, 0.12, 0.1, 0.2, -0.1, -0.1, 0.2), abs=1e-9)
    assert snake.send("servo_jp", (0.0,) * 6).outcomes == ["refused"]
    snake.send("servo_jp", (0.0, 0.0, 0.12, 0.1, 0.3, -0.1, -0.1, 0.1))
    snake.run(0.01)
    assert snake.state["setpoint_position"][4:] == pytest.approx((0.2, -0.1, -0.1, 0.2), abs=1e-9), "the mean of both"


def test_the_tip_of_a_snake_follows_poses_with_their_velocity(snake: Rig) -> None:
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
    snake.run(0.01)
    assert snake.state["setpoint_cp"][:3] == pytest.approx(goal[:3], abs=1e-8)
    position = np.array(snake.io.setpoint)
    q = snake.arm.joints.to_joint @ position
    assert pose_from_matrix(kinematics.fk(q[:8].copy(), np.eye(4)))[:3] == pytest.approx(goal[:3], abs=1e-8)


def test_efforts_of_a_snake_amount_to_the_wrench_that_was_asked_for(snake: Rig) -> None:
    wrench = np.array((0.3, -0.2, 1.0, 0.001, 0.002, -0.003))
    assert snake.send("body/servo_cf", wrench).outcomes == ["done"]
    snake.io.record["effort"][2:] = snake.setpoint["effort"][:7]
    snake.step()
    assert snake.state["body_measured_cf"] == pytest.approx(wrench, abs=1e-6)


def test_the_wrist_of_a_snake_stays_out_of_the_cannula(snake: Rig) -> None:
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
    rig = at(Rig(arm, has_brakes=True).homed(), (0.2, -0.3, 0.15, 0.0, 0.0, 0.0))
    assert rig.io.flag("brakes_released")
    rig.run(0.01)
    assert rig.setpoint["feed_forward"][:3] == pytest.approx((-1.16738, -0.56542, -5.44301), abs=1e-4)
    assert not rig.setpoint["feed_forward"][3:7].any()
    assert rig.send("use_gravity_compensation", (0.0,)).outcomes == ["done"]
    rig.run(0.01)
    assert not rig.setpoint["feed_forward"].any()
