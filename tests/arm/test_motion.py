"""Moves, streams, efforts and their answers on a homed arm."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from tests.arm.arm_configs import TOOL, bare_arm, fixed_arm
from tests.arm.fake_io import SECOND, ArmHarness
from tests.arm.fake_requests import FakeRequest
from trocar.procs.arm.joints import joints
from trocar.procs.arm.motion import Motion
from trocar.procs.document.arms import ArmConfig

DEEP = (0.0, 0.0, 0.12, 0.0, 0.0, 0.0)


@pytest.fixture
def harness() -> ArmHarness:
    """Homed with an instrument, at zero but 0.12 m deep, nothing under way."""
    made = ArmHarness(fixed_arm()).homed()
    with made.hurried():
        finish(made, made.send("move_jp", DEEP))
        finish(made, made.send("jaw/move_jp", (0.0,)))
        made.run(0.2)
    made.reports.events.clear()
    return made


def finish(harness: ArmHarness, request: FakeRequest) -> float:
    return harness.until(lambda: request.outcomes[-1] in ("done", "failed"))


def busy(harness: ArmHarness) -> list[bool]:
    return [e[4] for e in harness.reports.of("operating_state")]


@pytest.mark.parametrize(
    ("joint", "start", "end", "ratio", "seconds"),
    (
        (2, 0.0, 0.12, 1.0, 1.5492), (2, 0.0, 0.12, 0.5, 2.2), (2, 0.0, 0.12, 0.1, 7.0),
        (0, 0.0, 10.0, 1.0, 0.6667), (0, 0.0, 10.0, 0.5, 0.9428), (0, 0.0, 10.0, 0.1, 2.1111),
        (0, -45.0, 45.0, 1.0, 2.0), (0, -45.0, 45.0, 0.5, 3.0), (0, -60.0, 60.0, 1.0, 2.3333),
        (0, -60.0, 60.0, 0.5, 3.6667), pytest.param(0, -45.0, 45.0, 0.1, 11.0, marks=pytest.mark.slow),
        pytest.param(0, -60.0, 60.0, 0.1, 14.3333, marks=pytest.mark.slow),
    ),
)
def test_moves_last_as_long_as_the_reference(joint, start, end, ratio, seconds) -> None:
    scale = 1.0 if joint == 2 else np.pi / 180
    harness = ArmHarness().homed()
    goal = np.array(DEEP)
    goal[joint] = start * scale
    with harness.hurried():
        finish(harness, harness.send("move_jp", goal))
    assert harness.send("trajectory_j/set_ratio", (ratio,)).outcomes == ["done"]
    goal[joint] = end * scale
    move = harness.send("move_jp", goal)
    assert finish(harness, move) == pytest.approx(seconds, abs=0.02)
    harness.step()
    assert harness.state["setpoint_position"][:6] == pytest.approx(goal, abs=1e-9)
    assert harness.state["trajectory_ratio"] == ratio


def test_a_move_is_busy_then_reached_then_not_busy(harness: ArmHarness) -> None:
    move = harness.send("move_jp", (0.1, 0.0, 0.12, 0.0, 0.0, 0.0))
    assert harness.state["is_busy"] and harness.state["control_mode"] == 2
    finish(harness, move)
    assert [e[0] for e in harness.reports.events] == ["operating_state", "goal_reached", "operating_state"]
    assert busy(harness) == [True, False] and harness.reports.of("goal_reached") == [("goal_reached", True)]
    assert move.outcomes == ["accepted", "done"] and not harness.state["is_busy"]


def test_a_move_of_zero_length_gives_the_pair_at_once(harness: ArmHarness) -> None:
    move = harness.send("move_jp", DEEP)
    assert busy(harness) == [True, False] and move.outcomes == ["accepted", "done"]


def test_a_newer_move_bends_the_older_without_a_jump(harness: ArmHarness) -> None:
    harness.io.largest_step = 0.0
    first = harness.send("move_jp", (0.8, 0.0, 0.12, 0.0, 0.0, 0.0))
    harness.run(0.6)
    second = harness.send("move_jp", (-0.2, 0.3, 0.12, 0.0, 0.0, 0.0))
    assert first.outcomes == ["accepted", "failed"] and "newer" in first.replies[-1][1]
    before, velocity = harness.io.setpoint[0], 0.0
    for _ in range(100):
        harness.step()
        step = (harness.io.setpoint[0] - before) / (harness.period_ns / SECOND)
        assert abs(step - velocity) < 1.0 or velocity == 0.0
        before, velocity = harness.io.setpoint[0], step
    finish(harness, second)
    assert busy(harness) == [True, True, False]
    assert harness.reports.of("goal_reached") == [("goal_reached", True)]
    assert harness.io.largest_step < 1.6 * harness.period_ns / SECOND
    harness.step()
    assert harness.state["setpoint_position"][:6] == pytest.approx((-0.2, 0.3, 0.12, 0.0, 0.0, 0.0))


def test_jaw_and_arm_moves_overlap_and_both_arrive(harness: ArmHarness) -> None:
    jaw = harness.send("jaw/move_jp", (1.0,))
    arm = harness.send("move_jp", (0.3, 0.0, 0.12, 0.0, 0.0, 0.0))
    finish(harness, arm)
    assert jaw.outcomes == arm.outcomes == ["accepted", "done"]
    assert busy(harness) == [True, True, False]
    harness.step()
    assert harness.state["jaw_position"] == pytest.approx(1.0) and harness.state["position"][0] == pytest.approx(0.3)


def test_a_ratio_set_in_flight_slows_the_rest(harness: ArmHarness) -> None:
    move = harness.send("move_jp", (1.5, 0.0, 0.12, 0.0, 0.0, 0.0))
    harness.run(0.3)
    harness.send("trajectory_j/set_ratio", (0.25,))
    assert finish(harness, move) > 3.0
    harness.step()
    assert harness.state["setpoint_position"][0] == pytest.approx(1.5)


@pytest.mark.parametrize("ratio", (0.0, -1.0, 1.5))
def test_a_ratio_out_of_range_changes_nothing(harness: ArmHarness, ratio: float) -> None:
    request = harness.send("trajectory_j/set_ratio", (ratio,))
    assert request.outcomes == ["refused"] and "allowed: ]0, 1]" in request.replies[0][1]
    assert harness.state["trajectory_ratio"] == 1.0


def test_different_ratios_are_shown_as_zero(harness: ArmHarness) -> None:
    harness.send("trajectory_j/set_ratio_v", (0.5,))
    ratios = [float(harness.state[name]) for name in ("trajectory_ratio", "trajectory_ratio_v", "trajectory_ratio_a")]
    assert ratios == [0.0, 0.5, 1.0]


@pytest.mark.parametrize("name", ("servo_jp", "servo_jr", "servo_jf", "move_jp", "move_jr"))
@pytest.mark.parametrize("values", ((), (0.1,) * 5, (0.1,) * 7, (0.1, 0.1, 0.1, 0.1, 0.1, float("nan"))))
def test_wrong_values_are_refused_and_move_nothing(harness: ArmHarness, name: str, values) -> None:
    before = harness.io.setpoint.copy()
    request = harness.send(name, values)
    harness.run(0.1)
    assert request.outcomes == ["refused"] and request.replies[0][1]
    assert np.array_equal(harness.io.setpoint, before)
    assert busy(harness) == ([True, False] if name.startswith("move") else [])


def test_a_command_the_arm_does_not_have_is_refused_by_name(harness: ArmHarness) -> None:
    request = harness.send("lock_orientation", (0.0, 0.0, 0.0, 1.0))
    assert request.replies == [("refused", "lock_orientation: PSM1 has no such command")]


def test_motion_is_refused_outside_homed_with_one_warning_in_two_seconds() -> None:
    harness = ArmHarness()
    harness.reach("ENABLED")
    requests = [harness.send("servo_jp", DEEP) for _ in range(100)]
    assert all(r.outcomes == ["refused"] and "ENABLED" in r.replies[0][1] for r in requests)
    assert len(harness.reports.of("warning")) == 1


def test_a_refused_move_during_a_move_leaves_it_running(harness: ArmHarness) -> None:
    move = harness.send("move_jp", (0.3, 0.0, 0.12, 0.0, 0.0, 0.0))
    harness.run(0.1)
    harness.send("move_jp", (1.0,))
    finish(harness, move)
    assert move.outcomes == ["accepted", "done"] and busy(harness) == [True, True, True, False]


def test_servo_follows_with_velocities_until_the_stream_ends(harness: ArmHarness) -> None:
    velocity = (0.5, 0.0, 0.0, 0.0, 0.0, 0.0)
    request = harness.send("servo_jp", (0.01, 0.0, 0.12, 0.0, 0.0, 0.0, *velocity))
    assert request.replies == [("done", "")]
    assert harness.setpoint["mode"] == 1 and harness.setpoint["has_velocity"] and harness.setpoint["velocity"][0] == 0.5
    harness.run(0.02)
    assert harness.setpoint["has_velocity"] and harness.state["setpoint_position"][0] == pytest.approx(0.01)
    harness.run(0.2)
    assert not harness.setpoint["has_velocity"] and harness.setpoint["velocity"][0] == 0.0
    assert harness.state["setpoint_position"][0] == pytest.approx(0.01)
    assert not harness.reports.events


def test_a_jaw_stream_neither_stops_nor_prolongs_the_velocity_of_the_arm(harness: ArmHarness) -> None:
    harness.send("servo_jp", (0.0, 0.0, 0.12, 0.0, 0.0, 0.0, 0.5, 0.0, 0.0, 0.0, 0.0, 0.0))
    harness.send("jaw/servo_jp", (0.1,))
    assert harness.setpoint["has_velocity"] and harness.setpoint["velocity"][0] == 0.5
    for i in range(100):
        harness.send("jaw/servo_jp", (0.1 + 0.001 * i,))
    assert not harness.setpoint["has_velocity"]
    assert harness.state["jaw_setpoint_position"] == pytest.approx(0.198)


def test_servo_without_velocities_feeds_none(harness: ArmHarness) -> None:
    harness.send("servo_jp", (0.01, 0.0, 0.12, 0.0, 0.0, 0.0))
    assert not harness.setpoint["has_velocity"]


def test_increments_add_up_within_a_cycle(harness: ArmHarness) -> None:
    step = (0.01, 0.0, 0.0, 0.0, 0.0, 0.0)
    harness.step(FakeRequest("servo_jr", step), FakeRequest("servo_jr", step))
    harness.run(0.05)
    assert harness.state["setpoint_position"][0] == pytest.approx(0.02)


def test_move_increments_add_to_the_goal_of_the_running_move(harness: ArmHarness) -> None:
    step = (0.1, 0.0, 0.0, 0.0, 0.0, 0.0)
    harness.send("move_jr", step)
    harness.run(0.1)
    finish(harness, harness.send("move_jr", step))
    harness.step()
    assert harness.state["setpoint_position"][0] == pytest.approx(0.2)


@pytest.mark.parametrize(("name", "yaw", "insertion"), [("servo_jp", 1.7, 0.27), ("move_jp", 9.0, 0.5)])
def test_goals_beyond_the_limits_are_clipped_and_told(
    harness: ArmHarness, name: str, yaw: float, insertion: float
) -> None:
    harness.go((1.5, 0.0, 0.23, 0.0, 0.0, 0.0))
    harness.reports.events.clear()
    request = harness.send(name, (yaw, 0.0, insertion, 0.0, 0.0, 0.0))
    changes = " 9.000 → 1.588 rad, insertion 0.500 → 0.240 m" if name == "move_jp" else ", insertion"
    assert request.replies[0][1] == f"clipped: yaw{changes}"
    harness.run(4.0)
    assert request.replies[-1] == ("done", f"clipped: yaw{changes}")
    assert harness.state["setpoint_position"][:3] == pytest.approx((1.588, 0.0, 0.24))
    assert len(harness.reports.of("warning")) == 1


def test_clipping_warns_once_an_episode(harness: ArmHarness) -> None:
    for angle in (*np.linspace(0.0, 3.0, 200), *(3.0,) * 200):
        harness.send("jaw/servo_jp", (angle,))
    assert harness.send("jaw/servo_jp", (3.0,)).replies == [("done", "clipped: jaw")]
    assert len(harness.reports.of("warning")) == 1
    harness.run(1.0)
    harness.send("jaw/servo_jp", (3.0,))
    assert len(harness.reports.of("warning")) == 2
    assert harness.state["jaw_setpoint_position"] == pytest.approx(1.39626)


def test_a_clipped_joint_gets_no_velocity(harness: ArmHarness) -> None:
    harness.go((1.5, 0.0, 0.12, 0.0, 0.0, 0.0))
    harness.send("servo_jp", (1.7, 0.0, 0.12, 0.0, 0.0, 0.0, 1.0, 0.5, 0.0, 0.0, 0.0, 0.0))
    assert tuple(harness.setpoint["velocity"][:2]) == (0.0, 0.5)


def test_hold_ends_a_move_where_it_is(harness: ArmHarness) -> None:
    move = harness.send("move_jp", (0.8, 0.0, 0.12, 0.0, 0.0, 0.0))
    harness.run(0.3)
    here = harness.io.setpoint[0]
    assert harness.send("hold").outcomes == ["done"]
    harness.run(0.5)
    assert harness.io.setpoint[0] == pytest.approx(here, abs=0.002)
    assert move.outcomes == ["accepted", "failed"]
    assert busy(harness) == [True, False] and harness.reports.of("goal_reached") == [("goal_reached", False)]


def test_a_servo_command_ends_a_move(harness: ArmHarness) -> None:
    move = harness.send("move_jp", (0.8, 0.0, 0.12, 0.0, 0.0, 0.0))
    harness.run(0.3)
    harness.send("servo_jp", (0.2, 0.0, 0.12, 0.0, 0.0, 0.0))
    assert move.outcomes == ["accepted", "failed"] and busy(harness) == [True, False]


def test_efforts_go_through_the_coupling_without_tracking_check(harness: ArmHarness) -> None:
    effort = (0.1, 0.2, 0.3, 0.01, 0.02, 0.03)
    assert harness.send("servo_jf", effort).outcomes == ["done"]
    coupling = np.eye(7)
    coupling[3:, 3:] = harness.document.tool.actuator_to_joint
    assert harness.setpoint["mode"] == 1 and harness.setpoint["in_effort"][:7].all()
    assert harness.setpoint["effort"][:7] == pytest.approx(coupling.T @ (*effort, 0.0))
    harness.run(0.05)
    assert not harness.io.flag("tracking_check") and harness.state["control_mode"] == 3
    harness.io.position[0] += 0.05  # pushed by hand
    harness.step()
    harness.send("hold")
    harness.run(0.05)
    assert harness.io.flag("tracking_check") and harness.setpoint["mode"] == 1
    assert not harness.setpoint["in_effort"].any()
    assert harness.io.setpoint[0] == pytest.approx(0.05)


def test_free_applies_zero_efforts(harness: ArmHarness) -> None:
    harness.send("free")
    assert harness.setpoint["mode"] == 1 and harness.setpoint["in_effort"][:7].all()
    assert not harness.setpoint["effort"].any()
    assert harness.send("jaw/servo_jf", (0.05,)).outcomes == ["done"]
    assert harness.setpoint["effort"].any()


def test_jaw_commands_need_an_instrument() -> None:
    harness = ArmHarness(bare_arm()).homed()
    for name in ("jaw/servo_jp", "jaw/move_jp", "jaw/servo_jf"):
        assert "no instrument" in harness.send(name, (0.1,)).replies[0][1]


def test_bare_arm_moves_in_seven_joints() -> None:
    harness = ArmHarness(bare_arm()).homed()
    goal = (0.1, 0.2, 0.1, 0.3, -0.3, 0.2, 3.5)
    request = harness.send("move_jp", goal)
    assert request.replies[0] == ("accepted", "clipped: disc_4 3.500 → 3.002 rad")
    finish(harness, request)
    harness.step()
    assert harness.io.setpoint == pytest.approx((*goal[:6], np.radians(172)))


def test_an_instrument_can_be_named_and_nothing_jumps() -> None:
    harness = ArmHarness(bare_arm()).homed()
    before = harness.io.setpoint.copy()
    assert "there are: LARGE_NEEDLE_DRIVER:400006" in harness.send("set_tool_type", (), "SPOON:1").replies[0][1]
    assert harness.send("set_tool_type", (), "LARGE_NEEDLE_DRIVER:400006").outcomes == ["done"]
    harness.run(0.1)
    assert harness.state["count"] == 6 and harness.state["cartesian_valid"]
    assert np.allclose(harness.io.setpoint, before, atol=1e-12)


def test_disable_during_a_move_ends_it_without_an_error(harness: ArmHarness) -> None:
    move = harness.send("move_jp", (0.8, 0.0, 0.12, 0.0, 0.0, 0.0))
    harness.run(0.1)
    harness.state_command("disable")
    assert move.outcomes == ["accepted", "failed"] and harness.setpoint["mode"] == 0
    assert not harness.reports.of("error") and not harness.state["is_busy"]


def test_pause_holds_and_refuses_motion(harness: ArmHarness) -> None:
    harness.send("move_jp", (0.8, 0.0, 0.12, 0.0, 0.0, 0.0))
    harness.run(0.3)
    harness.state_command("pause")
    here = harness.io.setpoint.copy()
    harness.run(0.5)
    assert harness.setpoint["mode"] == 1 and harness.io.flag("pid_enabled")
    assert harness.io.setpoint == pytest.approx(here, abs=0.002)
    assert harness.send("servo_jp", DEEP).outcomes == ["refused"]
    harness.state_command("resume")
    finish(harness, harness.send("move_jp", DEEP))
    harness.step()
    assert harness.state["setpoint_position"][:6] == pytest.approx(DEEP)


@pytest.mark.parametrize("made", [bare_arm, fixed_arm])
def test_only_the_insertion_is_told_in_metres(made: Callable[[], ArmConfig]) -> None:
    joints = ArmHarness(made()).homed().arm.control.joints
    assert [joints.unit(axis) for axis in range(joints.size)] == ["rad", "rad", "m", "rad", "rad", "rad", "rad"]


@pytest.mark.parametrize("jerk_time_s", [0.0, 0.1, 0.3])
def test_a_move_from_any_motion_stays_within_the_limits(jerk_time_s: float) -> None:
    if jerk_time_s:
        pytest.importorskip("ruckig", reason="no package of ruckig for this machine", exc_type=ImportError)
    space, random = joints(fixed_arm(), TOOL), np.random.default_rng(5)
    for _ in range(60):
        motion = Motion(space, jerk_time_s)
        motion.hold(random.uniform(space.lower, space.upper))
        assert motion.move(random.uniform(space.lower, space.upper), random.uniform(-1.0, 1.0) * space.v_max, 0) == ""
        now_ns = 0
        while motion.moving:
            now_ns += 10_000_000
            motion.step(now_ns)
            assert (motion.goal > space.lower - 1e-9).all() and (motion.goal < space.upper + 1e-9).all()


def test_a_move_out_of_a_fast_stream_stays_within_the_limits(harness: ArmHarness) -> None:
    for k in range(100):
        harness.send("servo_jp", (0.0, 0.0, 0.12, 0.0, 0.012 * k, 0.0))  # 6 rad/s; moves brake at 12.6 rad/s²
    harness.io.record["velocity"][6] = 6.0
    move = harness.send("move_jp", (0.0, 0.0, 0.12, 0.0, 0.0, 0.0))
    seen = []
    while move.outcomes[-1] == "accepted":
        harness.step()
        seen.append(harness.arm.control.motion.goal[4])
    assert move.outcomes[-1] == "done" and 1.19 < max(seen) <= 1.39626
