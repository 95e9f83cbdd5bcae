"""Calibration mode is shown wherever a person looks, and homing in it is that of the reference."""

from __future__ import annotations

import json

import pytest

from tests.system.robot import SLOWER, Robot
from trocar.procs.config import PROJECT_CONFIGS
from trocar.procs.document.process import CALIBRATION_MODE
from trocar.procs.tables.codes import CALIBRATION_MOTORS

pytestmark = [pytest.mark.slow, pytest.mark.simulated("hosted")]
CALIBRATING = ("--set", "calibration_mode=true", *SLOWER)


def test_it_is_shown_by_every_view_and_before_an_arm_homes_from_its_potentiometers(robot: Robot) -> None:
    robot.up(PROJECT_CONFIGS / "systems" / "demo.yaml", "--boards", "emulated", *CALIBRATING)
    for view in (("status",), ("attach", "--once")):
        assert CALIBRATION_MODE in " ".join(robot.trocar(*view).split()), view
        as_json = robot.trocar(view[0], "--json").splitlines()
        assert json.loads(as_json[-1])["calibration_mode"] is True
    for _ in range(2):  # each homing sets the encoders again
        homed = robot.types("home", timeout=300)
        assert homed.returncode == 0 and CALIBRATION_MODE in " ".join(homed.stderr.split())
        robot.trocar("power-off")
    assert "calibration mode: " not in robot.types("power-off").stderr


def test_an_si_arm_does_not_home_in_it_and_says_why(robot: Robot) -> None:
    robot.up(PROJECT_CONFIGS / "systems" / "demo-psm-si.yaml", "--boards", "emulated", *CALIBRATING)
    refused = robot.types("home", timeout=300)
    assert refused.returncode == 1
    assert CALIBRATION_MOTORS.cause in " ".join(refused.stdout.split())
