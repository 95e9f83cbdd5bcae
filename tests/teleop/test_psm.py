"""A master on a PSM: states, mapping, clutch, jaw, locks; on a fake clock."""

from __future__ import annotations

import math

import numpy as np
import pytest

from procs.kinematics.poses import angle_between
from tests.teleop.harness import PERIOD_NS, SECOND, Theatre

DEGREE = math.pi / 180
TWISTED = (0.1, 0.0, 0.2, 0.0, 0.0, math.sin(0.4), math.cos(0.4))


@pytest.fixture
def theatre() -> Theatre:
    made = Theatre()
    made.slave.pose = (0.0, 0.0, -0.1, 0.0, 0.0, 0.0, 1.0)
    return made


def test_it_aligns_the_master_and_then_follows(theatre: Theatre) -> None:
    theatre.master.pose = TWISTED
    theatre.state_command("enable")
    theatre.run(0.01)
    assert theatre.reports.of("current_state") == ["SETTING_ARMS_STATE", "ALIGNING_MTM", "ENABLED"]
    moved = theatre.master.asked("move_cp")[0][1]
    assert moved == pytest.approx((0.1, 0.0, 0.2, 0, 0, 0, 1))
    assert theatre.master.words()[-4:] == ["move_cp", "body/servo_cf", "use_gravity_compensation",
                                           "unlock_orientation"]
    assert theatre.following and theatre.text("state") == "ENABLED" and not theatre.text("reason")


def test_the_slave_goes_a_fifth_of_the_way_with_its_velocity(theatre: Theatre) -> None:
    theatre.follow()
    theatre.master.ring.set(measured_cv=(0.1, -0.05, 0.2, 1, 2, 3))
    theatre.master.shift(0.010, -0.005, 0.020)
    theatre.step()
    _, values, _ = theatre.slave.asked("servo_cp")[-1]
    assert values[:3] == pytest.approx((0.002, -0.001, -0.096))
    assert values[7:] == pytest.approx((0.02, -0.01, 0.04, 0, 0, 0))
    theatre.master.turn(2, 0.3)
    theatre.step()
    goal = np.array(theatre.slave.asked("servo_cp")[-1][1][:7])
    assert angle_between(np.array((0, 0, 0, 0, 0, 0, 1.0)), goal) == pytest.approx(0.3)
    assert theatre.record.field("goal_cp")[:3] == pytest.approx((0.002, -0.001, -0.096))


def test_arms_are_enabled_and_then_homed(theatre: Theatre) -> None:
    theatre.slave.ring.set(state=b"DISABLED", sub_state=b"DISABLED", is_homed=False)
    theatre.state_command("enable")
    theatre.run(0.01)
    assert theatre.slave.words()[:2] == ["enable", "home"]
    assert theatre.following


def test_arms_that_do_not_come_time_out(theatre: Theatre) -> None:
    theatre.slave.obeys = False
    theatre.slave.ring.set(state=b"DISABLED", sub_state=b"POWERING", is_homed=False)
    theatre.state_command("enable")
    theatre.step()
    assert theatre.text("reason") == "waiting: PSM1 is POWERING; must be ENABLED and homed"
    theatre.teleop.entered_ns -= 59 * SECOND
    theatre.run(0.99)
    assert not theatre.reports.of("error")
    theatre.run(0.02)
    assert theatre.reports.of("error") == ["MTMR_PSM1: timed out while setting up PSM1 state, it is POWERING"]
    assert theatre.text("state") == theatre.text("desired_state") == "DISABLED"
    assert theatre.slave.words() == ["enable"]


def test_it_says_how_far_the_master_is_off(theatre: Theatre) -> None:
    theatre.master.refuses["move_cp"] = "unable to solve inverse kinematics"
    theatre.master.turn(1, 7.3 * DEGREE)
    theatre.state_command("enable")
    theatre.run(0.05)
    assert theatre.text("reason").startswith("waiting: MTMR 7.3° off, tolerance 5° (MTMR: unable to solve")
    assert theatre.record.field("angle_error") == pytest.approx(7.3 * DEGREE)
    theatre.run(2.0)
    assert len(theatre.reports.of("warning")) == 1 and "7.3° off" in theatre.reports.of("warning")[0]
    assert len(theatre.master.asked("move_cp")) == 5  # tried again
    del theatre.master.refuses["move_cp"]
    theatre.run(0.6)
    assert theatre.following


