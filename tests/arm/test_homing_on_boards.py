"""Arms of real sites on emulated boards, stepped: power, encoders, homing, in the order and time they should take."""

from __future__ import annotations

import numpy as np
import pytest

from tests import stock
from tests.arm.on_boards import OnBoards
from trocar.procs.config import load_system

pytestmark = pytest.mark.slow
WAY = ["CALIBRATING_ENCODERS_FROM_POTS", "ENCODERS_BIASED", "HOMING"]
TOLERANCE = 0.0524  # rad and m, of every joint

# system file, arm, most s from the desired state for power to HOMED; masters are in test_master_on_boards.py
ARMS = (
    ("jhu-dVRK/system-PSM1", "PSM1", 8.0), ("jhu-daVinci/system-ECM", "ECM", 10.0),
    ("jhu-daVinci-Si/system-PSM1", "PSM1", 10.0), ("jhu-daVinci-Si/system-ECM", "ECM", 10.0),
)


@pytest.mark.parametrize(("file", "name", "most_s"), ARMS)
def test_an_arm_homes_from_its_own_files(file: str, name: str, most_s: float) -> None:
    system = load_system(stock.find(f"dvrk-site/{file}.json"), search=[stock.find("dvrk-share")],
                         boards="emulated").system
    assert system is not None
    robot = OnBoards(system, name)
    robot.run(0.1)
    start = robot.clock.ns
    spent = robot.homed()
    assert list(spent) == WAY and (robot.clock.ns - start) * 1e-9 < most_s
    robot.run(0.1)
    error = np.abs(robot.state["position"] - robot.state["setpoint_position"])[: len(robot.truth)]
    assert (error < TOLERANCE).all()
    assert robot.state["is_homed"] and robot.harness.errors() == [] and not robot.reports.of("error")
