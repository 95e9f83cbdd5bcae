"""The jaw of an instrument: goals, moves and efforts of its own, beside the arm's."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Final

import numpy as np
import pytest

from tests.arm.arm_configs import fixed_arm
from tests.arm.fake_io import ArmHarness
from tests.arm.fake_requests import FakeRequest
from tests.arm.test_psm import DEEP, at, tip_at

FAR: Final = (0.8, 0.3, 0.15, 0.4, 0.0, 0.0)


@pytest.fixture
def harness() -> ArmHarness:
    """Homed, a large needle driver 0.12 m deep."""
    return at(ArmHarness(fixed_arm()).homed(), DEEP)


def test_jaw_goals_are_kept_by_the_arm_and_the_other_way_round(harness: ArmHarness) -> None:
    harness.send("jaw/servo_jp", (0.6,))
    harness.send("servo_jp", (0.01, 0.0, 0.12, 0.0, 0.0, 0.0))
    harness.send("servo_cp", tip_at(harness, 0.1134))
    harness.run(0.1)
    assert harness.state["jaw_setpoint_position"] == pytest.approx(0.6)
    harness.send("jaw/servo_jp", (0.3,))
    harness.run(0.1)
    assert harness.state["setpoint_cp"][2] == pytest.approx(-0.1134, abs=1e-9)
    assert harness.state["jaw_setpoint_position"] == pytest.approx(0.3)


def test_jaw_limits_hold_while_the_tip_is_followed(harness: ArmHarness) -> None:
    harness.send("servo_cp", tip_at(harness, 0.1134))
    assert harness.send("jaw/servo_jp", (-0.9,)).replies == [("done", "clipped: jaw")]
    harness.run(0.2)
    assert harness.state["jaw_setpoint_position"] == pytest.approx(-0.698132)


def jaw_streams(harness: ArmHarness, goals: Iterable[float], cycles: int = 10) -> list[FakeRequest]:
    """Goals for the jaw, each for some cycles."""
    requests = []
    for goal in goals:
        requests.append(harness.send("jaw/servo_jp", (goal,)))
        for _ in range(cycles - 1):
            harness.step()
    return requests


def test_a_jaw_stream_leaves_the_arms_move_as_it_is(harness: ArmHarness) -> None:
    alone = ArmHarness(fixed_arm()).homed()
    for each in (alone, harness):
        at(each, (0.0, 0.0, 0.12, 0.0, 0.0, 0.0))
    moves = [each.send("move_jp", FAR) for each in (alone, harness)]
    path = []
    for k in range(40):
        answers = jaw_streams(harness, (0.01 * k,))
        assert answers[0].outcomes == ["done"]
        alone.run(0.02)
        path.append(np.abs(harness.io.setpoint[:3] - alone.io.setpoint[:3]).max())
        assert harness.state["jaw_setpoint_position"] == pytest.approx(0.01 * k, abs=1e-9)
    assert max(path) < 1e-12 and moves[1].outcomes == ["accepted"]
    harness.until(lambda: moves[1].outcomes[-1] != "accepted")
    assert moves[1].replies[-1] == ("done", "") and harness.state["jaw_setpoint_position"] == pytest.approx(0.39)
    assert harness.arm.control.here[:6] == pytest.approx(FAR)


def test_a_jaw_far_from_its_goal_arrives_after_the_arms_move_without_a_jump(harness: ArmHarness) -> None:
    harness.go((0.0, 0.0, 0.12, 0.0, 0.0, 0.0))
    move = harness.send("move_jp", (0.02, 0.0, 0.12, 0.0, 0.0, 0.0))
    harness.until(lambda: harness.arm.control.motion.end_ns - harness.now_ns < 20_000_000)
    before, steps = harness.state["jaw_setpoint_position"].item(), []
    harness.send("jaw/servo_jp", (1.2,))
    for _ in range(200):
        harness.step()
        steps.append(harness.state["jaw_setpoint_position"].item() - before)
        before += steps[-1]
    assert move.replies[-1] == ("done", "") and before == pytest.approx(1.2)
    assert max(steps) <= 15.0 * harness.period_ns * 1e-9 * 1.001


def test_a_move_of_the_arm_leaves_the_jaws_stream_as_it_is(harness: ArmHarness) -> None:
    jaw_streams(harness, (0.0, 0.02, 0.04))
    harness.send("jaw/servo_jp", (0.5,))
    move = harness.send("move_jp", FAR)
    harness.run(0.1)
    assert move.outcomes == ["accepted"]
    assert harness.state["jaw_setpoint_position"] == pytest.approx(0.5), "at the stream's speed, not the move's"


def test_a_jaw_stream_replaces_the_jaws_move_only(harness: ArmHarness) -> None:
    jaw, arm = harness.send("jaw/move_jp", (1.0,)), harness.send("move_jp", FAR)
    harness.run(0.1)
    here = harness.state["jaw_setpoint_position"].item()
    assert harness.send("jaw/servo_jp", (here + 0.01,)).outcomes == ["done"]
    assert jaw.outcomes == ["accepted", "failed"]
    harness.until(lambda: arm.outcomes[-1] != "accepted")
    assert arm.outcomes == ["accepted", "done"]
    assert harness.state["jaw_setpoint_position"] == pytest.approx(here + 0.01)


def test_a_jaw_move_replaces_the_jaws_stream_only(harness: ArmHarness) -> None:
    arm = harness.send("move_jp", FAR)
    jaw_streams(harness, (0.0, 0.01, 0.02))
    jaw = harness.send("jaw/move_jp", (0.7,))
    harness.until(lambda: arm.outcomes[-1] != "accepted")
    assert jaw.outcomes == arm.outcomes == ["accepted", "done"]
    harness.step()
    assert harness.state["jaw_setpoint_position"] == pytest.approx(0.7)


def test_a_jaw_stream_that_jumps_ends_without_the_arms_move(harness: ArmHarness) -> None:
    arm = harness.send("move_jp", FAR)
    jaw_streams(harness, (0.0, -0.3, -0.69, -0.69, -0.69))
    assert jaw_streams(harness, (1.39, -0.69))[-1].outcomes == ["refused"], "the stream has ended"
    harness.until(lambda: arm.outcomes[-1] != "accepted")
    assert arm.outcomes == ["accepted", "done"]


def test_a_silent_jaw_stream_does_not_stop_the_arms_move() -> None:
    harness = at(ArmHarness(replace(fixed_arm(), client_timeout_s=0.1)).homed(), (0.0, 0.0, 0.12, 0.0, 0.0, 0.0))
    arm = harness.send("move_jp", FAR)
    jaw_streams(harness, (0.0, 0.01))
    harness.until(lambda: arm.outcomes[-1] != "accepted")
    assert arm.outcomes == ["accepted", "done"]


def test_a_jaw_move_goes_on_when_the_arm_is_sent_elsewhere(harness: ArmHarness) -> None:
    jaw = harness.send("jaw/move_jp", (1.0,))
    first = harness.send("move_jp", (0.3, 0.0, 0.12, 0.0, 0.0, 0.0))
    harness.run(0.05)
    second = harness.send("move_jp", (0.1, 0.0, 0.12, 0.0, 0.0, 0.0))
    harness.until(lambda: second.outcomes[-1] == "done")
    assert first.outcomes == ["accepted", "failed"] and jaw.outcomes == ["accepted", "done"]
    harness.step()
    assert harness.state["jaw_position"] == pytest.approx(1.0) and harness.state["position"][0] == pytest.approx(0.1)


def arm_streams(harness: ArmHarness, cycles: int, command: str = "servo_jp") -> list[tuple[float, float, float]]:
    """A goal for the arm in each cycle; yaw's goal, and the setpoints of yaw and jaw in each."""
    path, control = [], harness.arm.control
    for _ in range(cycles):
        joints = list(control.take_goal()[:6])
        joints[0] += 0.0002
        values = (0.0002 / (harness.period_ns * 1e-9), *[0.0] * 5) if command == "servo_jv" else tuple(joints)
        assert harness.send(command, values).outcomes == ["done"]
        path.append((joints[0], control.here[0].item(), control.here[6].item()))
    return path


