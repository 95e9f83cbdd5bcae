"""The first goal of a stream, and the first one after a gap: not further off than a joint goes in 0.1 s."""

from __future__ import annotations

import numpy as np
import pytest

from tests.arm.arm_configs import fixed_arm
from tests.arm.fake_io import ArmHarness

DEEP = np.array((0.0, 0.0, 0.12, 0.0, 0.0, 0.0))
YAW = 0.15707963  # what 90°/s make in 0.1 s


@pytest.fixture
def harness() -> ArmHarness:
    made = ArmHarness(fixed_arm()).homed()
    made.go(DEEP)
    made.reports.events.clear()
    made.io.largest_step = 0.0
    return made


def at(yaw: float, insertion: float = 0.12) -> np.ndarray:
    return np.array((yaw, 0.0, insertion, 0.0, 0.0, 0.0))


def refused(harness: ArmHarness, name: str, values: np.ndarray) -> str:
    harness.io.largest_step = 0.0
    answer = harness.send(name, values)
    assert answer.outcomes == ["refused"], answer.replies
    harness.step()
    assert harness.io.largest_step < 0.0011
    return answer.replies[0][1]


def test_a_stream_that_was_held_up_does_not_make_the_arm_jump(harness: ArmHarness) -> None:
    for k in range(100):
        assert harness.send("servo_jp", at(0.001 * k)).outcomes == ["done"]
    harness.run(1.5)
    text = refused(harness, "servo_jp", at(0.6))
    assert text == ("servo_jp: yaw is 0.501 rad from the setpoint; where a stream begins, or after a gap in it, "
                    "0.157 rad is allowed: move there first (move_jp, move_cp)")
    for k in range(100):
        refused(harness, "servo_jp", at(0.6 + 0.001 * k))
    assert harness.io.setpoint[0] == pytest.approx(0.099) and harness.io.largest_step < 0.0011
    assert len([e for e in harness.reports.of("warning") if e[1] == "stream-jump"]) == 1


def test_a_refused_stream_is_followed_again_once_its_goals_are_where_the_arm_is(harness: ArmHarness) -> None:
    harness.send("servo_jp", at(0.0))
    harness.run(1.0)
    refused(harness, "servo_jp", at(0.5))
    for yaw in np.arange(0.499, 0.0, -0.001):  # it comes back by itself, and is not jumped at from afar
        answer = harness.send("servo_jp", at(yaw))
        if answer.outcomes == ["done"]:
            break
    assert 0.0 < yaw < 0.01
    assert harness.send("servo_jp", at(yaw + 0.1)).outcomes == ["done"], "a stream is followed as it is"


def test_a_move_there_brings_them_together(harness: ArmHarness) -> None:
    refused(harness, "servo_jp", at(0.5))
    harness.go(at(0.5))
    assert harness.send("servo_jp", at(0.51)).outcomes == ["done"]
    harness.send("hold")
    assert harness.send("servo_jp", at(0.51)).outcomes == ["done"]


def test_what_a_hand_types_is_followed(harness: ArmHarness) -> None:
    for yaw in (0.15, 0.3, 0.2):
        assert harness.send("servo_jp", at(yaw)).outcomes == ["done"]
        harness.run(2.0)
    for _ in range(5):
        assert harness.send("servo_jr", at(0.1, 0.0)).outcomes == ["done"]
        harness.run(0.3)
    assert harness.io.setpoint[0] == pytest.approx(0.7)
    assert "yaw is 0.3 rad" in refused(harness, "servo_jr", at(0.3, 0.0))


def test_after_every_other_motion_a_stream_begins(harness: ArmHarness) -> None:
    for _ in range(5):
        harness.send("servo_jp", at(0.0))
    for command in ("hold", "free"):
        harness.send(command)
        refused(harness, "servo_jp", at(0.5))
        harness.run(0.2)
        harness.send("servo_jp", at(0.0))
    harness.send("move_jp", at(0.1))
    refused(harness, "servo_jp", at(0.9))
    harness.send("servo_jv", at(0.1, 0.0))
    refused(harness, "servo_jp", at(0.9))


def test_units_and_joints_are_named(harness: ArmHarness) -> None:
    assert "insertion is 0.05 m from the setpoint" in refused(harness, "servo_jp", at(0.0, 0.17))
    assert "0.02 m is allowed" in harness.reports.of("warning")[0][2]


def test_the_ratio_of_moves_is_not_about_streams(harness: ArmHarness) -> None:
    harness.send("trajectory_j/set_ratio", (0.1,))
    assert harness.send("servo_jp", at(0.99 * YAW)).outcomes == ["done"]


def test_poses_are_judged_by_their_joints(harness: ArmHarness) -> None:
    pose = harness.state["setpoint_cp"].copy()
    assert harness.send("servo_cp", pose).outcomes == ["done"]
    harness.run(0.5)
    pose[1] += 0.06
    assert "is 0." in refused(harness, "servo_cp", pose)
    pose[1] -= 0.05
    harness.run(0.2)
    assert harness.send("servo_cp", pose).outcomes == ["done"]


def test_the_jaw_is_a_stream_of_its_own(harness: ArmHarness) -> None:
    jaw = float(harness.state["jaw_setpoint_position"])
    for k in range(10):
        harness.send("servo_jp", at(0.001 * k))
    assert harness.send("jaw/servo_jp", (jaw,)).outcomes == ["done"]
    assert harness.send("jaw/servo_jp", (1.3,)).outcomes == ["done"], "part of a stream"
    harness.run(0.2)
    harness.send("servo_jp", at(0.01))
    assert harness.send("jaw/servo_jp", (-0.6,)).outcomes == ["refused"]
    harness.run(0.2)
    for _ in range(5):
        harness.send("jaw/servo_jp", (1.2,))
    refused(harness, "servo_jp", at(0.9))
