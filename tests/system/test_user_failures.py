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


def test_a_broken_and_a_hanging_process_change_nothing_else(robot: Robot, tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text(PROGRAM)
    arms = [{"name": "PSM1", "type": "PSM", "simulation": "KINEMATIC", "arm_file": "arms/PSM1-demo.yaml"}]
    rows = [{"name": "broken", "module": "mine.py", "on_exit": "stay-down"},
            {"name": "stuck", "module": "mine.py", "hung_s": 0.5, "late_s": 0.3, "commands": [{"name": "hang"}]}]
    file = tmp_path / "lab.json"
    file.write_text(json.dumps({"$id": "dvrk-system.schema.json", "$version": "1", "arms": arms,
                                "trocar": {"processes": rows}}))
    robot.up(file)
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


def reason(robot: Robot, name: str) -> str:
    """How it last ended."""
    return next(row.exit_reason for row in statuses(robot.name) if row.name == name)