@pytest.mark.parametrize("command", ["servo_jp", "servo_jv"])
def test_a_jaw_move_beside_a_stream_of_the_arm_lasts_as_long_as_alone_and_leaves_the_stream_as_it_is(
        harness: ArmHarness, command: str) -> None:
    alone = at(ArmHarness(fixed_arm()).homed(), DEEP)
    jaw = alone.send("jaw/move_jp", (1.0,))
    begin_ns = alone.now_ns
    alone.until(lambda: jaw.outcomes[-1] != "accepted")
    arm_streams(harness, 5, command)
    beside = harness.send("jaw/move_jp", (1.0,))
    path = arm_streams(harness, (alone.now_ns - begin_ns) // harness.period_ns + 2, command)
    assert beside.outcomes == ["accepted", "done"] and beside.replies[-1] == ("done", "")
    assert path[-1][2] == pytest.approx(1.0), "the jaw is there"
    assert max(abs(goal - yaw) for goal, yaw, _ in path) < 0.0005, "and yaw at its goal of this or the last cycle"
    steps = np.diff([jaw for *_, jaw in path])
    assert steps.min() >= -1e-12 and steps.max() < 0.02


def test_a_stream_of_the_arm_leaves_the_jaws_move_as_it_is_and_replaces_the_arms(harness: ArmHarness) -> None:
    jaw, arm = harness.send("jaw/move_jp", (1.0,)), harness.send("move_jp", FAR)
    harness.run(0.02)
    path = arm_streams(harness, 5)
    assert arm.outcomes == ["accepted", "failed"] and jaw.outcomes == ["accepted"]
    assert harness.state["is_busy"]
    harness.until(lambda: jaw.outcomes[-1] != "accepted")
    assert jaw.replies[-1] == ("done", "") and harness.arm.control.here[6] == pytest.approx(1.0)
    assert harness.arm.control.here[0] == pytest.approx(path[-1][0])


def test_a_move_of_the_arm_takes_along_the_jaws_move_beside_a_stream(harness: ArmHarness) -> None:
    arm_streams(harness, 5)
    jaw = harness.send("jaw/move_jp", (1.0,))
    arm_streams(harness, 5)
    arm = harness.send("move_jp", FAR)
    harness.until(lambda: arm.outcomes[-1] != "accepted")
    assert arm.outcomes == jaw.outcomes == ["accepted", "done"]
    assert harness.arm.control.here == pytest.approx((*FAR, 1.0))


@pytest.mark.parametrize(("command", "values"), [("hold", ()), ("jaw/servo_jp", (0.2,)), ("servo_jf", (0.0,) * 6)])
def test_a_jaws_move_beside_a_stream_ends_with_whatever_ends_it_alone(
        harness: ArmHarness, command: str, values: tuple[float, ...]) -> None:
    arm_streams(harness, 5)
    jaw = harness.send("jaw/move_jp", (1.0,))
    arm_streams(harness, 5)
    harness.send(command, values)
    harness.run(0.3)
    assert jaw.outcomes == ["accepted", "failed"] and not harness.state["is_busy"]
    assert harness.arm.control.here[6] < 0.5


def test_a_changed_ratio_applies_to_the_rest_of_a_jaws_move_beside_a_stream(harness: ArmHarness) -> None:
    arm_streams(harness, 5)
    harness.send("jaw/move_jp", (1.0,))
    arm_streams(harness, 5)
    before = harness.arm.control.motion.end_ns
    harness.send("trajectory_j/set_ratio", (0.1,))
    assert harness.arm.control.motion.end_ns > before + 100_000_000


def test_a_jaw_effort_begins_cartesian_effort_control(harness: ArmHarness) -> None:
    assert harness.send("jaw/servo_jf", (0.05,)).outcomes == ["done"]
    harness.step()
    assert harness.state["control_mode"] == 3 and harness.state["control_space"] == 2
    to_disc = np.eye(7)
    to_disc[3:, 3:] = harness.document.tool.actuator_to_joint
    assert harness.setpoint["effort"][:7] == pytest.approx(to_disc.T @ np.array((0, 0, 0, 0, 0, 0, 0.05)))
    harness.send("body/servo_cf", (0.0, 0.0, 1.0, 0.0, 0.0, 0.0))
    effort = np.linalg.inv(to_disc.T) @ harness.setpoint["effort"][:7]
    assert effort[6] == pytest.approx(0.05) and np.abs(effort[:6]).max() > 0.5
    harness.send("hold")
    harness.run(0.01)
    harness.send("free")
    assert not harness.setpoint["effort"].any(), "leaving effort mode has cleared the jaw's"


def test_a_jaw_effort_is_refused_in_the_cannula_and_kept_from_other_efforts() -> None:
    harness = at(ArmHarness(fixed_arm()).homed(), (0.0, 0.0, 0.05, 0.0, 0.0, 0.0))
    assert "past the cannula" in harness.send("jaw/servo_jf", (0.05,)).replies[0][1]
    harness.send("servo_jf", (0.0, 0.0, 0.5, 0.0, 0.0, 0.0))
    assert harness.send("jaw/servo_jf", (0.05,)).outcomes == ["done"]
    assert harness.state["control_space"] == 1 and harness.setpoint["effort"][2] == pytest.approx(0.5)
