"""The first goal of a stream, and the first one after a gap: not further off than a joint goes in 0.1 s."""

from __future__ import annotations

import numpy as np
import pytest

from tests.arm.fake_io import Rig, fixed_arm

DEEP = np.array((0.0, 0.0, 0.12, 0.0, 0.0, 0.0))
YAW = 0.15707963  # what 90°/s make in 0.1 s


@pytest.fixture
def rig() -> Rig:
    made = Rig(fixed_arm()).homed()
    made.go(DEEP)
    made.reports.events.clear()
    made.io.largest_step = 0.0
    return made


def at(yaw: float, insertion: float = 0.12) -> np.ndarray:
    return np.array((yaw, 0.0, insertion, 0.0, 0.0, 0.0))


def refused(rig: Rig, name: str, values: np.ndarray) -> str:
    rig.io.largest_step = 0.0
    answer = rig.send(name, values)
    assert answer.outcomes == ["refused"], answer.replies
    rig.step()
    assert rig.io.largest_step < 0.0011
    return answer.replies[0][1]


def test_a_stream_that_was_held_up_does_not_make_the_arm_jump(rig: Rig) -> None:
    for k in range(100):
        assert rig.send("servo_jp", at(0.001 * k)).outcomes == ["done"]
    rig.run(1.5)
    text = refused(rig, "servo_jp", at(0.6))
    assert text == ("servo_jp: yaw is 0.501 rad from the set-point; where a stream begins, or after a gap in it, "
                    "0.157 rad is allowed: move there first (move_jp, move_cp)")
    for k in range(100):
        refused(rig, "servo_jp", at(0.6 + 0.001 * k))
    assert rig.io.setpoint[0] == pytest.approx(0.099) and rig.io.largest_step < 0.0011
    assert len([e for e in rig.reports.of("warning") if e[1] == "stream-jump"]) == 1


def test_a_refused_stream_is_followed_again_once_its_goals_are_where_the_arm_is(rig: Rig) -> None:
    rig.send("servo_jp", at(0.0))
    rig.run(1.0)
    refused(rig, "servo_jp", at(0.5))
    for yaw in np.arange(0.499, 0.0, -0.001):  # it comes back by itself, and is not jumped at from afar
        answer = rig.send("servo_jp", at(yaw))
        if answer.outcomes == ["done"]:
            break
    assert 0.0 < yaw < 0.01
    assert rig.send("servo_jp", at(yaw + 0.1)).outcomes == ["done"], "a stream is followed as it is"


def test_a_move_there_brings_them_together(rig: Rig) -> None:
    refused(rig, "servo_jp", at(0.5))
    rig.go(at(0.5))
    assert rig.send("servo_jp", at(0.51)).outcomes == ["done"]
    rig.send("hold")
    assert rig.send("servo_jp", at(0.51)).outcomes == ["done"]


def test_what_a_hand_types_is_followed(rig: Rig) -> None:
    for yaw in (0.15, 0.3, 0.2):
        assert rig.send("servo_jp", at(yaw)).outcomes == ["done"]
        rig.run(2.0)
    for _ in range(5):
        assert rig.send("servo_jr", at(0.1, 0.0)).outcomes == ["done"]
        rig.run(0.3)
    assert rig.io.setpoint[0] == pytest.approx(0.7)
    assert "yaw is 0.3 rad" in refused(rig, "servo_jr", at(0.3, 0.0))


def test_after_every_other_motion_a_stream_begins(rig: Rig) -> None:
    for _ in range(5):
        rig.send("servo_jp", at(0.0))
    for command in ("hold", "free"):
        rig.send(command)
        refused(rig, "servo_jp", at(0.5))
        rig.run(0.2)
        rig.send("servo_jp", at(0.0))
    rig.send("move_jp", at(0.1))
    refused(rig, "servo_jp", at(0.9))
    rig.send("servo_jv", at(0.1, 0.0))
    refused(rig, "servo_jp", at(0.9))


def test_units_and_joints_are_named(rig: Rig) -> None:
    assert "insertion is 0.05 m from the set-point" in refused(rig, "servo_jp", at(0.0, 0.17))
    assert "0.02 m is allowed" in rig.reports.of("warning")[0][2]


def test_the_ratio_of_moves_is_not_about_streams(rig: Rig) -> None:
    rig.send("trajectory_j/set_ratio", (0.1,))
    assert rig.send("servo_jp", at(0.99 * YAW)).outcomes == ["done"]


def test_poses_are_judged_by_their_joints(rig: Rig) -> None:
    pose = rig.state["setpoint_cp"].copy()
    assert rig.send("servo_cp", pose).outcomes == ["done"]
    rig.run(0.5)
    pose[1] += 0.06
    assert "is 0." in refused(rig, "servo_cp", pose)
    pose[1] -= 0.05
    rig.run(0.2)
    assert rig.send("servo_cp", pose).outcomes == ["done"]


def test_the_jaw_is_a_stream_of_its_own(rig: Rig) -> None:
    jaw = float(rig.state["jaw_setpoint_position"])
    for k in range(10):
        rig.send("servo_jp", at(0.001 * k))
    assert rig.send("jaw/servo_jp", (jaw,)).outcomes == ["done"]
    assert rig.send("jaw/servo_jp", (1.3,)).outcomes == ["done"], "part of a stream"
    rig.run(0.2)
    rig.send("servo_jp", at(0.01))
    assert rig.send("jaw/servo_jp", (-0.6,)).outcomes == ["refused"]
    rig.run(0.2)
    for _ in range(5):
        rig.send("jaw/servo_jp", (1.2,))
    refused(rig, "servo_jp", at(0.9))
