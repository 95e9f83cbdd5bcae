"""Moves, streams, efforts and their answers on a homed arm."""

from __future__ import annotations

import numpy as np
import pytest

from tests.arm.fake_io import SECOND, FakeRequest, Rig, bare_arm, fixed_arm

DEEP = (0.0, 0.0, 0.12, 0.0, 0.0, 0.0)


@pytest.fixture
def rig() -> Rig:
    """Homed with an instrument, at zero but 0.12 m deep, nothing under way."""
    made = Rig(fixed_arm()).homed()
    with made.hurried():
        finish(made, made.send("move_jp", DEEP))
        finish(made, made.send("jaw/move_jp", (0.0,)))
        made.run(0.2)
    made.reports.events.clear()
    return made


def finish(rig: Rig, request: FakeRequest) -> float:
    return rig.until(lambda: request.outcomes[-1] in ("done", "failed"))


def busy(rig: Rig) -> list[bool]:
    return [e[4] for e in rig.reports.of("operating_state")]


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
    rig = Rig().homed()
    goal = np.array(DEEP)
    goal[joint] = start * scale
    with rig.hurried():
        finish(rig, rig.send("move_jp", goal))
    assert rig.send("trajectory_j/set_ratio", (ratio,)).outcomes == ["done"]
    goal[joint] = end * scale
    move = rig.send("move_jp", goal)
    assert finish(rig, move) == pytest.approx(seconds, abs=0.02)
    rig.step()
    assert rig.state["setpoint_position"][:6] == pytest.approx(goal, abs=1e-9)
    assert rig.state["trajectory_ratio"] == ratio


def test_a_move_is_busy_then_reached_then_not_busy(rig: Rig) -> None:
    move = rig.send("move_jp", (0.1, 0.0, 0.12, 0.0, 0.0, 0.0))
    assert rig.state["is_busy"] and rig.state["control_mode"] == 2
    finish(rig, move)
    assert [e[0] for e in rig.reports.events] == ["operating_state", "goal_reached", "operating_state"]
    assert busy(rig) == [True, False] and rig.reports.of("goal_reached") == [("goal_reached", True)]
    assert move.outcomes == ["accepted", "done"] and not rig.state["is_busy"]


def test_a_move_of_zero_length_gives_the_pair_at_once(rig: Rig) -> None:
    move = rig.send("move_jp", DEEP)
    assert busy(rig) == [True, False] and move.outcomes == ["accepted", "done"]


def test_a_newer_move_bends_the_older_without_a_jump(rig: Rig) -> None:
    rig.io.largest_step = 0.0
    first = rig.send("move_jp", (0.8, 0.0, 0.12, 0.0, 0.0, 0.0))
    rig.run(0.6)
    second = rig.send("move_jp", (-0.2, 0.3, 0.12, 0.0, 0.0, 0.0))
    assert first.outcomes == ["accepted", "failed"] and "newer" in first.replies[-1][1]
    before, velocity = rig.io.setpoint[0], 0.0
    for _ in range(100):
        rig.step()
        step = (rig.io.setpoint[0] - before) / (rig.period_ns / SECOND)
        assert abs(step - velocity) < 1.0 or velocity == 0.0
        before, velocity = rig.io.setpoint[0], step
    finish(rig, second)
    assert busy(rig) == [True, True, False]
    assert rig.reports.of("goal_reached") == [("goal_reached", True)]
    assert rig.io.largest_step < 1.6 * rig.period_ns / SECOND
    rig.step()
    assert rig.state["setpoint_position"][:6] == pytest.approx((-0.2, 0.3, 0.12, 0.0, 0.0, 0.0))


def test_jaw_and_arm_moves_overlap_and_both_arrive(rig: Rig) -> None:
    jaw = rig.send("jaw/move_jp", (1.0,))
    arm = rig.send("move_jp", (0.3, 0.0, 0.12, 0.0, 0.0, 0.0))
    finish(rig, arm)
    assert jaw.outcomes == arm.outcomes == ["accepted", "done"]
    assert busy(rig) == [True, True, False]
    rig.step()
    assert rig.state["jaw_position"] == pytest.approx(1.0) and rig.state["position"][0] == pytest.approx(0.3)


