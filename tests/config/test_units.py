"""Numbers in degrees or mm, where files have rad and m, only warn: each names its key."""

from __future__ import annotations

import pytest

from tests.config.conftest import SYSTEM, Home

IO = "io/PSM1-demo.yaml"
PID = "pid/PSM.yaml"
CHAIN = "kinematic/PSM.yaml"
ACTUATOR = "robots[0].actuators[0]"
LIMITS = f"{ACTUATOR}.encoder.position_limits_soft.upper"
TOLERANCE = "p_measured_setpoint_tolerance"
FRAME = "base_frame: {reference_frame: Cart, transform: [[1, 0, 0, -200], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]}"


@pytest.mark.parametrize(("file", "old", "new", "key", "text"), [
    (PID, f"{TOLERANCE}: 0.5", f"{TOLERANCE}: 30", f"pid[0].{TOLERANCE}", "never exceeded: the joint moves 3.176"),
    (PID, f"{TOLERANCE}: 0.05", f"{TOLERANCE}: 50", f"pid[2].{TOLERANCE}", "never exceeded"),
    (PID, f"{TOLERANCE}: 0.5", f"{TOLERANCE}: 0", f"pid[0].{TOLERANCE}", "the smallest error is a fault"),
    (IO, "distance: 0.08", "distance: 5", "robots[0].potentiometers.tolerances[0].distance", "never exceeded"),
    (IO, "lower: -1.58825, upper: 1.58825", "lower: 1.5, upper: 1.5", LIMITS, "no range"),
    (IO, "scale: -0.762", "scale: -43.6", f"{ACTUATOR}.potentiometer.voltage_to_position.scale", "measures 196"),
    (CHAIN, "qmax: 1.588", "qmax: 91", "DH.joints[0].qmax", "degrees"),
    (CHAIN, "qmax: 0.24", "qmax: 240", "DH.joints[2].qmax", "mm"),
    (CHAIN, "qmin: -1.588, qmax: 1.588", "qmin: 1.5, qmax: 1.5", "DH.joints[0].qmax", "no range"),
    (CHAIN, "alpha: 1.5708", "alpha: 90", "DH.joints[0].alpha", "degrees"),
    (CHAIN, "offset: -0.4318", "offset: -431.8", "DH.joints[2].offset", "mm"),
    (SYSTEM, "serial: demo", f"serial: demo\n    {FRAME}", "arms[0].base_frame.transform", "mm")])
def test_numbers_in_another_unit_warn(home: Home, file: str, old: str, new: str, key: str, text: str) -> None:
    home.edit(file, old, new)
    warning = home.warning()
    assert warning.key == key and text in warning.text


def test_limits_in_degrees_contradict_the_potentiometer(home: Home) -> None:
    home.edit(IO, "lower: -1.58825, upper: 1.58825", "lower: -91, upper: 91")
    loaded = home.load()
    assert loaded.system is not None
    assert [warning.key for warning in loaded.warnings] == [
        LIMITS, f"{ACTUATOR}.potentiometer.voltage_to_position.scale"]