def test_presence_is_shown_by_the_gripper() -> None:
    theatre = Theatre(start_gripper_threshold=40 * DEGREE)
    theatre.state_command("enable")
    theatre.run(0.01)
    assert theatre.text("reason") == "waiting: pinch or twist MTMR's gripper a bit"
    theatre.master.ring.set(gripper_position=0.5)
    theatre.run(0.01)
    assert not theatre.following
    theatre.master.ring.set(gripper_position=0.8)
    theatre.run(0.01)
    assert theatre.following


def test_align_only_waits_and_shows_why(theatre: Theatre) -> None:
    theatre.state_command("align_MTM")
    theatre.run(0.1)
    assert theatre.text("state") == "ALIGNING_MTM" and not theatre.following
    assert theatre.text("reason") == "waiting: asked to align only, not to follow"
    theatre.slave.turn(0, 6 * DEGREE)
    theatre.run(0.01)
    assert len(theatre.master.asked("move_cp")) == 2


def test_without_alignment_the_master_stays_where_it_is() -> None:
    theatre = Theatre(align_mtm=False)
    theatre.master.pose = TWISTED
    theatre.follow()
    assert not theatre.master.asked("move_cp")
    theatre.step()
    goal = theatre.slave.asked("servo_cp")[-1][1]
    assert goal[3:7] == pytest.approx((0, 0, 0, 1))


def test_changes_of_scale_and_locks_move_nothing(theatre: Theatre) -> None:
    theatre.follow()
    theatre.master.shift(0.01, 0.02, 0.03)
    theatre.master.turn(0, 0.2)
    theatre.step()
    before = theatre.slave.pose
    for command, value in (("set_scale", 0.7), ("lock_rotation", 1), ("lock_translation", 1), ("lock_translation", 0)):
        assert theatre.send(command, value).outcomes == ["done"]
        theatre.step()
        assert theatre.slave.pose == pytest.approx(before, abs=1e-9)
    theatre.master.turn(0, 0.2)
    theatre.master.shift(0.01, 0, 0)
    theatre.step()
    assert theatre.slave.pose[3:] == pytest.approx(before[3:], abs=1e-9)
    assert theatre.slave.pose[0] == pytest.approx(before[0] + 0.007)
    assert "lock_orientation" in theatre.master.words()


def test_unlocking_the_rotation_aligns_again(theatre: Theatre) -> None:
    theatre.follow()
    theatre.send("lock_rotation", 1)
    theatre.master.turn(0, 0.5)
    theatre.reports.said.clear()
    theatre.send("lock_rotation", 0)
    theatre.run(0.01)
    assert theatre.reports.of("current_state") == ["DISABLED", "SETTING_ARMS_STATE", "ALIGNING_MTM", "ENABLED"]
    assert theatre.master.asked("move_cp")


def test_the_clutch_holds_the_slave_and_goes_on_without_a_jump() -> None:
    theatre = Theatre(start_gripper_threshold=40 * DEGREE)
    theatre.state_command("enable")
    theatre.run(0.01)
    theatre.master.ring.set(gripper_position=1.0)
    theatre.run(0.01)
    assert theatre.following
    theatre.forget()
    before = theatre.slave.pose
    theatre.send("clutch", 1)
    assert not theatre.following and theatre.text("state") == "ENABLED"
    assert theatre.text("reason") == "the clutch is pressed"
    assert "hold" in theatre.slave.words()
    assert theatre.master.words() == ["body/servo_cf", "use_gravity_compensation", "lock_orientation"]
    theatre.forget()
    theatre.master.shift(0.1, 0.0, 0.0)
    theatre.run(0.1)
    assert not theatre.slave.sent and theatre.slave.pose == pytest.approx(before)
    theatre.send("clutch", 0)
    theatre.run(0.01)
    assert theatre.following  # presence need not be shown again
    assert theatre.slave.pose == pytest.approx(before, abs=1e-9)
    theatre.master.shift(0.01, 0.0, 0.0)
    theatre.step()
    assert theatre.slave.pose[0] == pytest.approx(before[0] + 0.002)


