"""Walls of a running system: its arm dies, and they are kept."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import trocar
from tests.system.robot import Robot, time_passes

pytestmark = [pytest.mark.slow, pytest.mark.simulated]

FILE = """\
$id: dvrk-system.schema.json
$version: "1"
arms:
  - {name: PSM1, type: PSM, simulation: KINEMATIC, arm_file: arms/PSM1-demo.yaml}
trocar:
  walls:
    - {name: table, shape: plane, position: [0, 0, -0.14], of: tip}
"""
FLOOR, LID = -0.14, -0.125


def pushed(robot: Robot, depth: float) -> float:
    """The height of the tip after a stream that ends this deep."""
    with trocar.psm("PSM1", robot.name) as psm, time_passes():
        pose, _ = psm.setpoint_cp()
        start = pose[2, 3]
        for share in np.linspace(0.0, 1.0, 100):
            pose[2, 3] = start + share * (depth - start)
            psm.servo_cp(pose)
        return min(float(psm.setpoint_cp()[0][2, 3]) for _ in range(50))


def walls(robot: Robot) -> dict[str, bool]:
    """The walls in use, and whether a command added each."""
    record = json.loads(robot.trocar("echo", "PSM1/walls", "--once", "--json"))
    return dict(zip(record["name"][: record["count"]], record["by_command"], strict=False))


def test_walls_are_kept_by_an_arm_whose_process_was_killed(robots: Callable[[], Robot], tmp_path: Path) -> None:
    robot, file = robots(), tmp_path / "walled.yaml"
    file.write_text(FILE)
    robot.up(file, "--path", "configs")
    robot.home("PSM1")
    assert walls(robot) == {"table": False}
    assert pushed(robot, FLOOR - 0.02) == pytest.approx(FLOOR, abs=2e-4)
    shown = robot.trocar("status")
    assert "at wall table, 0." in shown and shown.rstrip().endswith("all well")
    robot.trocar("send", "PSM1", "move_jp", "0", "0", "0.12", "0", "0", "0", "--wait")
    refused = robot.types("send", "PSM1", "move_jp", "0", "0", "0.2", "0", "0", "0")
    assert refused.returncode == 1 and "table" in refused.stdout + refused.stderr
    robot.trocar("send", "PSM1", "add_wall", "0", "0", str(LID), "0", "0", "0", "1", "lid plane tip")
    before = robot.pid("PSM1")
    robot.kill("PSM1")
    robot.comes_back("PSM1", before)
    robot.passes(0.7)  # streams pause after a restart
    assert walls(robot) == {"table": False, "lid": True}
    assert pushed(robot, LID - 0.02) == pytest.approx(LID, abs=2e-4)
    robot.trocar("send", "PSM1", "remove_wall", "lid")
    assert walls(robot) == {"table": False}
