"""The arm process dies and a new one begins on the records that are there."""

from __future__ import annotations

import numpy as np
import pytest

from procs.codes import ARM_LOST
from tests.arm.fake_io import PERIOD_NS, Rig, bare_arm

ELSEWHERE = (0.4, 0.2, 0.1, 0.0, 0.0, 0.0)


def restart(rig: Rig, away_s: float = 0.5) -> None:
    """kill -9; io goes on alone for a while and holds; a new process begins."""
    for _ in range(round(away_s * 1e9 / PERIOD_NS)):
        rig.now_ns += PERIOD_NS
        rig.setpoint.set("mode", 0)
        rig.io.cycle(rig.now_ns, rig.setpoint)
    rig.start_arm()


def test_homed_arm_goes_on_without_a_jump_or_homing() -> None:
    rig = Rig().homed()
    rig.send("move_jp", ELSEWHERE)
    rig.run(0.3)
    restart(rig)
    held, sent = rig.io.setpoint.copy(), len(rig.io.sent)
    rig.io.largest_step = 0.0
    rig.run(0.1)
    assert rig.arm.state == "HOMED" and rig.state["is_homed"] and not rig.state["is_busy"]
    assert np.allclose(rig.io.setpoint, held, atol=1e-12) and rig.io.largest_step < 1e-12
    assert len(rig.io.sent) == sent and rig.setpoint["mode"] == 1
    assert rig.reports.of("operating_state")[-1] == ("operating_state", "ENABLED", "HOMED", True, False)
    move = rig.send("move_jp", ELSEWHERE)
    rig.until(lambda: "done" in move.outcomes)


def test_an_arm_that_was_missed_for_long_goes_on_all_the_same() -> None:
    rig = Rig().homed()
    rig.io.flag("fault", ARM_LOST.number)
    restart(rig)
    held = rig.io.setpoint.copy()
    rig.run(0.3)
    assert rig.arm.state == "HOMED" and rig.io.flag("fault") == 0
    assert np.allclose(rig.io.setpoint, held, atol=1e-12)


def test_paused_arm_stays_paused_and_holds() -> None:
    rig = Rig()
    rig.reach("PAUSED")
    restart(rig)
    held = rig.io.setpoint.copy()
    rig.run(0.1)
    assert rig.arm.state == "PAUSED" and rig.state["is_homed"]
    assert np.allclose(rig.io.setpoint, held, atol=1e-12)
    rig.state_command("resume")
    rig.run(0.1)
    assert rig.arm.state == "HOMED" and np.allclose(rig.io.setpoint, held, atol=1e-12)


@pytest.mark.parametrize("state", ("ENABLED", "CALIBRATING_ENCODERS_FROM_POTS", "ENCODERS_BIASED", "HOMING"))
def test_an_arm_half_way_keeps_what_io_does_and_can_be_homed(state: str) -> None:
    rig = Rig(bare_arm(homing_zero_position=True))
    rig.reach(state)
    rig.run(0.2 if state == "HOMING" else 0.0)
    restart(rig)
    pid, sent = rig.io.flag("pid_enabled"), len(rig.io.sent)
    rig.run(0.5)
    assert rig.arm.state == "ENABLED" and rig.io.flag("powered")
    assert rig.io.flag("pid_enabled") == pid and len(rig.io.sent) == sent
    rig.state_command("home")
    rig.until(lambda: rig.arm.state == "HOMED")


def test_powering_goes_on_to_enabled() -> None:
    rig = Rig()
    rig.io.power_cycles = 400
    rig.run(0.1)
    rig.state_command("enable")
    rig.run(0.05)
    assert rig.arm.state == "POWERING" and not rig.io.flag("powered")
    restart(rig, 0.1)
    assert not rig.io.flag("powered")
    rig.until(lambda: rig.arm.state == "ENABLED", 3.0)
    assert rig.io.flag("powered") and rig.io.flag("amps_on") and not rig.reports.of("error")
    assert rig.io.sent == [("power_on", ())], "asked for once, by the first process"