def test_states_desires_and_the_clutch_are_told(theatre: Theatre) -> None:
    theatre.state_command("enable")
    theatre.run(0.01)
    theatre.send("clutch", 1)
    theatre.send("clutch", 0)
    theatre.run(0.01)
    theatre.state_command("disable")
    theatre.run(0.002)
    states = ("SETTING_ARMS_STATE", "ALIGNING_MTM", "ENABLED")
    entered = [f"current state is {state}" for state in states]
    assert [text.removeprefix("MTMR_PSM1: ") for text in theatre.reports.of("status")] == [
        "set desired state to ENABLED", *entered, "console clutch pressed", "console clutch released", *entered,
        "set desired state to DISABLED", "current state is DISABLED"]


def test_a_click_of_the_clutch_takes_no_presence_away(theatre: Theatre) -> None:
    theatre.follow()
    theatre.send("clutch", 2)
    theatre.run(0.01)
    assert theatre.following
    assert theatre.reports.of("current_state") == ["SETTING_ARMS_STATE", "ALIGNING_MTM", "ENABLED"]


def test_the_clutch_lets_go_of_a_disabled_master_too(theatre: Theatre) -> None:
    theatre.step()
    theatre.send("clutch", 1)
    assert "body/servo_cf" in theatre.master.words() and "hold" in theatre.slave.words()
    theatre.send("clutch", 0)
    assert theatre.master.words()[-1] == "hold" and theatre.text("state") == "DISABLED"


def test_the_jaw_follows_slowly_until_it_has_caught_up(theatre: Theatre) -> None:
    theatre.slave.ring.set(jaw_setpoint_position=80 * DEGREE)
    theatre.follow()
    began = theatre.now_ns - 18 * PERIOD_NS  # of those steps 18 were in ENABLED
    while theatre.slave.ring.field("jaw_setpoint_position") > 1e-9:
        theatre.step()
    assert (theatre.now_ns - began) / SECOND == pytest.approx(1.614, abs=0.005)


def test_jaws_are_left_alone_where_they_are_ignored() -> None:
    theatre = Theatre(ignore_jaw=True)
    theatre.slave.ring.set(has_jaw=False)
    theatre.follow()
    theatre.step()
    assert not theatre.slave.asked("jaw/servo_jp")


def test_a_slave_without_a_jaw_is_refused_in_words(theatre: Theatre) -> None:
    theatre.slave.ring.set(has_jaw=False)
    theatre.state_command("enable")
    theatre.run(0.01)
    assert theatre.text("state") == "DISABLED"
    assert theatre.reports.of("error") == ["MTMR_PSM1: PSM1 has no jaw"]


def test_a_base_that_moves_is_made_up_for() -> None:
    theatre = Theatre(base=True)
    assert theatre.base is not None
    theatre.base.set(measured_cp=(0, 0, 0, 0, 0, 0, 1))
    theatre.state_command("enable")
    theatre.run(0.01)
    assert theatre.text("reason") == "waiting: the pose of ECM in its reference frame is not known"
    theatre.base.set(reference_valid=True)
    theatre.follow()
    theatre.base.set(measured_cp=(0.01, 0, 0, 0, 0, 0, 1))
    theatre.step()
    assert theatre.slave.pose[0] == pytest.approx(-0.01)


def test_a_set_up_arm_that_moves_is_made_up_for_and_its_clutch_ends_following() -> None:
    theatre = Theatre(setup=1)
    assert theatre.base is not None
    theatre.base.field("measured_cp")[:] = (0, 0, 0, 0, 0, 0, 1)
    theatre.base.field("base_valid")[0] = True
    theatre.state_command("enable")
    theatre.run(0.01)
    assert theatre.text("reason") == "waiting: the pose of SUJ in its reference frame is not known"
    theatre.base.field("base_valid")[1] = True
    theatre.follow()
    theatre.base.field("measured_cp")[1, 0] = 0.01
    theatre.step()
    assert theatre.slave.pose[0] == pytest.approx(-0.01)
    theatre.base.field("base_valid")[1] = False
    theatre.step()
    assert not theatre.following and theatre.text("state") == "DISABLED"


@pytest.mark.parametrize("base", [math.nan, math.inf])
def test_a_base_that_is_no_pose_ends_following(base: float) -> None:
    theatre = Theatre(base=True)
    assert theatre.base is not None
    theatre.base.set(measured_cp=(0, 0, 0, 0, 0, 0, 1), reference_valid=True)
    theatre.follow()
    theatre.base.set(measured_cp=(base, 0, 0, 0, 0, 0, 1))
    theatre.step()
    assert not theatre.following and not theatre.slave.asked("servo_cp")


