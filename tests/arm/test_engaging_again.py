"""Adapter and instrument of a PSM after an interruption: of the engaging, of power, of the arm's process."""

from __future__ import annotations

import numpy as np
import pytest

from tests.arm.arm_configs import TOOL
from tests.arm.fake_psm import DRIVER, SwitchedPsm, restart, with_adapter


def test_unhome_and_disable_leave_what_is_engaged_engaged() -> None:
    psm = with_adapter().retracted()
    psm.put_on("tool")
    psm.send("set_tool_type", (), DRIVER)
    psm.until(lambda: psm.homed_flag)
    for word in ("unhome", "disable"):
        psm.state_command(word)
        psm.run(0.1)
        assert not psm.homed_flag
        psm.reports.events.clear()
        psm.reach("HOMED") if word == "disable" else psm.state_command("home")
        psm.until(lambda: psm.homed_flag)
        assert psm.state["count"] == 6 and not psm.reported


@pytest.mark.parametrize("what", ("adapter", "tool"))
@pytest.mark.slow
def test_successor_begins_the_engaging_anew_without_a_jump(what: str) -> None:
    psm = SwitchedPsm().homed() if what == "adapter" else with_adapter().retracted()
    psm.put_on(what)
    if what == "tool":
        psm.send("set_tool_type", (), DRIVER)
    psm.run(2.5)
    state = psm.arm.state
    assert state == f"ENGAGING_{what.upper()}"
    restart(psm)
    psm.until(lambda: psm.arm.state == state, 0.1)
    psm.until(lambda: psm.homed_flag)
    assert psm.reported[-1].startswith(f"engaging {what}") and psm.nothing_jumped()
    assert psm.state["count"] == (7 if what == "adapter" else 6) and not psm.reports.of("error")
    assert not psm.reports.of("tool_type_request"), "the type is known already"


@pytest.mark.parametrize("doing", ("nothing", "effort", "clutched"))
def test_successor_keeps_what_is_engaged(doing: str) -> None:
    psm = with_adapter().retracted()
    psm.put_on("tool")
    psm.send("set_tool_type", (), DRIVER)
    psm.until(lambda: psm.homed_flag)
    if doing == "effort":
        psm.send("servo_jf", (0.0, 0.0, 0.1, 0.0, 0.0, 0.0))
    if doing == "clutched":
        psm.press("PSM1_arm_clutch")
    psm.run(0.1)
    held = psm.io.position.copy()
    restart(psm)
    psm.run(0.2)
    assert psm.arm.state == ("MANUAL" if doing == "clutched" else "HOMED")
    assert psm.state["count"] == 6 and psm.state["instrument"] == 4 and not psm.reported
    assert np.allclose(psm.io.position, held, atol=1e-12) and psm.largest.max() < 1e-12
    assert psm.types == [] and psm.state.text("tool") == TOOL.name
    if doing == "clutched":
        psm.press("PSM1_arm_clutch", False)
        psm.run(0.1)
    assert psm.homed_flag


def test_what_was_taken_off_or_put_on_meanwhile_is_noticed() -> None:
    psm = with_adapter().retracted()
    psm.put_on("tool")
    psm.send("set_tool_type", (), DRIVER)
    psm.until(lambda: psm.homed_flag)
    psm.press("PSM1_tool", False)
    restart(psm)
    psm.run(0.1)
    assert psm.state["count"] == 7 and psm.types == [("tool_type", "")] and psm.homed_flag
    psm.press("PSM1_tool")
    restart(psm)
    psm.run(0.1)
    assert psm.types == [("tool_type_request", "")]
    psm.send("set_tool_type", (), DRIVER)
    assert psm.arm.state == "ENGAGING_TOOL", "it was put on while the arm was homed"
    assert psm.largest.max() < 1e-9


def test_emulated_parts_survive_as_well() -> None:
    psm = SwitchedPsm().homed()
    psm.send("emulate_adapter_present", (1.0,))
    psm.until(lambda: psm.state["adapter"] == 4)
    restart(psm)
    psm.run(0.1)
    assert psm.arm.state == "HOMED" and psm.state["adapter"] == 4
    psm.send("emulate_adapter_present", (0.0,))
    psm.run(0.1)
    assert psm.state["adapter"] == 1


def test_an_arm_that_waits_for_a_type_stays_homed_in_its_successor() -> None:
    psm = with_adapter()
    psm.put_on("tool")
    psm.run(0.1)
    restart(psm)
    psm.run(0.1)
    assert psm.arm.state == "HOMED" and psm.types == [("tool_type_request", "")]


@pytest.mark.parametrize("word", ("pause", "disable"))
@pytest.mark.slow
def test_engaging_is_begun_again_after_an_interruption(word: str) -> None:
    psm = SwitchedPsm().homed()
    psm.put_on("adapter")
    psm.run(2.0)
    psm.state_command(word)
    held = psm.io.setpoint.copy()
    psm.run(0.3)
    assert psm.arm.state == ("PAUSED" if word == "pause" else "DISABLED")
    assert word == "disable" or np.allclose(psm.io.setpoint, held, atol=0.04)
    if word == "pause":
        psm.state_command("resume")
    else:
        psm.reach("ENGAGING_ADAPTER")
    psm.until(lambda: psm.state["adapter"] == 4)
    psm.run(0.1)
    assert psm.homed_flag and not psm.reports.of("error")


def test_an_io_that_has_not_looked_at_its_inputs_yet_takes_nothing_off() -> None:
    psm = with_adapter().retracted()
    psm.put_on("tool")
    psm.send("set_tool_type", (), DRIVER)
    psm.until(lambda: psm.homed_flag)
    psm.io.restart()
    psm.io.blind = True
    psm.io.record.set("input", False)
    psm.run(0.1)
    assert psm.arm.state == "FAULT" and psm.state["count"] == 6
    psm.io.blind = False
    psm.io.record["input"][1:3] = True
    psm.reports.events.clear()
    psm.state_command("enable")
    psm.until(lambda: psm.arm.state == "ENABLED")
    psm.state_command("home")
    psm.until(lambda: psm.homed_flag)
    assert psm.state["count"] == 6 and not psm.reported and psm.types == [("tool_type", DRIVER)]
