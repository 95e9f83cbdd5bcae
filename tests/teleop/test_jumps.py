"""Nothing moves that the operator did not move, whatever happens to the slave or the records meanwhile."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests import stock
from tests.arm.fake_requests import FakeRequest
from tests.teleop.harness import EcmHarness, TeleopHarness
from tests.teleop.test_problems import show
from trocar.procs.kinematics.forward import Kinematics
from trocar.procs.kinematics.poses import pose_from_matrix
from trocar.procs.teleop.motion_check import MotionCheck

DEGREE = math.pi / 180


@pytest.fixture
def following() -> TeleopHarness:
    harness = TeleopHarness(start_gripper_threshold=0.5)
    harness.state_command("enable")
    show(harness)
    assert harness.following, harness.text("reason")
    harness.forget()
    return harness


@pytest.mark.parametrize("words", [("disable", "enable"), ("align_MTM", "enable")])
def test_who_is_stopped_and_asked_again_in_one_cycle_has_stopped(following: TeleopHarness,
                                                                 words: tuple[str, ...]) -> None:
    following.step(*(FakeRequest("state_command", (), word) for word in words))
    assert not following.following
    following.run(0.05)
    assert not following.following
    show(following)
    assert following.following


def test_an_error_is_not_outrun_by_a_command(following: TeleopHarness) -> None:
    following.slave.fail("PSM1: tracking error")
    following.state_command("enable")
    assert not following.following and "end_stream" in following.slave.words()
    following.run(0.05)
    assert not following.following


@pytest.mark.parametrize("which", ["MTMR", "PSM1"])
def test_an_arm_moved_by_hand_is_not_followed_with_or_by(following: TeleopHarness, which: str) -> None:
    arm = following.arms[which]
    arm.ring.set(sub_state=b"MANUAL", is_busy=True)
    following.step()
    assert not following.following and following.text("state") == "SETTING_ARMS_STATE"
    following.run(0.01)
    assert following.text("reason") == f"waiting: {which} is moved by hand"
    assert not following.slave.asked("state_command") and not following.reports.of("error")
    for _ in range(50):
        arm.shift(0.001, 0.0, 0.0)
        following.step()
    arm.ring.set(sub_state=b"HOMED", is_busy=False)
    following.run(0.05)
    assert not following.following
    before = following.slave.pose
    show(following)
    assert following.following and following.slave.pose == pytest.approx(before, abs=1e-9)


def test_what_a_slave_refused_is_not_caught_up_with(following: TeleopHarness) -> None:
    before = following.slave.pose
    following.slave.obeys = False
    following.slave.refuses["servo_cp"] = "the instrument needs to be inserted past the cannula"
    following.step()
    following.lead(0.1, 0.0, 0.0)
    following.slave.obeys = True
    following.slave.refuses.clear()
    following.run(0.02)
    assert following.following and following.slave.pose == pytest.approx(before, abs=1e-9)
    following.lead(0.01, 0.0, 0.0)
    assert following.following and following.slave.pose[0] == pytest.approx(before[0] + 0.002)


def test_another_instrument_ends_following(following: TeleopHarness) -> None:
    following.slave.ring.set(tool=b"MEGA")
    following.forget()
    following.step()
    assert not following.following and not following.slave.asked("servo_cp")
    assert following.text("reason") == "the instrument of PSM1 was changed"


def test_the_jaw_is_that_of_the_instrument_that_is_on_when_following_begins(following: TeleopHarness) -> None:
    following.state_command("align_MTM")
    following.slave.ring.set(tool=b"SMALL")
    following.run(0.01)
    following.state_command("enable")
    show(following)
    following.master.ring.set(gripper_position=60 * DEGREE)
    following.run(2.0)
    assert following.slave.ring.field("jaw_setpoint_position") == pytest.approx(30 * DEGREE)


@pytest.mark.parametrize("which", ["MTMR", "PSM1"])
def test_another_base_frame_ends_following(following: TeleopHarness, which: str) -> None:
    arm = following.arms[which]
    arm.ring.set(base_frame=(0.1, 0, 0, 0, 0, 0, 1))
    following.forget()
    following.step()
    assert not following.following and not following.slave.asked("servo_cp")
    assert following.reports.of("error") == [f"MTMR_PSM1: the base frame of {which} was changed"]
    following.run(0.05)
    assert not following.following
    show(following)
    assert following.following


def test_a_base_that_set_up_joints_carry_may_drift(following: TeleopHarness) -> None:
    for step in range(100):
        following.slave.ring.set(base_frame=(step * 0.0005, 0, 0, 0, 0, 0, 1))
        following.step()
    assert following.following


def test_a_master_that_turns_by_itself_shows_no_presence() -> None:
    harness = TeleopHarness(start_gripper_threshold=0.5)
    harness.master.obeys = False
    harness.master.turn(0, 30 * DEGREE)
    harness.master.ring.set(is_busy=True)
    harness.state_command("enable")
    for _ in range(30):
        harness.step()
        harness.master.turn(0, -1 * DEGREE)
    harness.master.ring.set(is_busy=False)
    harness.run(0.1)
    assert not harness.following and not harness.record.field("operator_active")
    harness.master.turn(0, 4.5 * DEGREE)
    harness.run(0.01)
    assert harness.following


def test_a_gripper_that_is_not_seen_any_more_leaves_the_jaw(following: TeleopHarness) -> None:
    following.master.ring.set(gripper_position=0.3)
    following.run(2.0)
    before = float(following.slave.ring.field("jaw_setpoint_position"))
    following.master.ring.set(gripper_valid=False)
    following.run(0.1)
    assert following.slave.ring.field("jaw_setpoint_position") == pytest.approx(before)
    following.master.ring.set(gripper_valid=True)
    following.run(0.1)
    assert following.slave.ring.field("jaw_setpoint_position") == pytest.approx(before)


def test_what_a_torn_record_of_the_camera_says_is_no_place_to_begin() -> None:
    harness = EcmHarness()
    harness.slave.ring.set(is_homed=False)
    harness.slave.obeys = False
    harness.state_command("enable")
    harness.run(0.01)
    harness.slave.ring.set(is_homed=True)
    harness.step()
    harness.send("clutch", 1)
    harness.slave.ring.torn = True
    harness.slave.ring.field("setpoint_position")[:4] = 7.0
    harness.send("clutch", 0)
    harness.run(0.003)
    harness.slave.ring.torn = False
    harness.slave.ring.field("setpoint_position")[:4] = (0.0, 0.0, 0.12, 0.0)
    harness.forget()
    harness.run(0.01)
    for _, goal, _ in harness.slave.asked("servo_jp"):
        assert np.allclose(goal, (0.0, 0.0, 0.12, 0.0), atol=1e-9)
    assert harness.following


def test_hands_that_cross_do_not_throw_the_camera_over() -> None:
    harness = EcmHarness()
    harness.state_command("enable")
    harness.run(0.01)
    assert harness.following
    last = np.array(harness.slave.asked("servo_jp")[-1][1])
    for _ in range(320):
        harness.arms["MTML"].shift(-0.001, 0, 0)
        harness.arms["MTMR"].shift(0.001, 0, 0)
        harness.step()
        goal = np.array(harness.slave.asked("servo_jp")[-1][1])
        assert np.abs(goal - last).max() < 0.1
        last = goal
    assert not harness.following and harness.text("reason")


@pytest.mark.parametrize("turns", [False, True])
def test_the_slave_does_not_follow_a_master_whose_encoder_jumps(following: TeleopHarness, turns: bool) -> None:
    before = following.slave.pose
    if turns:
        following.master.turn(2, 60 * DEGREE)
    else:
        following.master.shift(0.1, 0.0, 0.0)
    following.run(0.01)
    assert following.slave.pose == pytest.approx(before, abs=1e-12) and not following.following
    (reported,) = following.reports.of("error")
    assert reported.startswith("MTMR_PSM1: MTMR jumped by " + ("60°" if turns else "100 mm"))
    show(following)
    assert not following.following, "it is not believed so soon"
    following.run(0.5)
    show(following)
    assert following.following and following.slave.pose == pytest.approx(before, abs=1e-9), "from where it is now"
    following.lead(0.01, 0.0, 0.0)
    assert following.slave.pose[0] == pytest.approx(before[0] + 0.002)


@pytest.mark.parametrize("which", ["MTML", "MTMR"])
def test_the_camera_does_not_follow_a_master_whose_encoder_jumps(which: str) -> None:
    harness = EcmHarness().follow()
    before = harness.slave.ring.field("setpoint_position").copy()
    harness.arms[which].shift(0.0, 0.02, 0.0)
    harness.step()
    assert not harness.following and np.array_equal(harness.slave.ring.field("setpoint_position"), before)
    harness.run(0.6)
    assert harness.following and np.allclose(harness.slave.ring.field("setpoint_position"), before)


@pytest.mark.slow
def test_a_real_master_that_moves_all_its_joints_as_fast_as_it_can_is_believed(data: Callable[[str], Path]) -> None:
    kinematics = Kinematics(stock.chain("MTML"))
    rows = np.loadtxt(data("real/mtm_measured_one.csv"), delimiter=",")
    pose, twist = np.zeros(7), np.zeros(6)
    check, now_ns = MotionCheck("MTML", pose, twist), 0
    for row in rows:  # sampled unevenly: how it goes on from each follows from its speed there
        joints, speeds = row[:7], row[7:14]
        check.forget()
        for _ in range(5):
            now_ns += 1_000_000
            pose[...] = pose_from_matrix(kinematics.fk(joints, np.eye(4)))
            twist[...] = kinematics.body_jacobian(joints) @ speeds
            check.look(now_ns, now_ns, known=True)
            assert not check.fault
            joints = joints + 0.001 * speeds
