"""Streams to an arm: how far a goal may be, and what ends a stream. Who may stream: test_stream_owners.py."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.arm.arm_configs import fixed_arm
from tests.arm.fake_io import PERIOD_NS, ArmHarness
from tests.arm.fake_requests import FakeRequest
from trocar.procs.node.requests import STREAM_PAUSE_NS
from trocar.procs.node.streams import STREAM_NS
from trocar.shm.mailbox.origins import Origin, SenderId

MS = 1_000_000
DEEP = np.array((0.0, 0.0, 0.12, 0.0, 0.0, 0.0))
FASTEST = 2.2 * PERIOD_NS * 1e-9 * 1.001  # rad a cycle, of yaw
OTHER, THIRD = SenderId(1), SenderId(2)


@pytest.fixture
def harness() -> ArmHarness:
    made = ArmHarness(fixed_arm()).homed()
    made.go(DEEP)
    made.reports.events.clear()
    made.io.largest_step = 0.0
    return made


def at(yaw: float, insertion: float = 0.12) -> np.ndarray:
    return np.array((yaw, 0.0, insertion, 0.0, 0.0, 0.0))


def ask(harness: ArmHarness, sender: SenderId, name: str, values: Any = (), text: str = "") -> FakeRequest:
    """A command of some program."""
    request = FakeRequest(name, values, text, origin=Origin(1, 0, f"program {sender.place}"), sender=sender)
    harness.step(request)
    return request


def refused(harness: ArmHarness, name: str, values: np.ndarray) -> str:
    harness.io.largest_step = 0.0
    answer = harness.send(name, values)
    assert answer.outcomes == ["refused"], answer.replies
    harness.step()
    assert harness.io.largest_step < 0.0011
    return answer.replies[0][1]


def stream(harness: ArmHarness, count: int = 100, start: float = 0.0) -> float:
    """Goals of one program, 0.5 rad/s; the last yaw."""
    for k in range(count):
        assert harness.send("servo_jp", at(start + 0.001 * k)).outcomes == ["done"]
    return start + 0.001 * (count - 1)


def warnings(harness: ArmHarness) -> list[str]:
    return [e[1] for e in harness.reports.of("warning")]


def test_a_stream_that_was_held_up_does_not_make_the_arm_jump(harness: ArmHarness) -> None:
    stream(harness)
    harness.run(1.5)
    text = refused(harness, "servo_jp", at(0.6))
    assert text == ("servo_jp: yaw is 0.501 rad from the setpoint; 0.22 rad is allowed: move there first "
                    "(move_jp, move_cp)")
    for k in range(100):
        refused(harness, "servo_jp", at(0.6 + 0.001 * k))
    assert harness.io.setpoint[0] == pytest.approx(0.099) and harness.io.largest_step < 0.0011
    assert warnings(harness) == ["stream-jump"]


def test_a_refused_stream_is_followed_once_its_goals_are_near_the_arm(harness: ArmHarness) -> None:
    refused(harness, "servo_jp", at(0.5))
    yaw = 0.5
    while harness.send("servo_jp", at(yaw)).outcomes != ["done"]:
        yaw -= 0.001
    assert 0.2 < yaw < 0.22
    harness.run(0.3)
    assert harness.io.setpoint[0] == yaw and harness.io.largest_step <= FASTEST


def test_a_move_there_brings_them_together(harness: ArmHarness) -> None:
    refused(harness, "servo_jp", at(0.5))
    harness.go(at(0.5))
    assert harness.send("servo_jp", at(0.51)).outcomes == ["done"]
    harness.send("hold")
    assert harness.send("servo_jp", at(0.51)).outcomes == ["done"]


def test_what_a_hand_types_is_gone_to_at_a_bounded_speed(harness: ArmHarness) -> None:
    for yaw in (0.2, 0.3, 0.15):
        assert harness.send("servo_jp", at(yaw)).outcomes == ["done"]
        harness.run(2.0)
        assert harness.io.setpoint[0] == pytest.approx(yaw) and harness.io.largest_step <= FASTEST
    for _ in range(5):
        assert harness.send("servo_jr", at(0.1, 0.0)).outcomes == ["done"]
        harness.run(0.3)
    assert harness.io.setpoint[0] == pytest.approx(0.65) and harness.io.largest_step <= FASTEST
    assert "yaw is 0.3 rad" in refused(harness, "servo_jr", at(0.3, 0.0)) and warnings(harness) == ["stream-jump"]


def test_a_wrong_number_is_refused_near_a_limit_too(harness: ArmHarness) -> None:
    harness.go((1.5, 0.0, 0.12, 0.0, 0.0, 0.0))
    assert "yaw is 1e+06 rad from the setpoint" in refused(harness, "servo_jp", at(1e6))
    assert harness.io.setpoint[0] == pytest.approx(1.5)
    yaw = 1.5
    while yaw < 2.0:
        yaw += 0.001
        assert harness.send("servo_jp", at(yaw)).outcomes == ["done"], "a running stream may pass a limit"
    assert harness.state["setpoint_position"][0] == pytest.approx(1.588, abs=0.01)


def test_units_and_joints_are_named(harness: ArmHarness) -> None:
    assert "insertion is 0.06 m from the setpoint" in refused(harness, "servo_jp", at(0.0, 0.18))
    assert "0.045 m is allowed" in harness.reports.of("warning")[0][2]


def test_three_wrong_goals_in_a_running_stream_end_it_and_the_arm_holds(harness: ArmHarness) -> None:
    yaw = stream(harness)
    for wrong in (0.8, -0.8, 1e6):
        answer = harness.send("servo_jp", at(yaw + wrong))
        assert answer.outcomes == ["refused"]
    assert "yaw is 0.8 rad from the setpoint" in answer.replies[0][1], "why it ended, not what came after"
    for k in range(200):
        answer = harness.send("servo_jp", at(yaw + 0.001 * k))
        assert answer.outcomes == ["refused"] and "this stream has ended: it jumped: yaw is 0.8" in answer.replies[0][1]
    assert harness.io.setpoint[0] == pytest.approx(yaw) and harness.io.largest_step < 0.0011
    assert warnings(harness) == ["stream-jump", "stream-refused"]
    harness.run(0.5)
    assert harness.send("servo_jp", at(yaw + 0.01)).outcomes == ["done"]


def test_goals_of_a_second_program_cannot_end_a_stream(harness: ArmHarness) -> None:
    for k in range(100):
        assert harness.send("servo_jp", at(0.001 * k)).outcomes == ["done"]
        if k in (50, 60, 70):
            wrong = ask(harness, OTHER, "servo_jp", at(0.8))
            assert wrong.outcomes == ["refused"] and "is streaming positions" in wrong.replies[0][1]
    harness.step()
    assert harness.io.setpoint[0] == pytest.approx(0.099) and harness.io.largest_step < 0.0021


def test_hold_of_another_program_ends_a_stream_for_good(harness: ArmHarness) -> None:
    stream(harness, 52)
    assert ask(harness, OTHER, "hold").outcomes == ["done"]
    held = harness.io.setpoint[0]
    for k in range(52, 300):
        answer = harness.send("servo_jp", at(0.001 * k))
        assert answer.outcomes == ["refused"] and "program 1 stopped the arm (hold)" in answer.replies[0][1]
    assert harness.io.setpoint[0] == held == pytest.approx(0.05, abs=0.002)
    assert ask(harness, OTHER, "servo_jp", at(held + 0.01)).outcomes == ["done"]


def test_a_program_that_holds_may_stream_at_once(harness: ArmHarness) -> None:
    yaw = stream(harness)
    assert harness.send("hold").outcomes == ["done"]
    stream(harness, 50, yaw)


def test_a_stream_stays_ended_across_pause_and_resume(harness: ArmHarness) -> None:
    stream(harness, 50)
    ask(harness, OTHER, "state_command", text="pause")
    ask(harness, OTHER, "state_command", text="resume")
    for _ in range(300):
        assert harness.send("servo_jp", at(0.05)).outcomes == ["refused"]
    assert harness.arm.state == "HOMED"
    harness.run(0.5)
    assert harness.send("servo_jp", at(0.05)).outcomes == ["done"]


def test_end_stream_holds_for_the_program_whose_stream_it_is(harness: ArmHarness) -> None:
    yaw = stream(harness)
    harness.send("servo_jp", at(yaw + 0.1))
    assert ask(harness, OTHER, "end_stream").outcomes == ["done"]
    harness.run(0.01)
    before = harness.io.setpoint[0]
    assert harness.send("end_stream").outcomes == ["done"]
    harness.run(0.05)
    assert before < harness.io.setpoint[0] < yaw + 0.1 - 0.02, "it holds on the way"
    assert ask(harness, OTHER, "servo_jp", at(harness.io.setpoint[0])).outcomes == ["done"], "it may begin at once"


def test_a_late_end_stream_does_not_end_the_successor(harness: ArmHarness) -> None:
    stream(harness)
    harness.send("end_stream")
    for k in range(100):
        assert ask(harness, OTHER, "servo_jp", at(0.099 - 0.001 * k)).outcomes == ["done"]
        if k % 10 == 0:
            assert harness.send("end_stream").outcomes == ["done"]
    assert ask(harness, OTHER, "servo_jp", at(0.0)).outcomes == ["done"]
    move = ask(harness, THIRD, "move_jp", at(0.3))
    harness.run(0.1)
    for sender in (OTHER, SenderId(0)):
        assert ask(harness, sender, "end_stream").outcomes == ["done"]
    harness.until(lambda: move.outcomes[-1] != "accepted")
    assert move.outcomes[-1] == "done"


@pytest.mark.parametrize("state", ("DISABLED", "ENABLED", "PAUSED", "FAULT"))
def test_end_stream_is_never_refused(state: str) -> None:
    harness = ArmHarness(fixed_arm())
    harness.reach(state)
    assert harness.send("end_stream").outcomes == ["done"] and harness.arm.state == state


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
    harness.run(0.6)
    harness.send("servo_jv", at(0.1, 0.0))
    refused(harness, "servo_jp", at(0.9))


def test_the_ratio_of_moves_is_not_about_streams(harness: ArmHarness) -> None:
    harness.send("trajectory_j/set_ratio", (0.1,))
    assert harness.send("servo_jp", at(0.2)).outcomes == ["done"]


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
    for k in range(100):
        assert harness.send("servo_jp", at(0.001 * k)).outcomes == ["done"]
        assert ask(harness, OTHER, "jaw/servo_jp", (0.005 * k,)).outcomes == ["done"]
    assert ask(harness, OTHER, "jaw/servo_jp", (-0.698,)).outcomes == ["done"], "0.08 s at the jaw's largest speed"
    for k in range(100, 150):
        assert harness.send("servo_jp", at(0.001 * k)).outcomes == ["done"]
    harness.step()
    assert harness.io.setpoint[0] == pytest.approx(0.149)


def test_a_stream_that_is_too_fast_is_slowed_and_then_ends(harness: ArmHarness) -> None:
    yaw, answers = 0.0, []
    for _ in range(200):
        yaw += 0.006  # 3 rad/s; the joint may go 2.2
        answers.append(harness.send("servo_jp", at(yaw)).outcomes[0])
    assert answers[:100] == ["done"] * 100 and answers[-1] == "refused"
    assert harness.io.largest_step <= FASTEST and harness.arm.state == "HOMED"
    assert warnings(harness) == ["speed-limited", "stream-jump", "stream-refused"]
    assert "yaw follows at its largest speed, 2.2 rad/s" in harness.reports.of("warning")[0][2]


def test_velocities_pass_the_same_bounds(harness: ArmHarness) -> None:
    for _ in range(10):
        answer = harness.send("servo_jv", (100.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    assert answer.outcomes == ["refused"] and "yaw is commanded faster than 2.2 rad/s" in answer.replies[0][1]
    harness.run(0.1)
    assert harness.io.largest_step <= FASTEST and harness.arm.state == "HOMED"
    assert abs(harness.io.setpoint[0]) < 0.02 and not harness.setpoint["has_velocity"]
    assert warnings(harness) == ["speed-limited", "stream-jump", "stream-refused"]


def test_velocities_within_the_bounds_are_gone_at_exactly(harness: ArmHarness) -> None:
    for _ in range(100):
        assert harness.send("servo_jv", (1.0, 0.0, 0.0, 0.0, 0.0, 0.0)).outcomes == ["done"]
    harness.step()
    assert harness.io.setpoint[0] == pytest.approx(0.2, abs=0.003) and not warnings(harness)
    assert harness.setpoint["velocity"][0] == 1.0


def test_numbers_out_of_this_world_are_refused_and_the_arm_holds(harness: ArmHarness) -> None:
    yaw = stream(harness)
    for wrong in (1e6, -1e100, np.nan, np.inf):
        for name in ("servo_jp", "servo_jr", "servo_jv"):
            harness.send(name, (0.0, wrong, 0.0, 0.0, 0.0, 0.0))
        harness.send("jaw/servo_jp", (wrong,))
    harness.run(0.2)
    assert harness.arm.state == "HOMED" and harness.io.setpoint[0] == pytest.approx(yaw)
    assert np.isfinite(harness.io.setpoint).all() and harness.io.largest_step < 0.08


# the base frame

def base(x: float, turn: float = 0.0) -> tuple[float, ...]:
    return (x, 0.0, 0.0, 0.0, 0.0, float(np.sin(turn / 2)), float(np.cos(turn / 2)))


@pytest.mark.parametrize(("x", "turn"), ((0.03, 0.0), (0.0, 0.2)))
def test_a_step_of_the_base_frame_ends_a_stream_of_poses(harness: ArmHarness, x: float, turn: float) -> None:
    harness.send("set_base_frame", base(0.0), "table")
    pose = harness.state["setpoint_cp"].copy()
    for _ in range(50):
        assert harness.send("servo_cp", pose).outcomes == ["done"]
    before = harness.io.setpoint.copy()
    harness.io.largest_step = 0.0
    ask(harness, OTHER, "set_base_frame", base(x, turn), "table")
    for _ in range(50):
        answer = harness.send("servo_cp", pose)
        assert answer.outcomes == ["refused"] and "the base frame moved by" in answer.replies[0][1]
    assert harness.io.setpoint == pytest.approx(before, abs=1e-9) and harness.io.largest_step < 1e-9


def test_a_base_frame_that_moves_smoothly_is_followed(harness: ArmHarness) -> None:
    harness.send("set_base_frame", base(0.0), "table")
    pose = harness.state["setpoint_cp"].copy()
    for k in range(200):
        ask(harness, OTHER, "set_base_frame", base(0.0001 * k), "table")  # 25 mm/s
        assert harness.send("servo_cp", pose).outcomes == ["done"]
    assert harness.io.setpoint[0] != 0.0 and harness.io.largest_step <= FASTEST


def test_a_base_frame_that_moves_by_many_small_steps_at_once_has_moved_by_one(harness: ArmHarness) -> None:
    harness.send("set_base_frame", base(0.0), "table")
    pose = harness.state["setpoint_cp"].copy()
    harness.send("servo_cp", pose)
    outcomes = []
    for k in range(8):
        harness.step(FakeRequest("set_base_frame", base(0.001 * k), "table"), FakeRequest("servo_cp", pose))
        outcomes += harness.send("servo_cp", pose).outcomes
    assert outcomes == ["done"] * 6 + ["refused"] * 2


def test_joint_goals_go_on_across_a_step_of_the_base_frame(harness: ArmHarness) -> None:
    stream(harness, 50)
    harness.send("set_base_frame", base(0.03), "table")
    stream(harness, 50, 0.05)


def test_another_instrument_ends_every_stream(harness: ArmHarness) -> None:
    stream(harness, 50)
    harness.arm.control.use(harness.arm.joints)
    assert "the instrument was changed" in refused(harness, "servo_jp", at(0.05))
    assert STREAM_NS < STREAM_PAUSE_NS


def test_an_ended_stream_does_not_begin_anew_because_its_bridge_stalled(harness: ArmHarness) -> None:
    bridge, pid = SenderId(3, 1), 4711

    def goal(count: int) -> FakeRequest:
        request = FakeRequest("servo_jp", at(0.0), origin=Origin(pid << 32 | count, 0, "ros_bridge"), sender=bridge)
        request.pid = pid
        harness.step(request)
        return request

    assert goal(1).outcomes == ["done"]
    ask(harness, OTHER, "hold")
    assert goal(1).outcomes == ["refused"]
    harness.run(2 * STREAM_PAUSE_NS * 1e-9)
    assert goal(1).outcomes == ["refused"], "the bridge has seen no pause of its client"
    harness.run(2 * STREAM_PAUSE_NS * 1e-9)
    assert goal(2).outcomes == ["done"]
    harness.run(2 * STREAM_PAUSE_NS * 1e-9)
    ask(harness, OTHER, "hold")
    assert goal(2).outcomes == ["refused"], "the stop came during the stall"
