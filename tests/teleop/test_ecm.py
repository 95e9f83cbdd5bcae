"""Two masters that carry the camera; on a fake clock."""

from __future__ import annotations

import numpy as np
import pytest

from tests.teleop.harness import EcmHarness


@pytest.fixture
def harness() -> EcmHarness:
    made = EcmHarness()
    assert made.console is not None
    made.console.set(operator_present=False)  # the head sensor is not asked
    made.state_command("enable")
    made.run(0.005)
    assert made.following, made.text("reason")
    return made


def test_masters_are_let_go_with_their_orientations_locked(harness: EcmHarness) -> None:
    for name in ("MTML", "MTMR"):
        assert harness.arms[name].words()[:3] == ["use_gravity_compensation", "body/servo_cf", "lock_orientation"]


def test_a_process_that_is_killed_leaves_the_axes_of_the_masters_wrenches_as_they_were(harness: EcmHarness) -> None:
    harness.run(0.005)
    for name in ("MTML", "MTMR"):
        assert not harness.arms[name].asked("body/set_cf_orientation_absolute")
        assert {values[6:] for _, values, _ in harness.arms[name].asked("body/servo_cf")[1:]} == {(0.03, 1.0)}


def test_the_ecm_goes_against_the_hands(harness: EcmHarness) -> None:
    harness.lead(0.02, 0, 0)
    assert harness.slave.asked("servo_jp")[-1][1] == pytest.approx((-0.049958, 0, 0.12 - 0.000099, 0), abs=1e-6)
    assert harness.record.field("goal_jp")[0] == pytest.approx(-0.049958, abs=1e-6)
    assert harness.arms["MTML"].asked("lock_orientation")[-1][1][1] == pytest.approx(np.sin(0.049958 / 2), abs=1e-6)


def test_hands_spread_are_pulled_together_with_forces_that_end(harness: EcmHarness) -> None:
    for _ in range(10):
        harness.arms["MTML"].shift(0.001, 0, 0)
        harness.arms["MTMR"].shift(-0.001, 0, 0)
        harness.step()
    assert harness.arms["MTML"].asked("body/servo_cf")[-1][1] == pytest.approx((-1.5, 0, 0, 0, 0, 0, 0.03, 1), abs=1e-9)
    assert harness.arms["MTMR"].asked("body/servo_cf")[-1][1] == pytest.approx((1.5, 0, 0, 0, 0, 0, 0.03, 1), abs=1e-9)
    harness.state_command("disable")
    assert harness.arms["MTML"].words()[-1] == "end_stream"


def test_masters_elsewhere_are_refused_in_words() -> None:
    harness = EcmHarness()
    harness.arms["MTML"].shift(0.5, 0, 0)
    harness.state_command("enable")
    harness.run(0.005)
    assert harness.text("state") == "DISABLED" and harness.text("reason").startswith("MTML is at (0.650,")


@pytest.mark.parametrize("right", [(0.15, -0.0515, 0.40), (0.15, -0.05, 0.40), (0.1125, -0.0375, 0.30)])
def test_masters_close_together_are_waited_for(right: tuple[float, ...]) -> None:
    harness = EcmHarness()
    harness.arms["MTMR"].pose = (*right, 0, 0, 0, 1)
    harness.state_command("enable")
    harness.run(0.1)
    assert not harness.following and harness.text("state") == "SETTING_ARMS_STATE" and "mm" in harness.text("reason")
    assert not harness.slave.sent
    harness.arms["MTMR"].pose = (-0.15, -0.05, 0.40, 0, 0, 0, 1)
    harness.run(0.7)
    assert harness.following and not harness.text("reason")


def test_hands_that_come_together_end_it_before_the_camera_rolls(harness: EcmHarness) -> None:
    for _ in range(2000):
        if not harness.following:
            break
        harness.arms["MTML"].shift(-0.00014, 0, 0)
        harness.arms["MTMR"].shift(0.00014, 0, 0)
        harness.step()
    assert harness.text("state") == "DISABLED"
    assert all(abs(values[3]) < 0.01 for _, values, _ in harness.slave.asked("servo_jp"))


def test_the_clutch_begins_from_a_new_place(harness: EcmHarness) -> None:
    harness.send("clutch", 1)
    assert not harness.following and harness.slave.words()[-1] == "end_stream"
    harness.forget()
    harness.lead(0, 0.05, 0, of=("MTML",))
    harness.run(0.02)
    assert not harness.slave.sent
    harness.send("clutch", 0)
    harness.run(0.005)
    assert harness.following
    assert harness.slave.asked("servo_jp")[-1][1] == pytest.approx((0, 0, 0.12, 0), abs=1e-9)


