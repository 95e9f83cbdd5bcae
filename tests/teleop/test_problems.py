"""What ends teleoperation, and what it takes to go on; on a fake clock."""

from __future__ import annotations

import math

import pytest

from tests.teleop.harness import TeleopHarness
from trocar.procs.node.requests import STREAM_ENDED, STREAM_PAUSE_NS


@pytest.fixture
def harness() -> TeleopHarness:
    return TeleopHarness(start_gripper_threshold=0.5)


def show(harness: TeleopHarness) -> None:
    """The operator opens and closes the gripper."""
    harness.run(0.01)
    harness.master.ring.set(gripper_position=1.0)
    harness.run(0.01)
    harness.master.ring.set(gripper_position=0.0)
    harness.run(0.01)


@pytest.fixture
def following(harness: TeleopHarness) -> TeleopHarness:
    harness.state_command("enable")
    show(harness)
    assert harness.following, harness.text("reason")
    harness.forget()
    return harness


@pytest.mark.parametrize("which", ["MTMR", "PSM1"])
def test_an_error_of_an_arm_disables(following: TeleopHarness, which: str) -> None:
    following.arms[which].fail(f"{which}: tracking error")
    following.step()
    assert not following.following and following.text("state") == "DISABLED"
    assert following.reports.of("error") == [f"MTMR_PSM1: received from arm {which}: {which}: tracking error"]
    assert following.slave.words() == ["end_stream"]
    show(following)
    assert not following.following and following.text("desired_state") == "DISABLED"
    following.state_command("enable")
    following.run(0.05)
    assert not following.following
    show(following)
    assert following.following


def test_a_slave_at_its_limit_goes_on_following_and_says_so(following: TeleopHarness) -> None:
    following.slave.says |= {"servo_cp": "at its limit: insertion would be 0.3, above its limit 0.24",
                             "jaw/servo_jp": "clipped: jaw"}
    following.run(0.005)
    assert following.following and not following.reports.reported
    assert following.text("reason") == "PSM1 at its limit: insertion would be 0.3, above its limit 0.24"
    del following.slave.says["servo_cp"]
    following.run(0.12)
    assert following.following and following.text("reason") == ""


def test_a_master_without_a_model_of_its_weight_is_no_reason(harness: TeleopHarness) -> None:
    harness.master.refuses["use_gravity_compensation"] = "this arm has no gravity model"
    harness.state_command("enable")
    show(harness)
    assert harness.following and harness.text("reason") == ""


@pytest.mark.parametrize("which", ["MTMR", "PSM1"])
def test_a_goal_that_an_arm_cannot_reach_is_no_fault_of_it(following: TeleopHarness, which: str) -> None:
    following.arms[which].fail(f"{which}: move_cp: unable to solve inverse kinematics (far)", "inverse-kinematics")
    following.run(0.005)
    assert following.following and not following.reports.of("error")


@pytest.mark.parametrize(
    ("which", "change", "reason"),
    [("PSM1", {"state": b"FAULT", "sub_state": b"FAULT"}, 'PSM1 is not in state "ENABLED" anymore, it is FAULT'),
     ("MTMR", {"is_homed": False, "sub_state": b"ENABLED"}, "MTMR is not homed anymore"),
     ("MTMR", {"reference_valid": False}, "the pose of MTMR in its reference frame is not known")],
)
def test_arms_must_stay_homed(following: TeleopHarness, which: str, change: dict[str, object], reason: str) -> None:
    following.arms[which].ring.set(**change)
    following.run(0.002)
    assert not following.following and following.text("state") == "DISABLED"
    assert following.text("reason") == reason and following.reports.of("error") == [f"MTMR_PSM1: {reason}"]


def test_disable_stops_at_once(following: TeleopHarness) -> None:
    following.state_command("disable")
    assert not following.following and following.text("state") == "DISABLED"
    assert following.slave.words()[-1] == "end_stream" and following.master.words()[-1] == "end_stream"


def test_two_silent_arms_are_named_as_two(following: TeleopHarness) -> None:
    for arm in following.arms.values():
        arm.alive = False
    following.run(0.04)
    assert following.text("reason") == "waiting: MTMR, PSM1 are silent"


@pytest.mark.parametrize("which", ["MTMR", "PSM1"])
def test_a_silent_arm_ends_following_until_presence_is_shown(following: TeleopHarness, which: str) -> None:
    following.arms[which].alive = False
    following.run(0.029)
    assert following.following
    following.run(0.003)
    assert not following.following and following.text("state") == "SETTING_ARMS_STATE"
    assert following.text("reason") == f"waiting: {which} is silent"
    assert following.reports.of("error") == [f"MTMR_PSM1: {which} is silent"]
    show(following)
    assert not following.following
    following.arms[which].alive = True
    following.arms[which].ring.epoch += 1
    following.run(0.05)
    assert not following.following
    show(following)
    assert following.following


@pytest.mark.parametrize("which", ["MTMR", "PSM1"])
def test_an_arm_started_anew_ends_following(following: TeleopHarness, which: str) -> None:
    following.arms[which].ring.epoch += 1
    following.step()
    assert not following.following and following.reports.of("error") == [f"MTMR_PSM1: {which} was restarted"]