def test_a_ratio_set_in_flight_slows_the_rest(rig: Rig) -> None:
    move = rig.send("move_jp", (1.5, 0.0, 0.12, 0.0, 0.0, 0.0))
    rig.run(0.3)
    rig.send("trajectory_j/set_ratio", (0.25,))
    assert finish(rig, move) > 3.0
    rig.step()
    assert rig.state["setpoint_position"][0] == pytest.approx(1.5)


@pytest.mark.parametrize("ratio", (0.0, -1.0, 1.5))
def test_a_ratio_out_of_range_changes_nothing(rig: Rig, ratio: float) -> None:
    request = rig.send("trajectory_j/set_ratio", (ratio,))
    assert request.outcomes == ["refused"] and "]0;1]" in request.replies[0][1]
    assert rig.reports.of("warning") and rig.state["trajectory_ratio"] == 1.0


def test_different_ratios_are_shown_as_zero(rig: Rig) -> None:
    rig.send("trajectory_j/set_ratio_v", (0.5,))
    ratios = [float(rig.state[name]) for name in ("trajectory_ratio", "trajectory_ratio_v", "trajectory_ratio_a")]
    assert ratios == [0.0, 0.5, 1.0]


@pytest.mark.parametrize("name", ("servo_jp", "servo_jr", "servo_jf", "move_jp", "move_jr"))
@pytest.mark.parametrize("values", ((), (0.1,) * 5, (0.1,) * 7, (0.1, 0.1, 0.1, 0.1, 0.1, float("nan"))))
def test_wrong_values_are_refused_and_move_nothing(rig: Rig, name: str, values) -> None:
    before = rig.io.setpoint.copy()
    request = rig.send(name, values)
    rig.run(0.1)
    assert request.outcomes == ["refused"] and request.replies[0][1]
    assert np.array_equal(rig.io.setpoint, before)
    assert busy(rig) == ([True, False] if name.startswith("move") else [])


def test_a_command_the_arm_does_not_have_is_refused_by_name(rig: Rig) -> None:
    request = rig.send("lock_orientation", (0.0, 0.0, 0.0, 1.0))
    assert request.replies == [("refused", "lock_orientation: PSM1 has no such command")]


def test_motion_is_refused_outside_homed_with_one_warning_in_two_seconds() -> None:
    rig = Rig()
    rig.reach("ENABLED")
    requests = [rig.send("servo_jp", DEEP) for _ in range(100)]
    assert all(r.outcomes == ["refused"] and "ENABLED" in r.replies[0][1] for r in requests)
    assert len(rig.reports.of("warning")) == 1


def test_a_refused_move_during_a_move_leaves_it_running(rig: Rig) -> None:
    move = rig.send("move_jp", (0.3, 0.0, 0.12, 0.0, 0.0, 0.0))
    rig.run(0.1)
    rig.send("move_jp", (1.0,))
    finish(rig, move)
    assert move.outcomes == ["accepted", "done"] and busy(rig) == [True, True, True, False]


def test_servo_follows_with_velocities_until_the_stream_ends(rig: Rig) -> None:
    velocity = (0.5, 0.0, 0.0, 0.0, 0.0, 0.0)
    request = rig.send("servo_jp", (0.01, 0.0, 0.12, 0.0, 0.0, 0.0, *velocity))
    assert request.replies == [("done", "")]
    assert rig.setpoint["mode"] == 1 and rig.setpoint["has_velocity"] and rig.setpoint["velocity"][0] == 0.5
    rig.step()
    assert rig.state["setpoint_position"][0] == pytest.approx(0.01)
    rig.run(0.2)
    assert not rig.setpoint["has_velocity"] and rig.setpoint["velocity"][0] == 0.0
    assert rig.state["setpoint_position"][0] == pytest.approx(0.01)
    assert not rig.reports.events