def test_homing_of_another_bias_is_not_taken_over() -> None:
    rig = Rig().homed()
    rig.io.flag("bias_generation", 5)
    restart(rig)
    rig.run(0.1)
    assert rig.arm.state == "ENABLED" and not rig.state["is_homed"] and rig.io.flag("pid_enabled")


@pytest.mark.parametrize(("state", "after"), (("DISABLED", "DISABLED"), ("FAULT", "FAULT")))
def test_an_arm_without_power_stays_what_it_was(state: str, after: str) -> None:
    rig = Rig()
    rig.reach(state)
    restart(rig)
    rig.run(0.1)
    assert rig.arm.state == after and not rig.io.flag("powered")


def test_power_lost_meanwhile_is_a_fault() -> None:
    rig = Rig().homed()
    rig.io.drop_power()
    restart(rig)
    rig.run(0.1)
    assert rig.arm.state == "FAULT"
    rig.state_command("enable")
    rig.until(lambda: rig.arm.state == "ENABLED")


def test_settings_survive() -> None:
    rig = Rig(bare_arm()).homed()
    rig.send("set_tool_type", (), "LARGE_NEEDLE_DRIVER:400006")
    rig.send("trajectory_j/set_ratio_v", (0.5,))
    rig.send("set_base_frame", (0.1, 0.2, 0.3, 0.0, 0.0, 0.0, 1.0), "world")
    rig.step()
    before = rig.state["measured_cp"].copy()
    restart(rig)
    rig.run(0.1)
    assert rig.state.text("tool") == "LARGE_NEEDLE_DRIVER_400006" and rig.state.text("reference_frame") == "world"
    assert rig.state["trajectory_ratio_v"] == 0.5 and np.allclose(rig.state["measured_cp"], before)


def test_an_unknown_base_stays_unknown() -> None:
    rig = Rig().homed()
    rig.send("set_base_frame")
    rig.step()
    restart(rig)
    rig.run(0.1)
    assert rig.state["cartesian_valid"] and not rig.state["reference_valid"]


def test_an_arm_that_finds_a_powered_robot_and_no_record_holds() -> None:
    rig = Rig()
    rig.io.flag("power_wanted", True)
    rig.io.flag("powered", True)
    rig.io.flag("amps_on", True)
    rig.io.flag("pid_enabled", True)
    rig.run(0.2)
    assert rig.arm.state == "ENABLED" and rig.io.flag("pid_enabled") and not rig.io.sent


def test_nothing_is_decided_before_io_answers() -> None:
    rig = Rig().homed()
    rig.io.deaf = True
    restart(rig)
    rig.run(0.2)
    assert not rig.state["valid"] and rig.setpoint["mode"] == 0
    restart(rig)
    rig.run(0.2)
    rig.io.deaf = False
    rig.run(0.1)
    assert rig.arm.state == "HOMED" and not rig.reports.of("error")


@pytest.mark.parametrize("away_s", (0.2, 5.0))
def test_a_move_waits_while_its_process_is_stopped(away_s: float) -> None:
    rig = Rig().homed()
    move = rig.send("move_jp", ELSEWHERE)
    rig.run(0.2)
    for _ in range(round(away_s * 1e9 / PERIOD_NS)):  # SIGSTOP, SIGCONT
        rig.now_ns += PERIOD_NS
        rig.setpoint.set("mode", 0)
        rig.io.flag("holding", True)
        rig.io.cycle(rig.now_ns, rig.setpoint)
    rig.io.largest_step = 0.0
    rig.step()
    rig.io.flag("holding", False)
    rig.until(lambda: "done" in move.outcomes)
    rig.run(0.1)
    assert rig.io.largest_step < 2 * PERIOD_NS * 1e-9, "no jump to where the move would have been"
    assert np.allclose(rig.state["setpoint_position"][:6], ELSEWHERE, atol=1e-9)
