"""What goes wrong, and the way back."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.arm.fake_io import ArmHarness
from tests.cases import cases
from trocar.procs.arm import arm
from trocar.procs.arm.states import TRANSITIONS, ArmEvent, ArmState


def latch(harness: ArmHarness) -> None:
    harness.io.flag("fault", 7)
    harness.io.flag("pid_enabled", False)


def fall_silent(harness: ArmHarness) -> None:
    harness.io.deaf = True


CAUSES = {
    "power-lost": (lambda harness: harness.io.drop_power(), "detected power loss"),
    "io-fault": (latch, "fault number 7"),
    "io-timeout": (fall_silent, "io does not answer"),
    "io-restarted": (lambda harness: harness.io.restart(), "io was restarted"),
    "pid-off": (lambda harness: harness.io.flag("pid_enabled", False), "joint controller was switched off"),
    "pid-on-again": (lambda harness: harness.io.flag("pid_generation", 8), "switched off and on"),
    "bias-changed": (lambda harness: harness.io.flag("bias_generation", 9), "encoders were set again"),
}


@cases("code", CAUSES)
@cases("during_move", (False, True))
def test_every_cause_leads_to_fault_with_its_reason_and_enable_back(code: str, during_move: bool) -> None:
    break_it, words = CAUSES[code]
    harness = ArmHarness().homed()
    move = harness.send("move_jp", (0.5, 0.0, 0.1, 0.0, 0.0, 0.0)) if during_move else None
    harness.run(0.05)
    break_it(harness)
    harness.until(lambda: harness.arm.state == "FAULT", 0.05)
    errors = harness.reports.of("error")
    assert len(errors) == 1 and errors[0][1] == code.replace("on-again", "off") and words in errors[0][2]
    assert harness.state.text("state") == "FAULT" and not harness.state["is_homed"] and not harness.state["is_busy"]
    assert harness.setpoint["mode"] == 0
    if move is not None:
        assert move.outcomes == ["accepted", "failed"]
        assert ("goal_reached", False) in harness.reports.events
    harness.io.deaf = False
    harness.run(0.3)
    assert not harness.io.flag("power_requested") and not harness.io.flag("pid_enabled")
    assert len(harness.reports.of("error")) == 1
    enable = harness.state_command("enable")
    harness.until(lambda: "done" in enable.outcomes, 7.0)
    harness.state_command("home")
    harness.until(lambda: harness.arm.state == "HOMED")


def test_an_io_that_stalled_was_not_restarted() -> None:
    harness = ArmHarness().homed()
    harness.io.restart()
    harness.io.stall = "io stalled for 0.04 s"
    harness.run(0.05)
    assert harness.reports.of("error") == [("error", "io-restarted", "PSM1: io stalled for 0.04 s")]


def test_an_arm_enters_fault_by_no_way_but_the_one_that_reports_it() -> None:
    assert {event for (_, event), target in TRANSITIONS.items() if target is ArmState.FAULT} == {ArmEvent.PROBLEM}
    sources = {path.name: path.read_text() for path in Path(arm.__file__).parent.rglob("*.py")}
    assert {name for name, text in sources.items() if "ArmEvent.PROBLEM" in text} == {"states.py", "machine.py"}
    assert sources["machine.py"].count("ArmEvent.PROBLEM") == 1


@pytest.mark.parametrize("state", ("ENABLED", "CALIBRATING_ENCODERS_FROM_POTS", "ENCODERS_BIASED", "HOMING", "PAUSED"))
def test_power_loss_is_a_fault_in_every_powered_state(state: str) -> None:
    harness = ArmHarness()
    harness.reach(state)
    harness.io.drop_power()
    harness.step()
    assert harness.arm.state == "FAULT"


@pytest.mark.parametrize("state", ("DISABLED", "FAULT"))
def test_an_arm_without_power_does_not_mind_a_silent_io(state: str) -> None:
    harness = ArmHarness()
    harness.reach(state)
    harness.reports.events.clear()
    harness.io.deaf = True
    harness.run(0.5)
    harness.io.deaf = False
    harness.io.restart()
    harness.run(0.5)
    assert harness.arm.state == state and not harness.reports.events


def test_a_fault_that_io_keeps_is_told_instead_of_power() -> None:
    harness = ArmHarness()
    harness.reach("FAULT")
    harness.io.flag("fault", 3)
    harness.io.refuses["clear_fault"] = "the board is too hot"
    enable = harness.state_command("enable")
    harness.until(lambda: harness.arm.state == "FAULT" and "failed" in enable.outcomes, 3.0)
    assert "the board is too hot" in enable.replies[-1][1]
    assert not harness.io.flag("power_requested")


@pytest.mark.slow
def test_requests_to_a_refusing_io_are_no_flood() -> None:
    harness = ArmHarness()
    harness.reach("HOMED")
    harness.io.refuses["power_off"] = "no"
    harness.state_command("disable")
    harness.run(10.0)
    assert harness.io.sent.count(("power_off", (0.0,))) <= 12
    assert len(harness.reports.of("warning")) == 1


def test_disable_is_done_when_io_has_no_power() -> None:
    harness = ArmHarness().homed()
    harness.io.loses["power_off"] = 1
    disable = harness.state_command("disable")
    assert disable.outcomes == ["accepted"] and harness.arm.state == "DISABLED"
    harness.run(0.2)
    assert disable.outcomes == ["accepted", "done"] and not harness.io.flag("powered")


def test_a_position_limit_is_a_status_once() -> None:
    harness = ArmHarness().homed()
    harness.io.record["at_limit"][2:4] = True
    harness.run(0.1)
    assert [e[1] for e in harness.reports.of("status")] == ["PSM1: position limit: yaw, pitch"]
