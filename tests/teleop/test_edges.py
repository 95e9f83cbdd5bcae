"""Where a mapping, presence and a teleoperation begin, and the very edges of what they allow."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.cases import cases
from tests.teleop.harness import EcmHarness, TeleopHarness
from trocar.procs.kinematics.poses import angle_between, conjugate, product
from trocar.procs.teleop.teleoperation import JawMapping, PoseMapping, Presence, Start, waiting_for
from trocar.shm.mailbox.origins import NO_ORIGIN

ANGLES = st.floats(-3.0, 3.0)
PLACES = st.floats(-0.5, 0.5)
QUATERNIONS = st.tuples(*(st.floats(-1.0, 1.0),) * 4).filter(lambda q: math.hypot(*q) > 0.1)


def unit(quaternion: tuple[float, ...]) -> np.ndarray:
    return np.array(quaternion) / math.hypot(*quaternion)


def pose(place: tuple[float, ...], quaternion: tuple[float, ...]) -> np.ndarray:
    return np.array((*place, *unit(quaternion)))


POSES = st.builds(pose, st.tuples(PLACES, PLACES, PLACES), QUATERNIONS)


@given(POSES, POSES, POSES, st.floats(0.1, 2.0), st.floats(0.9, 1.1), st.booleans(), st.booleans())
def test_the_slave_goes_and_turns_as_the_master_does(begin: np.ndarray, slave: np.ndarray, now: np.ndarray,
                                                     scale: float, length: float, turns: bool, moves: bool) -> None:
    mapping = PoseMapping(scale, rotation_locked=not turns, translation_locked=not moves)
    mapping.begin(begin, slave)
    longer = np.append(now[:3], now[3:] * length)  # a master's quaternion may be rounded
    goal = mapping.step(longer)
    assert goal[:3] == pytest.approx(slave[:3] + scale * moves * (now[:3] - begin[:3]), abs=1e-9)
    assert math.hypot(*goal[3:]) == pytest.approx(1.0) and goal[6] >= 0.0
    by = product(now[3:].tolist(), conjugate(begin[3:].tolist()))
    wanted = np.append(goal[:3], product(by, slave[3:].tolist()) if turns else slave[3:])
    assert angle_between(goal, wanted) == pytest.approx(0.0, abs=1e-6)


def test_a_mapping_that_was_not_begun_goes_nowhere() -> None:
    mapping = PoseMapping(0.2)
    assert mapping.goal.tolist() == [0, 0, 0, 0, 0, 0, 1] and mapping.offset == (0, 0, 0, 1)


def test_a_twist_is_scaled_and_what_is_locked_does_not_move() -> None:
    twist = np.array((1.0, 2.0, 3.0, 4.0, 5.0, 6.0))
    for linear, angular, moves, turns in ((a, b, c, d) for a in (0, 1) for b in (0, 1) for c in (0, 1) for d in (0, 1)):
        mapping = PoseMapping(0.5, rotation_locked=not turns, translation_locked=not moves)
        found = mapping.velocity(twist, linear=bool(linear), angular=bool(angular))
        assert list(found) == [*(0.5 * twist[:3] * linear * moves), *(twist[3:] * angular * turns)]


@cases(("gripper", "roll", "active"), [
    (3.0, 0.0, True), (2.999, 0.0, False), (0.0, 2.0, True), (0.0, 1.999, False),
    (2.5, 1.5, False), (2.5, 1.501, True), (2.501, 1.5, True), (math.nan, 2.0, True), (math.nan, math.nan, False)])
def test_presence_is_a_gripper_or_a_roll_that_moved_or_a_bit_of_both(gripper: float, roll: float, active: bool) -> None:
    presence = Presence(3.0, 2.0)
    assert not presence.look(0.0, 0.0) and (presence.gripper_range, presence.roll_range) == (0.0, 0.0)
    assert presence.look(gripper, roll) is active
    assert presence.look(0.0, 0.0) is active, "once active it stays so"
    presence.reset()
    assert presence.is_active is active and (presence.gripper_range, presence.roll_range) == (0.0, 0.0)
    presence.look(1.0, 1.0)
    presence.look(0.5, 0.25)
    assert (presence.gripper_range, presence.roll_range) == (0.5, 0.75)
    presence.forget_roll()
    assert (presence.gripper_range, presence.roll_range) == (0.5, 0.0)
    presence.forget()
    assert not presence.is_active and presence.gripper_range == 0.0


def test_what_following_waits_for_is_said_all_at_once() -> None:
    five = math.radians(5.0)
    assert waiting_for("MTMR", Start(five, five, is_active=True, is_moving=False)) == ""
    assert waiting_for("MTMR", Start(math.nan, five, is_active=True, is_moving=False)) != ""
    assert waiting_for("MTMR", Start(five + 1e-6, five, is_active=False, is_moving=True)) == (
        "waiting: MTMR 5.0° off, tolerance 5°; MTMR is still moving; pinch or twist MTMR's gripper a bit")


def test_a_jaw_that_was_never_begun_opens_from_closed_and_no_further_than_the_rate() -> None:
    jaw = JawMapping(0.1, 1.1, 2.0, 0.5)
    assert jaw.ghost == 0.0 and jaw.jaw_of(0.1) == 0.0 and jaw.jaw_of(1.1) == pytest.approx(1.1)
    assert jaw.step(0.0, 0.0) == 0.0, "no further closed than its lower limit"
    jaw = JawMapping(0.1, 1.1, 2.0, 0.5)
    jaw.use(-0.4, 0.5)
    jaw.begin(0.3)
    assert jaw.step(1.0, 0.02) == pytest.approx(0.3 + 0.5 * 0.5 * 0.02), "slowly until it has caught up"
    assert jaw.step(jaw.ghost + 0.01, 0.02) == pytest.approx(0.305 + 0.5 * 0.01)
    assert jaw.step(1.0, 0.02) == pytest.approx(0.31 + 0.5 * 2.0 * 0.02), "then quickly"
    assert jaw.step(1.0, 5.0) == pytest.approx(0.33 + 0.5 * 2.0 * 0.03), "a late cycle makes no more of it"
    assert jaw.step(0.0, -5.0) == pytest.approx(0.36)
    still = jaw.ghost
    assert jaw.step(math.nan, 0.02) == pytest.approx(0.36) and jaw.ghost == still, "it is not seen any more"
    for _ in range(200):
        lowest = jaw.step(-3.0, 0.02)
    assert lowest == -0.4 and jaw.jaw_of(jaw.ghost) == pytest.approx(-0.4)
    jaw.begin(0.0)
    for _ in range(400):
        without = jaw.step(math.nan, 0.02)
    assert without == pytest.approx(math.radians(45.0)), "a master without a gripper"


@pytest.mark.parametrize("made", [TeleopHarness, EcmHarness])
def test_a_teleoperation_begins_with_nothing_asked_for(made: type[TeleopHarness]) -> None:
    teleop = made().teleop
    assert teleop.is_idle and not teleop.following and not teleop.clutched and teleop.reason == ""
    assert (teleop.origin, teleop.now_ns, teleop.entered_ns, teleop.passed_s) == (NO_ORIGIN, 0, 0, 0.0)


def test_time_passes_from_one_cycle_to_the_next() -> None:
    teleop = TeleopHarness().teleop
    for now_ns, passed_s in ((5_000_000_000, 0.0), (5_010_000_000, 0.01), (5_260_000_000, 0.25)):
        teleop.step(now_ns, ())
        assert teleop.passed_s == pytest.approx(passed_s) and teleop.now_ns == now_ns


def test_a_gripper_that_moves_while_the_master_is_aligned_shows_presence() -> None:
    harness = TeleopHarness(start_gripper_threshold=0.5)
    harness.state_command("enable")
    harness.run(0.01)
    harness.master.ring.set(is_busy=True)
    harness.run(0.01)
    for gripper in (0.6, 0.0):
        harness.master.ring.set(gripper_position=gripper)
        harness.run(0.01)
    assert not harness.following and "is still moving" in harness.text("reason")
    harness.master.ring.set(is_busy=False)
    harness.run(0.01)
    assert harness.following


@pytest.mark.parametrize("made", [TeleopHarness, EcmHarness])
def test_asking_again_while_the_clutch_is_pressed_leaves_the_reason(made: type[TeleopHarness]) -> None:
    harness = made().follow()
    harness.send("clutch", 1)
    assert harness.text("reason") == "the clutch is pressed"
    harness.state_command("enable")
    harness.run(0.01)
    assert harness.text("reason") == "the clutch is pressed"


@pytest.mark.parametrize(("change", "reason"), [
    ({"has_jaw": False}, "PSM1 no longer has a jaw"), ({"tool": b"SMALL"}, "the instrument of PSM1 was changed")])
def test_following_ends_with_the_instrument(change: dict[str, object], reason: str) -> None:
    harness = TeleopHarness().follow()
    harness.slave.ring.set(**change)
    harness.step()
    assert not harness.following and harness.text("state") == "DISABLED" and harness.text("reason") == reason
    assert not harness.slave.asked("servo_cp")


def test_arms_are_asked_once_each_time_they_are_needed() -> None:
    harness = TeleopHarness()
    harness.slave.obeys = False
    harness.slave.ring.set(state=b"DISABLED", sub_state=b"DISABLED", is_homed=False)
    for times in (1, 2):
        harness.state_command("enable")
        harness.run(0.02)
        assert harness.slave.words().count("enable") == times
        harness.state_command("disable")
        harness.run(0.01)


def test_an_arm_that_loses_its_power_while_it_homes_is_not_powered_again() -> None:
    harness = TeleopHarness()
    harness.slave.obeys = False
    harness.slave.ring.set(sub_state=b"ENABLED", is_homed=False)
    harness.state_command("enable")
    harness.run(0.02)
    assert harness.slave.words().count("home") == 1
    harness.slave.ring.set(state=b"DISABLED", sub_state=b"DISABLED")
    harness.run(0.02)
    assert "enable" not in harness.slave.words()


@pytest.mark.parametrize(("which", "pushed"), [("MTML", "MTMR"), ("MTMR", "MTML")])
def test_only_masters_that_forces_move_are_pushed(which: str, pushed: str) -> None:
    harness = EcmHarness().follow()
    harness.arms[which].ring.set(simulated=True)
    harness.run(0.003)
    assert not harness.arms[which].asked("body/servo_cf") and len(harness.arms[pushed].asked("body/servo_cf")) == 3


@pytest.mark.parametrize(("sideways", "stops"), [(0.00501, False), (0.00503, True)])
def test_a_camera_that_would_jump_by_a_tenth_of_a_radian_stays(sideways: float, stops: bool) -> None:
    harness = EcmHarness()
    for name in ("MTML", "MTMR"):
        harness.arms[name].shift(0.0, 0.0, -0.35)
    harness.follow()
    for name in ("MTML", "MTMR"):
        harness.arms[name].shift(sideways, 0.0, 0.0)
    assert math.atan(sideways / 0.05) == pytest.approx(0.1, abs=0.001)
    harness.step()
    assert harness.following is not stops
    assert ("the camera would jump" in harness.text("reason")) is stops


def test_a_jaw_that_nobody_knows_opens_from_closed_as_far_as_the_gripper() -> None:
    harness = TeleopHarness(gripper_max=0.8, gripper_zero=0.1, jaw_rate=100.0, jaw_rate_after_clutch=100.0)
    harness.slave.ring.set(tool=b"UNKNOWN")
    harness.follow()
    for gripper, jaw in ((0.8, 0.8), (0.1, 0.0), (-0.5, 0.0)):
        harness.master.ring.set(gripper_position=gripper)
        harness.run(0.05)
        assert float(harness.slave.ring.field("jaw_setpoint_position")) == pytest.approx(jaw)


@pytest.mark.parametrize("ignore", [False, True])
def test_an_instrument_whose_jaw_does_not_open_is_followed_with_its_jaw_at_rest(ignore: bool) -> None:
    harness = TeleopHarness(ignore_jaw=ignore)
    harness.slave.ring.set(tool=b"HOOK", jaw_setpoint_position=-0.1)
    harness.follow()
    for gripper in (0.8, -0.5, math.nan):
        harness.master.ring.set(gripper_position=gripper)
        harness.run(0.05)
    assert harness.following and not harness.slave.asked("jaw/servo_jp")