def test_a_wrench_is_given_on_while_following_and_ends_by_itself(theatre: Theatre) -> None:
    assert theatre.send("following/mtm/body/servo_cf", 1, 2, 3, 0, 0, 0).outcomes == ["refused"]
    theatre.follow()
    theatre.send("following/mtm/body/servo_cf", 1, 2, 3, 0, 0, 0)
    theatre.step()
    assert [one[1] for one in theatre.master.asked("body/servo_cf")] == [(1, 2, 3, 0, 0, 0, 0.03)] * 2
    theatre.send("clutch", 1)
    assert theatre.master.asked("body/servo_cf")[-1][1] == (0,) * 6
    theatre.send("clutch", 0)
    theatre.run(0.01)
    assert theatre.following
    theatre.forget()
    theatre.step()
    assert not theatre.master.asked("body/servo_cf")


def test_a_wrench_that_is_not_given_again_ends(theatre: Theatre) -> None:
    theatre.follow()
    theatre.forget()
    for _ in range(5):
        theatre.send("following/mtm/body/servo_cf", 1, 2, 3, 0, 0, 0)
        theatre.run(0.05)
    assert {one[1] for one in theatre.master.asked("body/servo_cf")} == {(1, 2, 3, 0, 0, 0, 0.03)}
    theatre.run(0.06)
    assert theatre.master.asked("body/servo_cf")[-1][1] == (0,) * 6 and theatre.following
    theatre.forget()
    theatre.send("following/mtm/body/servo_cf", *(0,) * 6)
    theatre.run(0.5)
    assert len(theatre.master.asked("body/servo_cf")) > 400, "none at all lasts"


def test_a_master_that_somebody_else_stopped_is_let_go_again(theatre: Theatre) -> None:
    theatre.follow()
    theatre.run(0.1)
    assert not theatre.master.sent
    theatre.master.ring.set(control_mode=1)
    theatre.step()
    assert theatre.master.words() == ["body/servo_cf", "use_gravity_compensation", "unlock_orientation"]


def test_masters_that_only_show_poses_are_asked_for_nothing() -> None:
    theatre = Theatre(mtm_is_haptic=False, align_mtm=False)
    theatre.master.pose = TWISTED
    theatre.follow()
    theatre.send("clutch", 1)
    theatre.send("clutch", 0)
    theatre.run(0.01)
    assert theatre.following and not theatre.master.sent
    assert theatre.send("set_align_MTM", 1).outcomes == ["refused"]


def test_why_the_slave_does_not_obey_is_shown(theatre: Theatre) -> None:
    theatre.follow()
    theatre.slave.refuses["servo_cp"] = "servo_cp: unable to solve inverse kinematics (too far)"
    theatre.run(0.005)
    assert theatre.text("reason") == "PSM1: servo_cp: unable to solve inverse kinematics (too far)"
    assert theatre.following


@pytest.mark.parametrize(
    ("name", "values", "text"),
    [("state_command", (), "Enable"), ("state_command", (1.0,), "enable"), ("set_scale", (0.0,), ""),
     ("set_scale", (math.nan,), ""), ("lock_rotation", (0.5,), ""), ("clutch", (3.0,), ""), ("fly", (), "")],
)
def test_what_makes_no_sense_is_refused_with_a_warning(theatre: Theatre, name: str, values: tuple[float, ...],
                                                      text: str) -> None:
    theatre.follow()
    answer = theatre.send(name, *values, text=text)
    assert answer.outcomes == ["refused"] and theatre.reports.of("warning")
    theatre.step()
    assert theatre.following


def test_the_roll_of_the_alignment_itself_is_no_presence() -> None:
    theatre = Theatre(start_gripper_threshold=0.7)
    theatre.master.obeys = False  # it takes its time
    theatre.state_command("enable")
    theatre.master.ring.set(is_busy=True)
    for _ in range(20):
        theatre.master.turn(0, 0.01)
        theatre.run(0.002)
    theatre.master.ring.set(is_busy=False)
    theatre.run(0.01)
    assert not theatre.record.field("operator_active") and theatre.record.field("roll_range") == 0.0
