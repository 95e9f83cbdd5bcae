"""A master on a PSM: states, mapping, clutch, jaw, locks; on a fake clock."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.teleop.harness import PERIOD_NS, SECOND, TeleopHarness
from trocar.procs.kinematics.poses import angle_between

DEGREE = math.pi / 180
TWISTED = (0.1, 0.0, 0.2, 0.0, 0.0, math.sin(0.4), math.cos(0.4))


@pytest.fixture
def harness() -> TeleopHarness:
    made = TeleopHarness()
    made.slave.pose = (0.0, 0.0, -0.1, 0.0, 0.0, 0.0, 1.0)
    return made


def test_it_aligns_the_master_and_then_follows(harness: TeleopHarness) -> None:
    harness.master.pose = TWISTED
    harness.state_command("enable")
    harness.run(0.1)
    assert harness.reports.of("current_state") == ["SETTING_ARMS_STATE", "ALIGNING_MTM", "ENABLED"]
    moved = harness.master.asked("move_cp")[0][1]
    assert moved == pytest.approx((0.1, 0.0, 0.2, 0, 0, 0, 1))
    assert harness.master.words()[-4:] == ["move_cp", "use_gravity_compensation", "body/servo_cf",
                                           "unlock_orientation"]
    assert harness.following and harness.text("state") == "ENABLED" and not harness.text("reason")


def test_the_slave_goes_a_fifth_of_the_way_with_its_velocity(harness: TeleopHarness) -> None:
    harness.follow()
    harness.master.ring.set(measured_cv=(0.1, -0.05, 0.2, 1, 2, 3))
    harness.lead(0.010, -0.005, 0.020)
    _, values, _ = harness.slave.asked("servo_cp")[-1]
    assert values[:3] == pytest.approx((0.002, -0.001, -0.096))
    assert values[7:] == pytest.approx((0.02, -0.01, 0.04, 0, 0, 0))
    harness.lead(turn=0.3, axis=2)
    goal = np.array(harness.slave.asked("servo_cp")[-1][1][:7])
    assert angle_between(np.array((0, 0, 0, 0, 0, 0, 1.0)), goal) == pytest.approx(0.3)
    assert harness.record.field("goal_cp")[:3] == pytest.approx((0.002, -0.001, -0.096))


def test_arms_are_enabled_and_then_homed(harness: TeleopHarness) -> None:
    harness.slave.ring.set(state=b"DISABLED", sub_state=b"DISABLED", is_homed=False)
    harness.state_command("enable")
    harness.run(0.01)
    assert harness.slave.words()[:2] == ["enable", "home"]
    assert harness.following


def test_arms_that_do_not_come_time_out(harness: TeleopHarness) -> None:
    harness.slave.obeys = False
    harness.slave.ring.set(state=b"DISABLED", sub_state=b"POWERING", is_homed=False)
    harness.state_command("enable")
    harness.step()
    assert harness.text("reason") == "waiting: PSM1 is POWERING; must be ENABLED and homed"
    harness.teleop.entered_ns -= 59 * SECOND
    harness.run(0.99)
    assert not harness.reports.of("error")
    harness.run(0.02)
    assert harness.reports.of("error") == ["MTMR_PSM1: timed out while setting up PSM1 state, it is POWERING"]
    assert harness.text("state") == harness.text("desired_state") == "DISABLED"
    assert harness.slave.words() == ["enable"]


def test_it_says_how_far_the_master_is_off(harness: TeleopHarness) -> None:
    harness.master.refuses["move_cp"] = "unable to solve inverse kinematics"
    harness.master.turn(1, 7.3 * DEGREE)
    harness.state_command("enable")
    harness.run(0.05)
    assert harness.text("reason").startswith("waiting: MTMR 7.3° off, tolerance 5° (MTMR: unable to solve")
    assert harness.record.field("angle_error") == pytest.approx(7.3 * DEGREE)
    harness.run(2.0)
    assert len(harness.reports.of("warning")) == 1 and "7.3° off" in harness.reports.of("warning")[0]
    assert len(harness.master.asked("move_cp")) == 5  # tried again
    del harness.master.refuses["move_cp"]
    harness.run(0.6)
    assert harness.following


def test_presence_is_shown_by_the_gripper() -> None:
    harness = TeleopHarness(start_gripper_threshold=40 * DEGREE)
    harness.state_command("enable")
    harness.run(0.01)
    assert harness.text("reason") == "waiting: pinch or twist MTMR's gripper a bit"
    harness.master.ring.set(gripper_position=0.5)
    harness.run(0.01)
    assert not harness.following
    harness.master.ring.set(gripper_position=0.8)
    harness.run(0.01)
    assert harness.following


def test_align_only_waits_and_shows_why(harness: TeleopHarness) -> None:
    harness.state_command("align_MTM")
    harness.run(0.1)
    assert harness.text("state") == "ALIGNING_MTM" and not harness.following
    assert harness.text("reason") == "waiting: asked to align only, not to follow"
    harness.slave.turn(0, 6 * DEGREE)
    harness.run(0.01)
    assert len(harness.master.asked("move_cp")) == 2


def test_without_alignment_the_master_stays_where_it_is() -> None:
    harness = TeleopHarness(align_mtm=False)
    harness.master.pose = TWISTED
    harness.follow()
    assert not harness.master.asked("move_cp")
    harness.step()
    goal = harness.slave.asked("servo_cp")[-1][1]
    assert goal[3:7] == pytest.approx((0, 0, 0, 1))


def test_changes_of_scale_and_locks_move_nothing(harness: TeleopHarness) -> None:
    harness.follow()
    harness.lead(0.01, 0.02, 0.03, turn=0.2)
    before = harness.slave.pose
    for command, value in (("set_scale", 0.7), ("lock_rotation", 1), ("lock_translation", 1), ("lock_translation", 0)):
        assert harness.send(command, value).outcomes == ["done"]
        harness.step()
        assert harness.slave.pose == pytest.approx(before, abs=1e-9)
    harness.lead(0.01, 0, 0, turn=0.2)
    assert harness.slave.pose[3:] == pytest.approx(before[3:], abs=1e-9)
    assert harness.slave.pose[0] == pytest.approx(before[0] + 0.007)
    assert "lock_orientation" in harness.master.words()


def test_unlocking_the_rotation_aligns_again(harness: TeleopHarness) -> None:
    harness.follow()
    harness.send("lock_rotation", 1)
    harness.lead(turn=0.5)
    harness.reports.reported.clear()
    harness.send("lock_rotation", 0)
    harness.run(0.1)
    assert harness.reports.of("current_state") == ["DISABLED", "SETTING_ARMS_STATE", "ALIGNING_MTM", "ENABLED"]
    assert harness.master.asked("move_cp")


def test_the_clutch_holds_the_slave_and_goes_on_without_a_jump() -> None:
    harness = TeleopHarness(start_gripper_threshold=40 * DEGREE)
    harness.state_command("enable")
    harness.run(0.01)
    harness.master.ring.set(gripper_position=1.0)
    harness.run(0.01)
    assert harness.following
    harness.forget()
    before = harness.slave.pose
    harness.send("clutch", 1)
    assert not harness.following and harness.text("state") == "ENABLED"
    assert harness.text("reason") == "the clutch is pressed"
    assert "end_stream" in harness.slave.words()
    assert harness.master.words() == ["use_gravity_compensation", "body/servo_cf", "lock_orientation"]
    harness.forget()
    harness.lead(0.1, 0.0, 0.0)
    assert not harness.slave.sent and harness.slave.pose == pytest.approx(before)
    harness.send("clutch", 0)
    harness.run(0.01)
    assert harness.following  # presence need not be shown again
    assert harness.slave.pose == pytest.approx(before, abs=1e-9)
    harness.lead(0.01, 0.0, 0.0)
    assert harness.slave.pose[0] == pytest.approx(before[0] + 0.002)


def test_states_desires_and_the_clutch_are_told(harness: TeleopHarness) -> None:
    harness.state_command("enable")
    harness.run(0.01)
    harness.send("clutch", 1)
    harness.send("clutch", 0)
    harness.run(0.01)
    harness.state_command("disable")
    harness.run(0.002)
    states = ("SETTING_ARMS_STATE", "ALIGNING_MTM", "ENABLED")
    entered = [f"current state is {state}" for state in states]
    assert [text.removeprefix("MTMR_PSM1: ") for text in harness.reports.of("status")] == [
        "set desired state to ENABLED", *entered, "console clutch pressed", "console clutch released", *entered,
        "set desired state to DISABLED", "current state is DISABLED"]


def test_a_click_of_the_clutch_takes_no_presence_away(harness: TeleopHarness) -> None:
    harness.follow()
    harness.send("clutch", 2)
    harness.run(0.01)
    assert harness.following
    assert harness.reports.of("current_state") == ["SETTING_ARMS_STATE", "ALIGNING_MTM", "ENABLED"]


def test_the_clutch_lets_go_of_a_disabled_master_too(harness: TeleopHarness) -> None:
    harness.step()
    harness.send("clutch", 1)
    assert "body/servo_cf" in harness.master.words() and not harness.slave.sent, "others may use it"
    assert harness.text("reason") == "the clutch is pressed"
    harness.send("clutch", 0)
    assert harness.master.words()[-1] == "end_stream" and harness.text("state") == "DISABLED"
    assert not harness.text("reason")


def test_the_jaw_follows_slowly_until_it_has_caught_up(harness: TeleopHarness) -> None:
    harness.slave.ring.set(jaw_setpoint_position=80 * DEGREE)
    harness.follow()
    began = harness.now_ns - 18 * PERIOD_NS  # of those steps 18 were in ENABLED
    while harness.slave.ring.field("jaw_setpoint_position") > 1e-9:
        harness.step()
    assert (harness.now_ns - began) / SECOND == pytest.approx(1.614, abs=0.005)


def test_jaws_are_left_alone_where_they_are_ignored() -> None:
    harness = TeleopHarness(ignore_jaw=True)
    harness.slave.ring.set(has_jaw=False)
    harness.follow()
    harness.step()
    assert not harness.slave.asked("jaw/servo_jp")


def test_a_slave_without_a_jaw_is_refused_in_words(harness: TeleopHarness) -> None:
    harness.slave.ring.set(has_jaw=False)
    harness.state_command("enable")
    harness.run(0.01)
    assert harness.text("state") == "DISABLED"
    assert harness.reports.of("error") == ["MTMR_PSM1: PSM1 has no jaw"]


def test_a_base_that_moves_is_made_up_for() -> None:
    harness = TeleopHarness(base=True)
    assert harness.base is not None
    harness.base.set(measured_cp=(0, 0, 0, 0, 0, 0, 1))
    harness.state_command("enable")
    harness.run(0.01)
    assert harness.text("reason") == "waiting: the pose of ECM in its reference frame is not known"
    harness.base.set(reference_valid=True)
    harness.follow()
    harness.base.set(measured_cp=(0.01, 0, 0, 0, 0, 0, 1))
    harness.step()
    assert harness.slave.pose[0] == pytest.approx(-0.01)


def test_a_set_up_arm_that_moves_is_made_up_for_and_its_clutch_ends_following() -> None:
    harness = TeleopHarness(setup=1)
    assert harness.base is not None
    harness.base.field("measured_cp")[:] = (0, 0, 0, 0, 0, 0, 1)
    harness.base.field("base_valid")[0] = True
    harness.state_command("enable")
    harness.run(0.01)
    assert harness.text("reason") == "waiting: the pose of SUJ in its reference frame is not known"
    harness.base.field("base_valid")[1] = True
    harness.follow()
    harness.base.field("measured_cp")[1, 0] = 0.01
    harness.step()
    assert harness.slave.pose[0] == pytest.approx(-0.01)
    harness.base.field("base_valid")[1] = False
    harness.step()
    assert not harness.following and harness.text("state") == "DISABLED"


@pytest.mark.parametrize("base", [math.nan, math.inf])
def test_a_base_that_is_no_pose_ends_following(base: float) -> None:
    harness = TeleopHarness(base=True)
    assert harness.base is not None
    harness.base.set(measured_cp=(0, 0, 0, 0, 0, 0, 1), reference_valid=True)
    harness.follow()
    harness.base.set(measured_cp=(base, 0, 0, 0, 0, 0, 1))
    harness.step()
    assert not harness.following and not harness.slave.asked("servo_cp")


def test_a_wrench_is_given_on_while_following_and_ends_by_itself(harness: TeleopHarness) -> None:
    assert harness.send("following/mtm/body/servo_cf", 1, 2, 3, 0, 0, 0).outcomes == ["refused"]
    harness.follow()
    harness.send("following/mtm/body/servo_cf", 1, 2, 3, 0, 0, 0)
    harness.step()
    assert [one[1] for one in harness.master.asked("body/servo_cf")] == [(1, 2, 3, 0, 0, 0, 0.03)] * 2
    harness.send("clutch", 1)
    assert harness.master.asked("body/servo_cf")[-1][1] == (0,) * 6
    harness.send("clutch", 0)
    harness.run(0.01)
    assert harness.following
    harness.forget()
    harness.step()
    assert not harness.master.asked("body/servo_cf")


def test_a_wrench_that_is_not_given_again_ends(harness: TeleopHarness) -> None:
    harness.follow()
    harness.forget()
    for _ in range(5):
        harness.send("following/mtm/body/servo_cf", 1, 2, 3, 0, 0, 0)
        harness.run(0.05)
    assert {one[1] for one in harness.master.asked("body/servo_cf")} == {(1, 2, 3, 0, 0, 0, 0.03)}
    harness.run(0.06)
    assert harness.master.asked("body/servo_cf")[-1][1] == (0,) * 6 and harness.following
    harness.forget()
    harness.send("following/mtm/body/servo_cf", *(0,) * 6)
    harness.run(0.5)
    assert [one[1] for one in harness.master.asked("body/servo_cf")] == [(0.0,) * 6 + (0.03,)], "none at all lasts"


def test_a_master_that_another_program_moves_is_not_let_go_again(harness: TeleopHarness) -> None:
    harness.settings["start_gripper_threshold"] = 0.5
    harness.start()
    harness.state_command("enable")
    harness.run(0.01)
    harness.master.ring.set(gripper_position=0.6)
    harness.run(0.1)
    assert harness.following
    harness.forget()
    harness.master.ring.set(control_mode=2)
    harness.run(0.1)
    assert not harness.following and harness.text("state") == "ALIGNING_MTM"
    assert harness.reports.of("warning")[0] == "MTMR_PSM1: MTMR is moved or held by another program"
    assert "body/servo_cf" not in harness.master.words()


@pytest.mark.parametrize("which", ["MTMR", "PSM1"])
@pytest.mark.parametrize("is_clutched", [False, True])
def test_whoever_else_stops_its_master_or_slave_ends_it(harness: TeleopHarness, which: str, is_clutched: bool) -> None:
    harness.follow()
    if is_clutched:
        harness.send("clutch", 1)
    harness.arms[which].stop("plan.py")
    harness.step()
    assert not harness.following and harness.text("state") == "DISABLED"
    assert harness.text("reason") == f"plan.py (hold) stopped {which}"
    assert harness.reports.of("warning") == [f"MTMR_PSM1: plan.py (hold) stopped {which}"]
    harness.forget()
    harness.run(0.2)
    assert not harness.master.sent and not harness.slave.sent


def test_a_stop_before_it_was_asked_for_does_not_count(harness: TeleopHarness) -> None:
    harness.slave.stop("plan.py")
    harness.step()
    harness.follow()
    assert harness.following


def test_masters_that_only_show_poses_are_asked_for_nothing() -> None:
    harness = TeleopHarness(mtm_is_haptic=False, align_mtm=False)
    harness.master.pose = TWISTED
    harness.follow()
    harness.send("clutch", 1)
    harness.send("clutch", 0)
    harness.run(0.01)
    assert harness.following and not harness.master.sent
    assert harness.send("set_align_MTM", 1).outcomes == ["refused"]


def test_why_the_slave_does_not_obey_is_shown(harness: TeleopHarness) -> None:
    harness.follow()
    harness.slave.refuses["servo_cp"] = "servo_cp: unable to solve inverse kinematics (too far)"
    harness.run(0.005)
    assert harness.text("reason") == "PSM1: servo_cp: unable to solve inverse kinematics (too far)"
    assert harness.following


@pytest.mark.parametrize(
    ("name", "values", "text"),
    [("state_command", (), "Enable"), ("state_command", (1.0,), "enable"), ("set_scale", (0.0,), ""),
     ("set_scale", (math.nan,), ""), ("lock_rotation", (0.5,), ""), ("clutch", (3.0,), ""), ("fly", (), "")],
)
def test_what_makes_no_sense_is_refused_with_a_warning(harness: TeleopHarness, name: str, values: tuple[float, ...],
                                                      text: str) -> None:
    harness.follow()
    answer = harness.send(name, *values, text=text)
    assert answer.outcomes == ["refused"] and harness.reports.of("warning")
    harness.step()
    assert harness.following


def test_the_roll_of_the_alignment_itself_is_no_presence() -> None:
    harness = TeleopHarness(start_gripper_threshold=0.7)
    harness.master.obeys = False  # it takes its time
    harness.state_command("enable")
    harness.master.ring.set(is_busy=True)
    for _ in range(20):
        harness.master.turn(0, 0.01)
        harness.run(0.002)
    harness.master.ring.set(is_busy=False)
    harness.run(0.01)
    assert not harness.record.field("operator_active") and harness.record.field("roll_range") == 0.0


def test_the_master_is_let_go_in_the_cycle_in_which_following_begins(harness: TeleopHarness) -> None:
    harness.state_command("enable")
    while not harness.following:
        harness.forget()
        harness.step()
    assert harness.master.words() == ["use_gravity_compensation", "body/servo_cf", "unlock_orientation"]
