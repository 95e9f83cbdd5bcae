"""A console and the system's process as a whole system: emulated inputs, homing of everything, a console that dies."""

from __future__ import annotations

import json

import pytest

from tests.system.robot import ROOT, Robot, wait_for
from trocar.shm.system import directory

pytestmark = [pytest.mark.slow, pytest.mark.simulated("hosted")]
TELEOP = ROOT / "configs/systems/kinematic-teleop.yaml"


def test_emulated_inputs_reach_the_record_and_a_killed_console_wants_presence(robot: Robot) -> None:
    robot.up(TELEOP)
    ring = directory.reader(robot.name, "console", "state", "console")

    def shows(**wanted: object) -> None:
        wait_for(lambda: ring.newest() and all(ring.field(name).item() == value for name, value in wanted.items()),
                 60, f"console/state shows {wanted}")

    shows(valid=True, operator_present=False, teleop_enabled=False, scale=0.2)
    robot.trocar("send", "system", "home", "--wait")
    state = json.loads(robot.trocar("echo", "system/state", "--json", "--once"))
    assert state["arm"] == ["MTMR", "PSM1"] and state["arm_homed"] == [True, True] and state["task"] == ""
    robot.trocar("send", "console", "teleop_enable", "1")
    robot.trocar("send", "console", "emulate_operator_present", "1", "stay")
    robot.trocar("send", "console", "emulate_clutch", "1")
    robot.trocar("send", "console", "set_scale", "0.4")
    shows(operator_present=True, clutch=True, camera=False, teleop_enabled=True, scale=0.4)
    old = robot.kill("console")
    wait_for(lambda: robot.pid("console") != old and robot.state("console") == "RUNNING", 30, "the console's restart")
    shows(operator_present=False, clutch=False, teleop_enabled=True, scale=0.4)
    assert "1 " in robot.trocar("send", "console", "emulate_operator_present", "2", code=2)
    robot.trocar("send", "system", "power_off", "--wait")
    shows(teleop_enabled=False)
    ring.close()
