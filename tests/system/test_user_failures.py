"""What users' processes do wrong in a running system stays their own."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.system.robot import Robot, wait_for
from tools.inspect.processes import statuses

pytestmark = [pytest.mark.slow, pytest.mark.simulated]
PROGRAM = """
import time

import trocar


class Mine(trocar.Process):
    def setup(self):
        if self.name == "broken":
            raise OSError("no sensor on the line")

    def on_hang(self):
        time.sleep(1000)
"""
EAGER = """
import trocar


class Eager(trocar.Process):
    def setup(self):
        self.psm = trocar.psm("PSM1")

    def on_enable(self):
        self.psm.state_command("enable")

    def update(self):
        try:
            self.psm.state_command("home")
            self.error = ""
        except trocar.Refused as why:
            self.error = str(why)
"""
ARMS = [{"name": "PSM1", "type": "PSM", "simulation": "KINEMATIC", "arm_file": "arms/PSM1-demo.yaml"}]


def up(robot: Robot, folder: Path, program: str, *rows: dict[str, object]) -> None:
    """A kinematic PSM1 with processes of this program."""
    (folder / "mine.py").write_text(program)
    processes = [{"module": "mine.py", **row} for row in rows]
    file = folder / "lab.json"
    file.write_text(json.dumps({"$id": "dvrk-system.schema.json", "$version": "1", "arms": ARMS,
                                "trocar": {"processes": processes}}))
    robot.up(file)


def test_a_broken_and_a_hanging_process_change_nothing_else(robot: Robot, tmp_path: Path) -> None:
    up(robot, tmp_path, PROGRAM, {"name": "broken", "on_exit": "stay-down"},
       {"name": "stuck", "hung_s": 0.5, "late_s": 0.3, "commands": [{"name": "hang"}]})
    wait_for(lambda: robot.state("stuck") == "RUNNING", 20, "the one without a mistake runs")
    robot.pids.add(robot.pid("stuck"))
    wait_for(lambda: "no sensor on the line" in reason(robot, "broken"), 20, "why the other does not")
    arm, stuck = robot.pid("PSM1"), robot.pid("stuck")
    robot.trocar("send", "stuck", "hang", "--timeout", "0.1", code=None)
    wait_for(lambda: robot.state("stuck") == "RUNNING" and robot.pid("stuck") != stuck, 30, "killed and started again")
    robot.pids.add(robot.pid("stuck"))
    assert "hung for" in reason(robot, "stuck")
    assert robot.pid("PSM1") == arm and robot.state("PSM1") == "RUNNING"
    assert robot.down() == 0


def test_a_process_homes_only_while_a_person_has_asked_it_to(robot: Robot, tmp_path: Path) -> None:
    up(robot, tmp_path, EAGER, {"name": "eager", "period_s": 0.1, "commands": [{"name": "enable", "moves": True}]})
    wait_for(lambda: "no person's command" in problem(robot, "eager"), 30, "it was refused")
    robot.pids.add(robot.pid("eager"))
    assert not homed(robot)
    robot.trocar("send", "eager", "enable", "--wait")
    wait_for(lambda: homed(robot), 60, "it homes for who asked it")
    robot.trocar("power-off")
    wait_for(lambda: "before the last fault or power-off" in problem(robot, "eager"), 30, "what was asked is void")
    assert not homed(robot)
    assert robot.down() == 0


def homed(robot: Robot) -> bool:
    """Whether PSM1 is."""
    return bool(json.loads(robot.trocar("echo", "PSM1/state", "--json", "--once"))["is_homed"])


def problem(robot: Robot, name: str) -> str:
    """What `trocar status` says is wrong with it."""
    return next(row.problem for row in statuses(robot.name) if row.name == name)


def reason(robot: Robot, name: str) -> str:
    """How it last ended."""
    return next(row.exit_reason for row in statuses(robot.name) if row.name == name)
