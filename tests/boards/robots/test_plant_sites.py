"""Every system of a real site stands where its encoders and potentiometers can show it, and stays there."""

from __future__ import annotations

import numpy as np
import pytest

from tests import stock
from trocar.procs.boards.robots.plant import Plant
from trocar.procs.config import load_system
from trocar.procs.document.system import Actuator

SYSTEMS = ("jhu-dVRK/system-MTML-MTMR", "jhu-dVRK/system-MTML-PSM1-Teleop", "jhu-daVinci/system-ECM",
           "jhu-daVinci/system-SUJ", "jhu-daVinci-Si/system-ECM", "jhu-daVinci-Si/system-PSM1")
HIGHEST_V = 4.5


def volts(actuator: Actuator, position: float) -> float:
    """What a potentiometer gives at a position; a value in its range where there is none."""
    pot = actuator.potentiometer
    if pot is None or pot.voltage_to_position.scale == 0.0:
        return 0.0
    return (position - pot.voltage_to_position.offset) / pot.voltage_to_position.scale


@pytest.mark.parametrize("name", SYSTEMS)
def test_robots_stand_where_their_sensors_can_show_it(name: str) -> None:
    file = stock.find(f"dvrk-site/{name}.json")
    system = load_system(file, search=[stock.find("dvrk-share")], boards="emulated").system
    assert system is not None
    plant = Plant(system.emulated())
    actuators = [actuator for io in system.emulated().ios for robot in io.robots for actuator in robot.actuators]
    for actuator, position, pot in zip(actuators, plant.position, plant.pot_position, strict=True):
        if actuator.encoder is not None and actuator.encoder.lower < actuator.encoder.upper:
            assert actuator.encoder.lower < position < actuator.encoder.upper
        assert 0.0 <= volts(actuator, pot) <= HIGHEST_V
    if all(arm.links is None for arm in system.emulated().arms):  # the others have weight, and no brakes here
        start = plant.position.copy()
        for _ in range(100):
            plant.step(np.zeros(plant.axes))
        np.testing.assert_allclose(plant.position, start, atol=1e-12)