def test_a_jaw_stream_neither_stops_nor_prolongs_the_velocity_of_the_arm(rig: Rig) -> None:
    rig.send("servo_jp", (0.0, 0.0, 0.12, 0.0, 0.0, 0.0, 0.5, 0.0, 0.0, 0.0, 0.0, 0.0))
    rig.send("jaw/servo_jp", (0.1,))
    assert rig.setpoint["has_velocity"] and rig.setpoint["velocity"][0] == 0.5
    for i in range(100):
        rig.send("jaw/servo_jp", (0.1 + 0.001 * i,))
    assert not rig.setpoint["has_velocity"]
    assert rig.state["jaw_setpoint_position"] == pytest.approx(0.198)


def test_servo_without_velocities_feeds_none(rig: Rig) -> None:
    rig.send("servo_jp", (0.01, 0.0, 0.12, 0.0, 0.0, 0.0))
    assert not rig.setpoint["has_velocity"]


def test_increments_add_up_within_a_cycle(rig: Rig) -> None:
    step = (0.01, 0.0, 0.0, 0.0, 0.0, 0.0)
    rig.step(FakeRequest("servo_jr", step), FakeRequest("servo_jr", step))
    rig.step()
    assert rig.state["setpoint_position"][0] == pytest.approx(0.02)


def test_move_increments_add_to_the_goal_of_the_running_move(rig: Rig) -> None:
    step = (0.1, 0.0, 0.0, 0.0, 0.0, 0.0)
    rig.send("move_jr", step)
    rig.run(0.1)
    finish(rig, rig.send("move_jr", step))
    rig.step()
    assert rig.state["setpoint_position"][0] == pytest.approx(0.2)


@pytest.mark.parametrize("name", ("servo_jp", "move_jp"))
def test_goals_beyond_the_limits_are_clipped_and_told(rig: Rig, name: str) -> None:
    rig.go((1.5, 0.0, 0.23, 0.0, 0.0, 0.0))
    rig.reports.events.clear()
    request = rig.send(name, (9.0, 0.0, 0.5, 0.0, 0.0, 0.0))
    changes = " 9.000 → 1.588 rad, insertion 0.500 → 0.240 m" if name == "move_jp" else ", insertion"
    assert request.replies[0][1] == f"clipped: yaw{changes}"
    rig.run(4.0)
    assert request.replies[-1] == ("done", f"clipped: yaw{changes}")
    assert rig.state["setpoint_position"][:3] == pytest.approx((1.588, 0.0, 0.24))
    assert len(rig.reports.of("warning")) == 1


def test_clipping_warns_once_an_episode(rig: Rig) -> None:
    for _ in range(200):
        assert rig.send("jaw/servo_jp", (3.0,)).replies == [("done", "clipped: jaw")]
    assert len(rig.reports.of("warning")) == 1
    rig.run(1.0)
    rig.send("jaw/servo_jp", (3.0,))
    assert len(rig.reports.of("warning")) == 2
    assert rig.state["jaw_setpoint_position"] == pytest.approx(1.39626)


def test_a_clipped_joint_gets_no_velocity(rig: Rig) -> None:
    rig.go((1.5, 0.0, 0.12, 0.0, 0.0, 0.0))
    rig.send("servo_jp", (9.0, 0.0, 0.12, 0.0, 0.0, 0.0, 1.0, 0.5, 0.0, 0.0, 0.0, 0.0))
    assert tuple(rig.setpoint["velocity"][:2]) == (0.0, 0.5)


def test_hold_ends_a_move_where_it_is(rig: Rig) -> None:
    move = rig.send("move_jp", (0.8, 0.0, 0.12, 0.0, 0.0, 0.0))
    rig.run(0.3)
    here = rig.io.setpoint[0]
    assert rig.send("hold").outcomes == ["done"]
    rig.run(0.5)
    assert rig.io.setpoint[0] == pytest.approx(here, abs=0.002)
    assert move.outcomes == ["accepted", "failed"]
    assert busy(rig) == [True, False] and rig.reports.of("goal_reached") == [("goal_reached", False)]


def test_a_servo_command_ends_a_move(rig: Rig) -> None:
    move = rig.send("move_jp", (0.8, 0.0, 0.12, 0.0, 0.0, 0.0))
    rig.run(0.3)
    rig.send("servo_jp", (0.2, 0.0, 0.12, 0.0, 0.0, 0.0))
    assert move.outcomes == ["accepted", "failed"] and busy(rig) == [True, False]


