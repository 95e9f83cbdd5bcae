"""Arms of real sites on emulated boards, stepped: power, encoders, homing, in the order and time they should take."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from tests.arm.on_boards import HomedOnBoards

pytestmark = pytest.mark.slow
WAY = ["CALIBRATING_ENCODERS_FROM_POTS", "ENCODERS_BIASED", "HOMING"]
TOLERANCE = 0.0524  # rad and m, of every joint

# system file, arm, most s from the desired state for power to HOMED; masters are in test_master_on_boards.py
ARMS = (
    ("jhu-dVRK/system-PSM1", "PSM1", 8.0), ("jhu-daVinci/system-ECM", "ECM", 10.0),
    ("jhu-daVinci-Si/system-PSM1", "PSM1", 10.0), ("jhu-daVinci-Si/system-ECM", "ECM", 10.0),
)


@pytest.mark.parametrize(("file", "name", "most_s"), ARMS)
def test_an_arm_homes_from_its_own_files(
    homed_on_boards: Callable[[str, str], HomedOnBoards], file: str, name: str, most_s: float
) -> None:
    homed = homed_on_boards(file, name)
    assert list(homed.spent) == WAY and homed.seconds < most_s
    robot = homed.again()
    robot.run(0.1)
    error = np.abs(robot.state["position"] - robot.state["setpoint_position"])[: len(robot.truth)]
    assert (error < TOLERANCE).all()
    assert robot.state["is_homed"] and robot.harness.errors() == [] and not robot.reports.of("error")
