"""Calibration mode: what it switches off, and that nothing else changes."""

from __future__ import annotations

import numpy as np
import pytest

from tests.io.boards_harness import COARSE, rig_of
from tests.io.harness import IoHarness
from trocar.procs.fpga import registers


def codes(harness: IoHarness, kind: str) -> list[str]:
    return [event.code for event in harness.core.reports.events if event.kind == kind]


@pytest.mark.parametrize("on", [True, False])
def test_calibration_mode_is_told_and_shown(on: bool) -> None:
    harness = IoHarness(calibration_mode=on)
    harness.run(1)
    assert codes(harness, "warning") == ["calibration-mode"] * on and bool(harness.record.calibration_mode) is on


@pytest.mark.parametrize("on", [True, False])
def test_potentiometers_are_not_compared_while_they_are_calibrated(on: bool) -> None:
    harness = IoHarness(calibration_mode=on).control()
    asked = harness.ask("pot_check", 1)
    assert asked.outcome == "done" and ("not compared" in asked.answers[-1][1]) is on
    assert bool(harness.record.pot_check[0]) is not on
    harness.port.pot(2, 1.0)
    harness.run(100)
    assert harness.codes == ([] if on else ["potentiometer"]) and bool(harness.record.power_requested[0]) is on


@pytest.mark.parametrize(("current", "calibrating", "trips"), [
    (0.15, False, True), (0.15, True, False), (0.25, False, True), (0.25, True, True)])
def test_more_current_is_let_pass_with_the_amplifier_off(current: float, calibrating: bool, trips: bool) -> None:
    harness = IoHarness(calibration_mode=calibrating)
    supply = registers.STATUS_MV_GOOD | registers.STATUS_RELAY | registers.STATUS_RELAY_FEEDBACK
    harness.port.set_status(supply | registers.STATUS_POWER)  # as by another robot on these boards
    harness.port._obey = lambda row: None  # type: ignore[method-assign]  # which wants to keep it
    harness.run(2)
    assert harness.record.powered[0] and not harness.record.amp_enabled.any()
    harness.port.current(0, current)
    harness.run(101)
    assert harness.codes == (["current"] if trips else [])


@pytest.mark.slow
def test_an_si_arm_gets_power_for_its_brakes_only() -> None:
    harness = rig_of("jhu-daVinci-Si/system-PSM1", (*COARSE, "calibration_mode=true"))
    assert harness.io.calibration_mode
    assert harness.do("power_on", "PSM1").outcome == "done"
    warned = [event.code for event in harness.events if event.kind == "warning"]
    assert warned == ["calibration-mode", "calibration-motors"]
    n = harness.robots.axes
    assert harness.record.powered[0] and not harness.record.amp_enabled[:n].any()
    assert harness.record.amp_enabled[n:].all()
    assert not harness.record.amp_on[:n].any() and harness.record.amp_on[n:].all()
    assert harness.do("bias_encoders", "PSM1", 30).outcome == "done"
    assert harness.do("pid_enable", "PSM1", 1).answers == [
        ("refused", "in calibration mode, the motor amplifiers of a dRA1 controller stay off")]
    assert harness.do("brake_release", "PSM1").outcome == "done"
    harness.run(3.5)  # beyond all grace times
    assert harness.record.brakes_released[0] and harness.errors() == [] and harness.record.power_requested[0]


@pytest.mark.slow
def test_a_reading_without_a_position_cuts_nothing_while_tables_are_made() -> None:
    harness = rig_of("jhu-daVinci-Si/system-PSM1", (*COARSE, "calibration_mode=true"))
    harness.core.samples.pots.tables[...] = np.nan
    assert harness.do("power_on", "PSM1").outcome == "done" and harness.do("pot_check", "PSM1", 1).outcome == "done"
    harness.run(0.2)
    assert harness.errors() == [] and harness.record.relay[0]