def test_efforts_go_through_the_coupling_without_tracking_check(rig: Rig) -> None:
    effort = (0.1, 0.2, 0.3, 0.01, 0.02, 0.03)
    assert rig.send("servo_jf", effort).outcomes == ["done"]
    coupling = np.eye(7)
    coupling[3:, 3:] = rig.document.tool.actuator_to_joint
    assert rig.setpoint["mode"] == 1 and rig.setpoint["in_effort"][:7].all()
    assert rig.setpoint["effort"][:7] == pytest.approx(coupling.T @ (*effort, 0.0))
    rig.run(0.05)
    assert not rig.io.flag("tracking_check") and rig.state["control_mode"] == 3
    rig.io.position[0] += 0.05  # pushed by hand
    rig.step()
    rig.send("hold")
    rig.run(0.05)
    assert rig.io.flag("tracking_check") and rig.setpoint["mode"] == 1 and not rig.setpoint["in_effort"].any()
    assert rig.io.setpoint[0] == pytest.approx(0.05)


def test_free_applies_zero_efforts(rig: Rig) -> None:
    rig.send("free")
    assert rig.setpoint["mode"] == 1 and rig.setpoint["in_effort"][:7].all() and not rig.setpoint["effort"].any()
    assert rig.send("jaw/servo_jf", (0.05,)).outcomes == ["done"]
    assert rig.setpoint["effort"].any()


def test_jaw_commands_need_an_instrument() -> None:
    rig = Rig(bare_arm()).homed()
    for name in ("jaw/servo_jp", "jaw/move_jp", "jaw/servo_jf"):
        assert "no instrument" in rig.send(name, (0.1,)).replies[0][1]


def test_bare_arm_moves_in_seven_joints() -> None:
    rig = Rig(bare_arm()).homed()
    goal = (0.1, 0.2, 0.1, 0.3, -0.3, 0.2, 3.5)
    request = rig.send("move_jp", goal)
    assert request.replies[0] == ("accepted", "clipped: disc_4 3.500 → 3.002 rad")
    finish(rig, request)
    rig.step()
    assert rig.io.setpoint == pytest.approx((*goal[:6], np.radians(172)))


def test_an_instrument_can_be_named_and_nothing_jumps() -> None:
    rig = Rig(bare_arm()).homed()
    before = rig.io.setpoint.copy()
    assert "there are: LARGE_NEEDLE_DRIVER:400006" in rig.send("set_tool_type", (), "SPOON:1").replies[0][1]
    assert rig.send("set_tool_type", (), "LARGE_NEEDLE_DRIVER:400006").outcomes == ["done"]
    rig.run(0.1)
    assert rig.state["count"] == 6 and rig.state["cartesian_valid"]
    assert np.allclose(rig.io.setpoint, before, atol=1e-12)


def test_disable_during_a_move_ends_it_without_an_error(rig: Rig) -> None:
    move = rig.send("move_jp", (0.8, 0.0, 0.12, 0.0, 0.0, 0.0))
    rig.run(0.1)
    rig.state_command("disable")
    assert move.outcomes == ["accepted", "failed"] and rig.setpoint["mode"] == 0
    assert not rig.reports.of("error") and not rig.state["is_busy"]


def test_pause_holds_and_refuses_motion(rig: Rig) -> None:
    rig.send("move_jp", (0.8, 0.0, 0.12, 0.0, 0.0, 0.0))
    rig.run(0.3)
    rig.state_command("pause")
    here = rig.io.setpoint.copy()
    rig.run(0.5)
    assert rig.setpoint["mode"] == 1 and rig.io.flag("pid_enabled")
    assert rig.io.setpoint == pytest.approx(here, abs=0.002)
    assert rig.send("servo_jp", DEEP).outcomes == ["refused"]
    rig.state_command("resume")
    finish(rig, rig.send("move_jp", DEEP))
    rig.step()
    assert rig.state["setpoint_position"][:6] == pytest.approx(DEEP)