def test_a_disabled_one_is_silent_on_the_clutch(harness: EcmHarness) -> None:
    harness.state_command("disable")
    harness.run(0.005)
    harness.forget()
    harness.reports.reported.clear()
    for pressed in (1, 0, 2, 0):
        harness.send("clutch", pressed)
        harness.run(0.01)
    assert not harness.reports.reported and not harness.text("reason")
    assert not any(arm.sent for arm in harness.arms.values())
    harness.send("clutch", 1)
    harness.state_command("enable")
    harness.run(0.005)
    assert harness.text("state") == "ENABLED" and not harness.following, "it knows that the clutch is pressed"


def test_another_scale_moves_nothing(harness: EcmHarness) -> None:
    harness.lead(0.0, 0, 0.05)
    before = harness.slave.asked("servo_jp")[-1][1]
    assert harness.send("set_scale", 0.5).outcomes == ["done"]
    assert harness.slave.asked("servo_jp")[-1][1] == pytest.approx(before, abs=1e-9)


def test_a_silent_console_or_an_arm_in_trouble_ends_it(harness: EcmHarness) -> None:
    harness.console_alive = False
    harness.run(0.04)
    assert harness.text("state") == "DISABLED" and not harness.following
    assert any(line.startswith("operator-timeout of console:") for line in harness.reports.log), "to be started again"
    harness.console_alive = True
    harness.run(0.01)
    harness.state_command("enable")
    harness.run(0.01)
    assert harness.following
    harness.arms["MTMR"].fail("MTMR: lost power")
    harness.step()
    assert not harness.following


def test_it_aligns_nothing_and_locks_nothing(harness: EcmHarness) -> None:
    assert harness.state_command("align_MTM").outcomes == ["refused"]
    assert harness.send("lock_rotation", 1).outcomes == ["refused"]
    assert harness.following


def test_masters_that_are_played_are_left_to_who_moves_them(harness: EcmHarness) -> None:
    for name in ("MTML", "MTMR"):
        harness.arms[name].ring.set(simulated=True)
    harness.forget()
    harness.lead(0.02, 0, 0, of=("MTML",))
    harness.run(0.1)
    assert harness.slave.asked("servo_jp") and not harness.arms["MTML"].sent


def test_a_camera_at_its_limit_goes_on_following_and_says_so(harness: EcmHarness) -> None:
    harness.slave.says["servo_jp"] = "clipped: insertion"
    harness.run(0.005)
    assert harness.following and harness.text("reason") == "ECM at its limit: insertion"


def test_the_clutch_leaves_a_camera_alone_that_others_move() -> None:
    harness = EcmHarness()
    harness.send("clutch", 1)
    assert harness.slave.words() == []


@pytest.mark.parametrize("which", ["MTML", "MTMR", "ECM"])
def test_whoever_else_stops_one_of_its_arms_ends_it(harness: EcmHarness, which: str) -> None:
    harness.arms[which].stop("plan.py")
    harness.step()
    assert not harness.following and harness.text("state") == "DISABLED"
    assert harness.text("reason") == f"plan.py (hold) stopped {which}"
    harness.forget()
    harness.run(0.2)
    assert not any(arm.sent for arm in harness.arms.values())


def test_a_master_of_the_camera_that_another_program_moves_ends_it(harness: EcmHarness) -> None:
    harness.step()
    harness.arms["MTML"].ring.set(control_mode=2)
    harness.step()
    assert harness.text("state") == "DISABLED" and "MTML is moved or held" in harness.text("reason")


def test_a_pose_that_is_not_known_is_waited_for_in_words() -> None:
    harness = EcmHarness()
    harness.arms["MTML"].ring.set(reference_valid=False)
    harness.state_command("enable")
    harness.run(0.005)
    assert not harness.following and harness.text("reason").startswith("waiting: the poses of all three arms")


@pytest.mark.parametrize("checks", [True, False])
def test_masters_outside_begin_only_if_that_is_not_checked(checks: bool) -> None:
    harness = EcmHarness(check_mtms_workspace=checks)
    assert harness.console is not None
    harness.console.set(operator_present=False)
    harness.arms["MTML"].pose = (0.45, -0.05, 0.40, 0, 0, 0, 1)
    harness.state_command("enable")
    harness.run(0.005)
    assert harness.following is not checks
