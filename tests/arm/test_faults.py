"""What goes wrong, and the way back."""

from __future__ import annotations

import pytest

from tests.arm.fake_io import Rig


def latch(rig: Rig) -> None:
    rig.io.flag("fault", 7)
    rig.io.flag("pid_enabled", False)


def fall_silent(rig: Rig) -> None:
    rig.io.deaf = True


CAUSES = {
    "power-lost": (lambda rig: rig.io.drop_power(), "detected power loss"),
    "io-fault": (latch, "fault number 7"),
    "io-timeout": (fall_silent, "io does not answer"),
    "io-restarted": (lambda rig: rig.io.restart(), "io was restarted"),
    "pid-off": (lambda rig: rig.io.flag("pid_enabled", False), "joint controller was switched off"),
    "pid-on-again": (lambda rig: rig.io.flag("pid_generation", 8), "switched off and on"),
    "bias-changed": (lambda rig: rig.io.flag("bias_generation", 9), "encoders were set anew"),
}


@pytest.mark.parametrize("code", CAUSES)
@pytest.mark.parametrize("during_move", (False, True))
def test_every_cause_leads_to_fault_with_its_reason_and_enable_back(code: str, during_move: bool) -> None:
    break_it, words = CAUSES[code]
    rig = Rig().homed()
    move = rig.send("move_jp", (0.5, 0.0, 0.1, 0.0, 0.0, 0.0)) if during_move else None
    rig.run(0.05)
    break_it(rig)
    rig.until(lambda: rig.arm.state == "FAULT", 0.05)
    errors = rig.reports.of("error")
    assert len(errors) == 1 and errors[0][1] == code.replace("on-again", "off") and words in errors[0][2]
    assert rig.state.text("state") == "FAULT" and not rig.state["is_homed"] and not rig.state["is_busy"]
    assert rig.setpoint["mode"] == 0
    if move is not None:
        assert move.outcomes == ["accepted", "failed"]
        assert ("goal_reached", False) in rig.reports.events
    rig.io.deaf = False
    rig.run(0.3)
    assert not rig.io.flag("power_wanted") and not rig.io.flag("pid_enabled")
    assert len(rig.reports.of("error")) == 1
    enable = rig.state_command("enable")
    rig.until(lambda: "done" in enable.outcomes, 7.0)
    rig.state_command("home")
    rig.until(lambda: rig.arm.state == "HOMED")


@pytest.mark.parametrize("state", ("ENABLED", "CALIBRATING_ENCODERS_FROM_POTS", "ENCODERS_BIASED", "HOMING", "PAUSED"))
def test_power_loss_is_a_fault_in_every_powered_state(state: str) -> None:
    rig = Rig()
    rig.reach(state)
    rig.io.drop_power()
    rig.step()
    assert rig.arm.state == "FAULT"


@pytest.mark.parametrize("state", ("DISABLED", "FAULT"))
def test_an_arm_without_power_does_not_mind_a_silent_io(state: str) -> None:
    rig = Rig()
    rig.reach(state)
    rig.reports.events.clear()
    rig.io.deaf = True
    rig.run(0.5)
    rig.io.deaf = False
    rig.io.restart()
    rig.run(0.5)
    assert rig.arm.state == state and not rig.reports.events


def test_a_fault_that_io_keeps_is_told_instead_of_power() -> None:
    rig = Rig()
    rig.reach("FAULT")
    rig.io.flag("fault", 3)
    rig.io.refuses["clear_fault"] = "the board is too hot"
    enable = rig.state_command("enable")
    rig.until(lambda: rig.arm.state == "FAULT" and "failed" in enable.outcomes, 3.0)
    assert "the board is too hot" in enable.replies[-1][1]
    assert not rig.io.flag("power_wanted")


@pytest.mark.slow
def test_requests_to_a_refusing_io_are_no_flood() -> None:
    rig = Rig()
    rig.reach("HOMED")
    rig.io.refuses["power_off"] = "no"
    rig.state_command("disable")
    rig.run(10.0)
    assert rig.io.sent.count(("power_off", (0.0,))) <= 12
    assert len(rig.reports.of("warning")) == 1


def test_disable_is_done_when_io_has_no_power() -> None:
    rig = Rig().homed()
    rig.io.loses["power_off"] = 1
    disable = rig.state_command("disable")
    assert disable.outcomes == ["accepted"] and rig.arm.state == "DISABLED"
    rig.run(0.2)
    assert disable.outcomes == ["accepted", "done"] and not rig.io.flag("powered")


def test_a_position_limit_is_a_status_once() -> None:
    rig = Rig().homed()
    rig.io.record["at_limit"][2:4] = True
    rig.run(0.1)
    assert [e[1] for e in rig.reports.of("status")] == ["PSM1: position limit: yaw, pitch"]
