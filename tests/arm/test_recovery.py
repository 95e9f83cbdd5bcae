"""The arm process dies and a new one begins on the records that are there."""

from __future__ import annotations

import numpy as np
import pytest

from tests.arm.arm_configs import bare_arm
from tests.arm.fake_io import PERIOD_NS, ArmHarness
from tests.cases import cases
from trocar.procs.tables.codes import ARM_LOST
from trocar.shm.system.events import sentence

ELSEWHERE = (0.4, 0.2, 0.1, 0.0, 0.0, 0.0)


def restart(harness: ArmHarness, away_s: float = 0.5, stall: str = "") -> None:
    """kill -9, or a stall; io runs alone for a while and holds; a new process begins."""
    for _ in range(round(away_s * 1e9 / PERIOD_NS)):
        harness.now_ns += PERIOD_NS
        harness.setpoint.set("mode", 0)
        harness.io.cycle(harness.now_ns, harness.setpoint)
    harness.start_arm(stall)


def test_homed_arm_goes_on_without_a_jump_or_homing() -> None:
    harness = ArmHarness().homed()
    harness.send("move_jp", ELSEWHERE)
    harness.run(0.3)
    restart(harness)
    held, sent = harness.io.setpoint.copy(), len(harness.io.sent)
    harness.io.largest_step = 0.0
    harness.run(0.1)
    assert harness.arm.state == "HOMED" and harness.state["is_homed"] and not harness.state["is_busy"]
    assert np.allclose(harness.io.setpoint, held, atol=1e-12) and harness.io.largest_step < 1e-12
    assert len(harness.io.sent) == sent and harness.setpoint["mode"] == 1
    assert harness.reports.of("operating_state")[-1] == ("operating_state", "ENABLED", "HOMED", True, False)
    move = harness.send("move_jp", ELSEWHERE)
    harness.until(lambda: "done" in move.outcomes)


def test_an_arm_that_was_missed_for_long_goes_on_all_the_same() -> None:
    harness = ArmHarness().homed()
    harness.io.flag("fault", ARM_LOST.number)
    restart(harness)
    held = harness.io.setpoint.copy()
    harness.run(0.3)
    assert harness.arm.state == "HOMED" and harness.io.flag("fault") == 0
    assert np.allclose(harness.io.setpoint, held, atol=1e-12)


def test_paused_arm_stays_paused_and_holds() -> None:
    harness = ArmHarness()
    harness.reach("PAUSED")
    restart(harness)
    held = harness.io.setpoint.copy()
    harness.run(0.1)
    assert harness.arm.state == "PAUSED" and harness.state["is_homed"]
    assert np.allclose(harness.io.setpoint, held, atol=1e-12)
    harness.state_command("resume")
    harness.run(0.1)
    assert harness.arm.state == "HOMED" and np.allclose(harness.io.setpoint, held, atol=1e-12)


@pytest.mark.parametrize("state", ("ENABLED", "CALIBRATING_ENCODERS_FROM_POTS", "ENCODERS_BIASED", "HOMING"))
def test_an_arm_half_way_keeps_what_io_does_and_can_be_homed(state: str) -> None:
    harness = ArmHarness(bare_arm(homing_zero_position=True))
    harness.reach(state)
    harness.run(0.2 if state == "HOMING" else 0.0)
    restart(harness)
    pid, sent = harness.io.flag("pid_enabled"), len(harness.io.sent)
    harness.run(0.5)
    assert harness.arm.state == "ENABLED" and harness.io.flag("powered")
    assert harness.io.flag("pid_enabled") == pid and len(harness.io.sent) == sent
    harness.state_command("home")
    harness.until(lambda: harness.arm.state == "HOMED")


def test_powering_goes_on_to_enabled() -> None:
    harness = ArmHarness()
    harness.io.power_cycles = 400
    harness.run(0.1)
    harness.state_command("enable")
    harness.run(0.05)
    assert harness.arm.state == "POWERING" and not harness.io.flag("powered")
    restart(harness, 0.1)
    assert not harness.io.flag("powered")
    harness.until(lambda: harness.arm.state == "ENABLED", 3.0)
    assert harness.io.flag("powered") and harness.io.flag("amps_on") and not harness.reports.of("error")
    assert harness.io.sent == [("power_on", ())], "asked for once, by the first process"


def test_homing_of_another_bias_is_not_taken_over() -> None:
    harness = ArmHarness().homed()
    harness.io.flag("bias_generation", 5)
    restart(harness)
    harness.run(0.1)
    assert harness.arm.state == "ENABLED" and not harness.state["is_homed"] and harness.io.flag("pid_enabled")