def test_an_arm_that_comes_back_without_power_is_left_alone(following: TeleopHarness) -> None:
    following.slave.alive = False
    following.run(0.05)
    following.slave.alive = True
    following.slave.ring.set(state=b"FAULT", sub_state=b"FAULT", is_homed=False)
    following.run(0.01)
    assert following.text("state") == "DISABLED" and not following.slave.asked("state_command")


def test_a_torn_record_is_waited_over(following: TeleopHarness) -> None:
    following.forget()
    following.master.ring.torn = True
    following.run(0.005)
    assert not following.slave.sent and following.following
    following.master.ring.torn = False
    following.step()
    assert following.slave.sent
    following.master.ring.torn = True
    following.run(0.035)
    assert not following.following


def absent(harness: TeleopHarness) -> None:
    assert harness.console is not None
    harness.console.set(operator_present=False)


def blind(harness: TeleopHarness) -> None:
    assert harness.console is not None
    harness.console.set(valid=False)


def restarted(harness: TeleopHarness) -> None:
    assert harness.console is not None
    harness.console.epoch += 1


@pytest.mark.parametrize("what", [absent, blind, restarted])
def test_an_absent_operator_ends_following_within_a_cycle(following: TeleopHarness, what) -> None:  # type: ignore[no-untyped-def]
    what(following)
    following.step()
    assert not following.following and following.text("state") == "ALIGNING_MTM"
    assert "end_stream" in following.slave.words() and not following.slave.asked("servo_cp")
    assert following.console is not None
    following.console.set(operator_present=True, valid=True)
    following.run(0.05)
    assert not following.following
    assert following.text("reason") == "waiting: pinch or twist MTMR's gripper a bit"
    show(following)
    assert following.following


def test_an_absent_operator_is_named_as_the_reason(following: TeleopHarness) -> None:
    absent(following)
    show(following)
    assert following.text("reason") == "waiting: console detects no operator"


def test_a_silent_console_ends_following(following: TeleopHarness) -> None:
    following.console_alive = False
    following.run(0.024)
    assert following.following
    following.run(0.004)
    assert not following.following
    show(following)
    assert not following.following and following.text("reason") == "waiting: console is silent"
    following.console_alive = True
    show(following)
    assert following.following


def test_a_clutch_released_unheard_is_released(following: TeleopHarness) -> None:
    following.send("clutch", 1)
    following.console_alive = False
    following.run(0.05)
    assert following.record.field("clutched")
    following.console_alive = True
    following.step()
    assert not following.record.field("clutched") and not following.following


def test_without_a_console_commands_are_enough() -> None:
    TeleopHarness(console=False).follow()


def test_a_teleop_started_anew_is_disabled_and_asks_arms_for_nothing(following: TeleopHarness) -> None:
    following.start()
    following.forget()
    show(following)
    assert following.text("state") == "DISABLED" and not following.following
    assert not following.master.sent and not following.slave.sent
    following.state_command("enable")
    following.run(0.02)
    assert not following.following
    show(following)
    assert following.following


def test_another_desire_needs_presence_anew(following: TeleopHarness) -> None:
    following.state_command("align_MTM")
    following.run(0.01)
    assert following.text("state") == "ALIGNING_MTM" and not following.following
    following.state_command("enable")
    following.run(0.05)
    assert not following.following
    show(following)
    assert following.following


def test_a_pose_that_is_no_number_never_starts(harness: TeleopHarness) -> None:
    harness.master.obeys = False
    harness.master.ring.set(measured_cp=math.nan)
    harness.state_command("enable")
    show(harness)
    assert not harness.following
    assert harness.text("reason") == "waiting: the pose of MTMR in its reference frame is not known"


@pytest.mark.parametrize("before", [0, 1])
def test_an_arm_that_is_lost_while_clutched_needs_presence_again(following: TeleopHarness, before: int) -> None:
    """Also in the very cycle in which the clutch is released."""
    following.send("clutch", 1)
    following.slave.ring.epoch += 1
    following.run(before * 0.001)
    following.send("clutch", 0)
    following.run(0.05)
    assert not following.following
    show(following)
    assert following.following


def test_a_clutch_that_is_held_is_not_pressed_again(following: TeleopHarness) -> None:
    following.send("clutch", 1)
    following.run(0.01)
    following.forget()
    following.send("clutch", 1)
    assert not following.slave.sent and not following.reports.reported
    following.send("clutch", 0)
    following.run(0.01)
    assert following.following, "presence of before the clutch is what it comes back to"


def test_a_slave_that_has_ended_the_stream_is_left_alone_for_its_pause_and_then_followed_again() -> None:
    harness = TeleopHarness().follow()
    harness.slave.refuses["servo_cp"] = f"servo_cp: {STREAM_ENDED}: yaw is 0.8 rad from the setpoint"
    harness.lead(0.001, 0.0, 0.0)
    harness.step()
    harness.slave.refuses.clear()
    harness.forget()
    harness.run(STREAM_PAUSE_NS * 1e-9)
    assert not harness.following and not harness.slave.asked("servo_cp", "jaw/servo_jp")
    harness.run(0.2)
    assert harness.following and harness.slave.asked("servo_cp")
