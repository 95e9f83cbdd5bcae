"""Poses, increments, wrenches and impedance at the tip, on a homed arm with an instrument."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.arm.arm_configs import fixed_arm
from tests.arm.fake_io import SECOND, ArmHarness
from tests.arm.fake_requests import FakeRequest
from trocar.procs.arm.cartesian import Cartesian
from trocar.procs.arm.efforts import COUNT
from trocar.procs.kinematics.poses import matrix_from_pose, pose_from_matrix, rotation_vector
from trocar.procs.node.requests import CommandRefused

BENT = (0.2, -0.3, 0.15, 0.4, -0.5, 0.6)
QUARTER = (0.1, 0.2, 0.3, 0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5))
STRAIGHT = (0.0, 0.0, 0.0, 1.0)
ANSWERED = ("done", "failed", "refused")


@pytest.fixture
def harness() -> ArmHarness:
    return bent()


def bent(**changes: Any) -> ArmHarness:
    """Homed, and bent."""
    made = ArmHarness(fixed_arm(**changes)).homed()
    with made.hurried():
        finish(made, made.send("move_jp", BENT))
        made.run(0.2)
    made.reports.events.clear()
    return made


def finish(harness: ArmHarness, request: FakeRequest) -> None:
    harness.until(lambda: request.outcomes[-1] in ANSWERED)


def settle(harness: ArmHarness) -> None:
    harness.run(0.1)


def pose(harness: ArmHarness, name: str = "measured_cp") -> Any:
    return np.array(harness.state[name])


def turn_z(angle: float) -> tuple[float, ...]:
    return (0.0, 0.0, np.sin(angle / 2), np.cos(angle / 2))


def turned_about_z(tip: Any, angle: float) -> Any:
    """A pose (7,) turned about its own z axis."""
    return pose_from_matrix(matrix_from_pose(tip) @ matrix_from_pose(np.array((0.0, 0.0, 0.0, *turn_z(angle)))))


def same_pose(found: Any, wanted: Any, abs_: float = 1e-6) -> bool:
    a, b = matrix_from_pose(np.array(found)), matrix_from_pose(np.array(wanted))
    turned = float(np.abs(rotation_vector(a[:3, :3].T @ b[:3, :3])).max())
    return bool(np.abs(a - b)[:3, 3].max() < abs_ and turned < abs_)


def test_servo_cp_reaches_the_joints_of_the_specification(harness: ArmHarness) -> None:
    goal = pose(harness)
    goal[:3] += (0.01, -0.005, 0.003)
    assert harness.send("servo_cp", goal).outcomes == ["done"]
    settle(harness)
    expected = (0.275590, -0.267787, 0.148061, 0.464517, -0.498835, 0.509569)
    assert harness.state["setpoint_position"][:6] == pytest.approx(expected, abs=2e-5)
    assert same_pose(pose(harness), goal) and harness.state["control_space"] == 2 and harness.state["control_mode"] == 1


def test_move_cp_turns_the_tip_about_itself_as_in_the_specification(harness: ArmHarness) -> None:
    turned = turned_about_z(pose(harness), 0.2)
    move = harness.send("move_cp", turned)
    assert harness.state["is_busy"] and harness.state["control_mode"] == 2
    finish(harness, move)
    settle(harness)
    expected = (0.190934, -0.297873, 0.150504, 0.593801, -0.611086, 0.501626)
    assert move.outcomes == ["accepted", "done"]
    assert harness.state["setpoint_position"][:6] == pytest.approx(expected, abs=2e-5)


def test_poses_are_given_in_the_reference_frame(harness: ArmHarness) -> None:
    harness.send("set_base_frame", QUARTER, "world")
    settle(harness)
    local = pose(harness, "local_measured_cp")
    goal = pose(harness)
    goal[1] += 0.01  # the reference's y is the base's x
    harness.send("servo_cp", goal)
    settle(harness)
    assert pose(harness, "local_measured_cp")[:3] - local[:3] == pytest.approx((0.01, 0.0, 0.0), abs=1e-6)
    assert same_pose(pose(harness), goal)


@pytest.mark.parametrize("name", ("servo_cp", "move_cp", "servo_cr", "move_cr"))
def test_with_an_unknown_base_frame_poses_are_refused(harness: ArmHarness, name: str) -> None:
    harness.send("set_base_frame")
    settle(harness)
    request = harness.send(name, (0.0, 0.0, -0.13, *STRAIGHT))
    assert request.outcomes == ["refused"] and "base frame is not known" in request.replies[0][1]


def test_a_velocity_given_with_a_pose_is_fed(harness: ArmHarness) -> None:
    twist = (0.01, 0.0, 0.0, 0.0, 0.0, 0.1)
    harness.send("servo_cp", (*pose(harness), *twist))
    jacobian = harness.state["jacobian"][:, :6]
    rotation = matrix_from_pose(pose(harness))[:3, :3]
    moving = harness.arm.control.motion.velocity[:6]
    shown = np.concatenate([rotation @ (jacobian @ moving)[:3], rotation @ (jacobian @ moving)[3:]])
    assert harness.setpoint["has_velocity"] and shown == pytest.approx(twist, abs=1e-6)


def test_increments_shift_and_turn_the_tip_about_itself(harness: ArmHarness) -> None:
    before = pose(harness)
    assert harness.send("servo_cr", (0.002, 0.0, -0.001, *turn_z(0.1))).outcomes == ["done"]
    settle(harness)
    after = pose(harness)
    assert after[:3] - before[:3] == pytest.approx((0.002, 0.0, -0.001), abs=1e-6)
    change = matrix_from_pose(after)[:3, :3] @ matrix_from_pose(before)[:3, :3].T
    assert rotation_vector(change) == pytest.approx((0.0, 0.0, 0.1), abs=1e-6)
    move = harness.send("move_cr", (0.0, 0.005, 0.0, *STRAIGHT))
    finish(harness, move)
    settle(harness)
    assert pose(harness)[:3] - after[:3] == pytest.approx((0.0, 0.005, 0.0), abs=1e-6)


def test_increments_of_one_cycle_add_up(harness: ArmHarness) -> None:
    before = pose(harness)
    step = (0.001, 0.0, 0.0, *STRAIGHT)
    harness.step(FakeRequest("servo_cr", step), FakeRequest("servo_cr", step))
    settle(harness)
    assert pose(harness)[0] - before[0] == pytest.approx(0.002, abs=1e-6)


def test_a_move_out_of_reach_stops_the_older_one_and_tells_everybody(harness: ArmHarness) -> None:
    older = harness.send("move_jp", (-0.5, 0.0, 0.15, 0.0, 0.0, 0.0))
    harness.run(0.3)
    harness.reports.events.clear()
    request = harness.send("move_cp", (0.5, 0.5, -0.1, *STRAIGHT))
    assert request.outcomes == ["refused"] and "unable to solve inverse kinematics (" in request.replies[0][1]
    assert older.outcomes == ["accepted", "failed"]
    assert ("goal_reached", False) in harness.reports.events
    assert harness.reports.of("operating_state")[-1][4] is False and not harness.state["is_busy"]
    assert harness.reports.of("error")[0][1] == "inverse-kinematics"
    held = harness.io.setpoint.copy()
    harness.run(0.2)
    assert harness.io.setpoint == pytest.approx(held)


def test_a_stream_that_goes_out_of_reach_is_no_error_unless_it_jumps_there(harness: ArmHarness) -> None:
    goal = pose(harness)
    for _ in range(2000):
        goal[0] += 0.0002
        (answer,) = harness.send("servo_cp", goal).replies
        assert answer[0] == "done"
    assert answer[1].startswith("at its limit: ")
    assert {code for _, code, _ in harness.reports.of("warning", "error")} == {"at-limit"}
    goal[0] += 0.06
    (answer,) = harness.send("servo_cp", goal).replies
    assert answer[0] == "refused" and "60 mm at once; 50 mm is allowed" in answer[1]


def test_a_first_goal_that_is_far_away_and_out_of_reach_is_refused(harness: ArmHarness) -> None:
    before = harness.io.setpoint.copy()
    for goal in ((0.5, 0.5, -0.1, *STRAIGHT), (20.0, 10.0, -120.0, *STRAIGHT)):
        assert harness.send("servo_cp", goal).outcomes == ["refused"]
        harness.run(0.1)
        assert harness.io.setpoint == pytest.approx(before, abs=1e-9)


@pytest.mark.parametrize("values", (
    (0.0, 0.0, -0.13, 0.0, 0.0, 0.0, 0.0), (0.0, 0.0, -0.13, 0.0, 0.0, 0.0), (np.nan, 0.0, -0.13, *STRAIGHT),
    (0.0, 0.0, -0.13, 0.0, 0.0, 0.0, 2.0)))
def test_what_is_no_pose_is_refused(harness: ArmHarness, values: Any) -> None:
    for name in ("servo_cp", "move_cp", "servo_cr", "move_cr"):
        assert harness.send(name, values).outcomes == ["refused"], name


@pytest.mark.parametrize("name", ("body/servo_cf", "servo_cf"))
def test_a_wrench_of_the_body_goes_through_the_jacobian(harness: ArmHarness, name: str) -> None:
    wrench = np.array((0.1, -0.2, 1.0, 0.01, 0.02, -0.03))
    assert harness.send(name, wrench).outcomes == ["done"]
    effort = harness.state["jacobian"][:, :6].T @ wrench
    assert harness.arm.control.motion.effort[:6] == pytest.approx(effort) and harness.state["control_mode"] == 3
    harness.io.position[0] += 0.1  # a hand moves the arm: the same wrench needs other efforts
    harness.run(0.01)
    assert harness.arm.control.motion.effort[:6] == pytest.approx(harness.state["jacobian"][:, :6].T @ wrench)


def test_an_absolute_wrench_has_the_axes_of_the_reference_frame(harness: ArmHarness) -> None:
    harness.send("set_base_frame", QUARTER, "world")
    assert harness.send("body/set_cf_orientation_absolute", (1.0,)).outcomes == ["done"]
    harness.send("body/servo_cf", (0.0, 0.0, 1.0, 0.0, 0.0, 0.0))
    harness.run(0.01)
    rotation = matrix_from_pose(pose(harness))[:3, :3]
    body = np.concatenate([rotation.T @ (0.0, 0.0, 1.0), np.zeros(3)])
    assert harness.arm.control.motion.effort[:6] == pytest.approx(harness.state["jacobian"][:, :6].T @ body)


@pytest.mark.parametrize("setting", [0.0, 1.0])
@pytest.mark.parametrize("absolute", [0.0, 1.0])
def test_a_wrench_may_say_itself_whose_axes_it_has(harness: ArmHarness, setting: float, absolute: float) -> None:
    harness.send("set_base_frame", QUARTER, "world")
    harness.send("body/set_cf_orientation_absolute", (setting,))
    assert harness.send("body/servo_cf", (0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.05, absolute)).outcomes == ["done"]
    harness.run(0.01)
    axes = matrix_from_pose(pose(harness))[:3, :3] if absolute else np.eye(3)
    body = np.concatenate([axes.T @ (0.0, 0.0, 1.0), np.zeros(3)])
    assert harness.arm.control.motion.effort[:6] == pytest.approx(harness.state["jacobian"][:, :6].T @ body)
    assert harness.arm.control.cartesian.absolute is bool(setting), "that stays as it was set"
    assert harness.send("body/servo_cf", (0.0,) * 7 + (0.5,)).outcomes == ["refused"]


def test_an_impedance_leaves_the_axes_of_wrenches_as_they_were(harness: ArmHarness) -> None:
    harness.send("set_base_frame", QUARTER, "world")
    here, nothing = pose(harness), np.zeros(48)
    assert harness.send("servo_ci", np.concatenate([here[:3], STRAIGHT, here[3:], nothing])).outcomes == ["done"]
    harness.send("hold")
    harness.send("body/servo_cf", (0.0, 0.0, 1.0, 0.0, 0.0, 0.0))
    harness.run(0.01)
    effort = harness.state["jacobian"][:, :6].T @ (0, 0, 1, 0, 0, 0)
    assert harness.arm.control.motion.effort[:6] == pytest.approx(effort)


def test_a_spatial_wrench_acts_at_the_origin_of_the_base(harness: ArmHarness) -> None:
    force, torque = np.array((0.3, 0.0, -0.5)), np.array((0.0, 0.01, 0.0))
    harness.send("spatial/servo_cf", (*force, *torque))
    harness.run(0.01)
    tip = matrix_from_pose(pose(harness, "local_measured_cp"))
    body = np.concatenate([tip[:3, :3].T @ force, tip[:3, :3].T @ (torque - np.cross(tip[:3, 3], force))])
    assert harness.arm.control.motion.effort[:6] == pytest.approx(harness.state["jacobian"][:, :6].T @ body)


def test_the_published_wrench_is_the_one_that_is_applied(harness: ArmHarness) -> None:
    wrench = np.array((0.1, -0.2, 1.0, 0.01, 0.02, -0.03))
    jacobian = harness.state["jacobian"][:, :6]
    actuator = np.zeros(7)
    coupling = np.eye(7)
    coupling[3:, 3:] = harness.document.tool.actuator_to_joint
    actuator[:] = coupling.T @ np.append(jacobian.T @ wrench, 0.0)
    harness.io.record["effort"][2:] = actuator
    harness.run(0.01)
    for name in ("body_measured_cf", "spatial_measured_cf"):
        assert np.isnan(harness.state[name]).all(), "nobody wants it"
    harness.arm.control.cartesian.want(Cartesian.WRENCHES)
    harness.step()
    assert harness.state["body_measured_cf"] == pytest.approx(wrench, abs=1e-6)
    tip = matrix_from_pose(pose(harness, "local_measured_cp"))
    force = tip[:3, :3] @ wrench[:3]
    assert harness.state["spatial_measured_cf"][:3] == pytest.approx(force, abs=1e-6)
    assert harness.state["spatial_measured_cf"][3:] == pytest.approx(
        tip[:3, :3] @ wrench[3:] + np.cross(tip[:3, 3], force), abs=1e-6)
    harness.arm.control.cartesian.want(0)
    harness.step()
    assert np.isnan(harness.state["body_measured_cf"]).all() and np.isnan(harness.state["spatial_measured_cf"]).all()


def test_servo_cs_follows_what_is_marked_as_meant(harness: ArmHarness) -> None:
    goal, wrench = pose(harness), np.array((0.0, 0.0, 0.5, 0.0, 0.0, 0.0))
    goal[0] += 0.002
    zero = (0.0,) * 6
    assert harness.send("servo_cs", (*goal, *zero, *wrench, 1, 0, 1)).outcomes == ["done"]
    assert harness.setpoint["feed_forward"][:7].any() and not harness.setpoint["in_effort"].any()
    settle(harness)
    assert same_pose(pose(harness), goal)
    harness.send("servo_cs", (*goal, *zero, *wrench, 0, 0, 1))
    assert harness.setpoint["in_effort"][:7].all() and harness.arm.control.motion.effort[:6].any()
    harness.send("servo_cs", (*goal, *zero, *wrench, 0, 0, 0))
    assert harness.setpoint["in_effort"][:7].all() and not harness.arm.control.motion.effort[:6].any()
    refused = harness.send("servo_cs", (*goal, *zero, *wrench, 0, 1, 0))
    assert refused.outcomes == ["refused"] and "needs a pose" in refused.replies[0][1]


def test_impedance_pulls_back_harder_the_further_it_is_pushed(harness: ArmHarness) -> None:
    gains = np.zeros((2, 4, 6))
    gains[:, 0, :3] = -200.0
    gains[0, 3, 0] = 0.001  # dead-band for positive errors along x
    gains[1, 2, 0] = 0.5  # bias for negative ones
    place = pose(harness)
    place[:3] -= (0.003, 0.002, 0.0)
    command = np.concatenate([place[:3], STRAIGHT, place[3:], gains.ravel()])
    assert len(command) == COUNT and harness.send("servo_ci", command).outcomes == ["done"]
    rotation = matrix_from_pose(pose(harness))[:3, :3]
    force = np.array((-200.0 * 0.002, -200.0 * 0.002, 0.0))
    body = np.concatenate([rotation.T @ force, np.zeros(3)])
    assert harness.arm.control.motion.effort[:6] == pytest.approx(harness.state["jacobian"][:, :6].T @ body, abs=1e-6)


def test_impedance_turns_the_tip_back(harness: ArmHarness) -> None:
    gains = np.zeros((2, 4, 6))
    gains[:, 0, 3:] = -0.5
    turned = turned_about_z(pose(harness), -0.2)  # so the tip is 0.2 about z ahead
    harness.send("servo_ci", np.concatenate([pose(harness)[:3], STRAIGHT, turned[3:], gains.ravel()]))
    body = np.array((0.0, 0.0, 0.0, 0.0, 0.0, -0.1))
    assert harness.arm.control.motion.effort[:6] == pytest.approx(harness.state["jacobian"][:, :6].T @ body, abs=1e-6)


def test_joint_velocities_go_on_for_a_tenth_of_a_second_and_stop_at_limits(harness: ArmHarness) -> None:
    start = harness.io.setpoint[0]
    for _ in range(100):
        harness.send("servo_jv", (0.5, 0.0, 0.0, 0.0, 0.0, 0.0))
    assert harness.io.setpoint[0] - start == pytest.approx(0.5 * 100 * harness.period_ns / SECOND, rel=0.03)
    harness.run(0.5)
    held = harness.io.setpoint[0]
    assert held - start == pytest.approx(0.5 * (0.1 + 100 * harness.period_ns / SECOND), rel=0.05)
    harness.run(0.2)
    assert harness.io.setpoint[0] == held and not harness.setpoint["has_velocity"]
    for _ in range(1000):
        harness.send("servo_jv", (0.0, 0.0, 0.1, 0.0, 0.0, 0.0))
    assert harness.io.setpoint[2] == pytest.approx(0.24)


def test_a_process_that_was_stopped_does_not_catch_up_with_joint_velocities(harness: ArmHarness) -> None:
    harness.send("servo_jv", (0.5, 0.0, 0.0, 0.0, 0.0, 0.0))
    before = harness.io.setpoint[0]
    harness.now_ns += 90_000_000  # shorter than the stream may pause
    harness.step()
    harness.step()
    assert harness.io.setpoint[0] - before < 0.5 * 0.01


def test_a_move_out_of_reach_leaves_an_arm_that_pushes_as_it_is(harness: ArmHarness) -> None:
    wrench = np.array((0.0, 0.0, 1.0, 0.0, 0.0, 0.0))
    harness.send("body/servo_cf", wrench)
    for name in ("move_cp", "move_cr"):
        assert harness.send(name, (5.0, 5.0, -0.1, *STRAIGHT)).outcomes == ["refused"]
    harness.run(0.01)
    assert harness.state["control_mode"] == 3 and harness.setpoint["in_effort"][:7].all()
    assert harness.arm.control.motion.effort[:6] == pytest.approx(harness.state["jacobian"][:, :6].T @ wrench)


def test_an_arm_that_is_paused_while_it_pushes_holds_under_the_tracking_check(harness: ArmHarness) -> None:
    harness.send("free")
    harness.run(0.05)
    assert not harness.io.flag("tracking_check")
    harness.state_command("pause")
    harness.run(0.3)
    assert harness.arm.state == "PAUSED" and not harness.setpoint["in_effort"].any()
    assert harness.io.flag("tracking_check")


def test_a_client_that_falls_silent_is_held_when_that_is_asked_for() -> None:
    harness = bent(client_timeout_s=0.1)
    harness.send("body/servo_cf", (0.0, 0.0, 1.0, 0.0, 0.0, 0.0))
    harness.run(0.05)
    assert harness.setpoint["in_effort"][:7].all()
    harness.run(0.1)
    assert not harness.setpoint["in_effort"].any() and harness.state["control_mode"] == 1
    assert harness.reports.of("warning")[-1][1] == "client-timeout"
    harness.reports.events.clear()
    harness.send("move_jp", BENT)
    harness.run(1.0)
    assert not harness.reports.of("warning")


def test_questions_are_answered_with_numbers(harness: ArmHarness) -> None:
    ask = harness.send("local/forward_kinematics", BENT)
    found = np.array([float(x) for x in ask.replies[0][1].strip("[]").split(",")])
    assert same_pose(found, pose(harness, "local_measured_cp"), 1e-9)
    ask = harness.send("inverse_kinematics", (*np.add(BENT, 0.02), *found))
    joints = [float(x) for x in ask.replies[0][1].strip("[]").split(",")]
    assert joints == pytest.approx(BENT, abs=1e-8)
    assert "incorrect number of joints" in harness.send("inverse_kinematics", found).replies[0][1]
    assert "inverse kinematics failed" in harness.send("inverse_kinematics",
                                                       (*BENT, 5.0, 0, 0, *STRAIGHT)).replies[0][1]
    assert harness.send("forward_kinematics", (0.0,) * 7).outcomes == ["refused"]
    first = harness.send("forward_kinematics", (0.3,)).replies[0][1]
    assert len(first.strip("[]").split(",")) == 7
    assert harness.send("crtk_version").replies == [("done", "1.1.0")]
    assert harness.send("actuator_to_joint_position", (0.0,) * 6).outcomes == ["refused"]


def test_the_published_pose_is_that_of_the_frame(harness: ArmHarness) -> None:
    tip = matrix_from_pose(pose(harness, "local_measured_cp"))
    assert pose_from_matrix(tip) == pytest.approx(pose(harness))


def test_a_frame_with_two_uses_is_named_once(harness: ArmHarness) -> None:
    cartesian = harness.arm.control.cartesian
    cartesian.name_frame(cartesian.local_frame)
    with pytest.raises(CommandRefused) as refused:
        cartesian.is_local("world")
    assert str(refused.value).count(cartesian.local_frame) == 1
