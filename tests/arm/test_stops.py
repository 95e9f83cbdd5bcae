"""Who stopped an arm, and the end of a stream, which is no stop: it is nothing to other programs."""

from __future__ import annotations

import numpy as np
import pytest

from tests.arm.arm_configs import fixed_arm
from tests.arm.fake_io import ArmHarness
from tests.arm.fake_master import MasterHarness
from tests.arm.fake_requests import FakeRequest
from tests.cases import cases
from trocar.shm.mailbox.origins import Origin, SenderId

DEEP = np.array((0.0, 0.0, 0.12, 0.0, 0.0, 0.0))
WE, OTHERS = SenderId(3), SenderId(4)


@pytest.fixture
def harness() -> ArmHarness:
    made = ArmHarness(fixed_arm()).homed()
    made.go(DEEP)
    return made


def send(harness: ArmHarness, name: str, values: object = (), sender: SenderId = WE) -> FakeRequest:
    request = FakeRequest(name, values, sender=sender)
    harness.step(request)
    return request


@pytest.mark.parametrize(("name", "text", "stops"), [
    ("hold", "", True), ("state_command", "pause", True), ("state_command", "disable", True),
    ("state_command", "resume", False), ("end_stream", "", False), ("servo_jf", "", False)])
def test_stops_are_counted_with_who_sent_them(harness: ArmHarness, name: str, text: str, stops: bool) -> None:
    harness.step(FakeRequest(name, np.zeros(6) if name == "servo_jf" else (), text, origin=Origin(7, 0, "plan.py")))
    assert harness.state["stops"] == stops
    assert harness.state["stopped_by"] == (f"plan.py ({name} {text}".rstrip().encode() + b")" if stops else b"")


def test_a_new_process_counts_stops_from_the_beginning(harness: ArmHarness) -> None:
    harness.send("hold")
    harness.start_arm()
    harness.step()
    assert harness.state["stops"] == 0 and harness.state["stopped_by"] == b""


def test_a_stream_ends_by_its_own_programs_word_only(harness: ArmHarness) -> None:
    send(harness, "body/servo_cf", np.zeros(6))
    assert send(harness, "end_stream", sender=OTHERS).outcomes == ["done"] and harness.state["control_mode"] == 3
    assert send(harness, "end_stream").outcomes == ["done"] and harness.state["control_mode"] == 1


def test_a_move_ends_where_it_is_by_its_own_programs_word_only(harness: ArmHarness) -> None:
    move = send(harness, "move_jp", DEEP + (0.5, 0, 0, 0, 0, 0))
    harness.run(0.2)
    assert send(harness, "end_stream", sender=OTHERS).outcomes == ["done"] and harness.state["is_busy"]
    assert send(harness, "end_stream").outcomes == ["done"]
    harness.run(0.5)
    assert move.outcomes == ["accepted", "failed"] and 0.0 < harness.io.setpoint[0] < 0.4


def test_what_a_successor_does_is_not_ended_by_a_late_word(harness: ArmHarness) -> None:
    send(harness, "body/servo_cf", np.zeros(6))
    send(harness, "body/servo_cf", np.zeros(6), OTHERS)
    send(harness, "end_stream")
    assert harness.state["control_mode"] == 3


@cases("state", ["DISABLED", "POWERING", "ENABLED", "HOMING", "PAUSED", "FAULT"])
def test_the_end_of_a_stream_is_never_refused(state: str) -> None:
    harness = ArmHarness(fixed_arm())
    harness.reach(state)
    request = harness.send("end_stream")
    assert request.outcomes == ["done"] and harness.arm.state == state


def test_a_master_that_was_let_go_with_its_orientation_locked_is_held_again_by_the_same_program() -> None:
    harness = MasterHarness().homed()
    for name in ("body/servo_cf", "lock_orientation"):
        assert send(harness, name, np.zeros(6) if name == "body/servo_cf" else ()).outcomes == ["done"]
    assert harness.state["control_mode"] == 3
    send(harness, "end_stream", sender=OTHERS)
    assert harness.state["control_mode"] == 3
    send(harness, "end_stream")
    assert harness.state["control_mode"] == 1


@pytest.mark.parametrize("name", ["hold", "free"])
def test_what_another_program_made_of_it_is_left(harness: ArmHarness, name: str) -> None:
    send(harness, "body/servo_cf", np.zeros(6))
    send(harness, name, sender=OTHERS)
    mode = harness.state["control_mode"].copy()
    send(harness, "end_stream")
    assert harness.state["control_mode"] == mode