@pytest.mark.parametrize(("state", "after"), (("DISABLED", "DISABLED"), ("FAULT", "FAULT")))
def test_an_arm_without_power_stays_what_it_was(state: str, after: str) -> None:
    harness = ArmHarness()
    harness.reach(state)
    restart(harness)
    harness.run(0.1)
    assert harness.arm.state == after and not harness.io.flag("powered")


def io_stalls(harness: ArmHarness) -> None:
    harness.io.restart()
    harness.io.stall = "io stalled for 0.31 s"


MEANWHILE = {
    "power-lost": (lambda harness: harness.io.drop_power(), "detected power loss (actuators)"),
    "io-fault": (lambda harness: harness.io.flag("fault", 7), "fault number 7"),
    "io-restarted": (io_stalls, "io stalled for 0.31 s"),
}


@cases(("stall", "what"), [("", "the arm's process was restarted"), ("PSM1 stalled for 0.31 s",) * 2])
@cases("code", MEANWHILE)
def test_what_ended_the_power_while_the_process_was_away_is_an_error_that_names_its_cause(
        code: str, stall: str, what: str) -> None:
    break_it, words = MEANWHILE[code]
    harness = ArmHarness().homed()
    break_it(harness)
    restart(harness, stall=stall)
    harness.run(0.1)
    assert harness.arm.state == "FAULT"
    assert harness.reports.of("error") == [("error", code, sentence(f"{words}; {what}", "PSM1"))]
    assert harness.state.text("reason") == f"{words}; {what}"
    harness.state_command("enable")
    harness.until(lambda: harness.arm.state == "ENABLED")


def test_a_fault_keeps_its_cause_and_is_not_reported_again() -> None:
    harness = ArmHarness().homed()
    harness.io.drop_power()
    harness.run(0.1)
    restart(harness)
    harness.run(0.1)
    assert harness.arm.state == "FAULT" and not harness.reports.of("error")
    assert harness.state.text("reason") == "detected power loss (actuators)"


def test_settings_survive() -> None:
    harness = ArmHarness(bare_arm()).homed()
    harness.send("set_tool_type", (), "LARGE_NEEDLE_DRIVER:400006")
    harness.send("trajectory_j/set_ratio_v", (0.5,))
    harness.send("set_base_frame", (0.1, 0.2, 0.3, 0.0, 0.0, 0.0, 1.0), "world")
    harness.step()
    before = harness.state["measured_cp"].copy()
    restart(harness)
    harness.run(0.1)
    assert harness.state.text("tool") == "LARGE_NEEDLE_DRIVER_400006"
    assert harness.state.text("reference_frame") == "world"
    assert harness.state["trajectory_ratio_v"] == 0.5 and np.allclose(harness.state["measured_cp"], before)


def test_an_unknown_base_stays_unknown() -> None:
    harness = ArmHarness().homed()
    harness.send("set_base_frame")
    harness.step()
    restart(harness)
    harness.run(0.1)
    assert harness.state["cartesian_valid"] and not harness.state["reference_valid"]


def test_an_arm_that_finds_a_powered_robot_and_no_record_holds() -> None:
    harness = ArmHarness()
    harness.io.flag("power_requested", True)
    harness.io.flag("powered", True)
    harness.io.flag("amps_on", True)
    harness.io.flag("pid_enabled", True)
    harness.run(0.2)
    assert harness.arm.state == "ENABLED" and harness.io.flag("pid_enabled") and not harness.io.sent


def test_nothing_is_decided_before_io_answers() -> None:
    harness = ArmHarness().homed()
    harness.io.deaf = True
    restart(harness)
    harness.run(0.2)
    assert not harness.state["valid"] and harness.setpoint["mode"] == 0
    restart(harness)
    harness.run(0.2)
    harness.io.deaf = False
    harness.run(0.1)
    assert harness.arm.state == "HOMED" and not harness.reports.of("error")


@pytest.mark.parametrize("away_s", (0.2, 5.0))
def test_a_move_waits_while_its_process_is_stopped(away_s: float) -> None:
    harness = ArmHarness().homed()
    move = harness.send("move_jp", ELSEWHERE)
    harness.run(0.2)
    for _ in range(round(away_s * 1e9 / PERIOD_NS)):  # SIGSTOP, SIGCONT
        harness.now_ns += PERIOD_NS
        harness.setpoint.set("mode", 0)
        harness.io.flag("holding", True)
        harness.io.cycle(harness.now_ns, harness.setpoint)
    harness.setpoint.set("mode", 1)  # as it had left it
    harness.io.largest_step = 0.0
    harness.step()
    harness.io.flag("holding", False)
    harness.until(lambda: "done" in move.outcomes)
    harness.run(0.1)
    assert harness.io.largest_step < 2 * PERIOD_NS * 1e-9, "no jump to where the move would have been"
    assert np.allclose(harness.state["setpoint_position"][:6], ELSEWHERE, atol=1e-9)
