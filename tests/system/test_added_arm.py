"""What a new type of arm takes: a row of the table of arm types, and the files that every arm has."""

from __future__ import annotations

import json
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from tests.system.recipes import Recipe, tree_with
from tests.system.robot import COARSE_ON_BOARDS, ROOT, Robot, wait_for
from trocar.shm.system import directory

pytestmark = [pytest.mark.slow, pytest.mark.simulated]
JOINTS = ("yaw", "pitch", "insertion", "roll", "bend")
GOAL = (0.05, -0.05, 0.1, 0.2, -0.1)

SCOPE: Recipe = {
    "procs/tables/arm_types.py": (('    "PSM": ArmType(', '''
    "SCOPE": ArmType(  # yaw, pitch, insertion, roll, bend
        actuators=5,
        joints=5,
        gains={"Classic": "pid/SCOPE.yaml"},
        moves=TrajectoryLimits((1.0, 1.0, 0.1, 1.0, 1.0), (1.0, 1.0, 0.1, 1.0, 1.0), (0.05, 0.05, 0.005, 0.05, 0.05)),
        servo=ServoLimits((2.0, 2.0, 0.4, 4.0, 4.0), (100.0, 100.0, 20.0, 200.0, 200.0)),
        efforts=EffortModeLimits((1.0, 1.0, 0.1, 2.0, 2.0), (0.15, 0.15, 0.01, 0.15, 0.15)),
        kinematic_home=(0.0, 0.0, 0.1, 0.0, 0.0),
        plant={"Classic": ArmInertia(
            joints=(*(JointInertia(0.6, 1.5, 1.0),) * 2, JointInertia(4.0, 20.0, 5.0),
                    *(JointInertia(0.004, 0.02, 0.02),) * 2),
            initial=(0.05, -0.05, 0.08, 0.1, 0.1))},
    ),
'''),),
}


def ours(name: str) -> Any:
    """A file of ours."""
    return yaml.safe_load((ROOT / "configs" / name).read_text())


def write(folder: Path, name: str, content: object) -> None:
    """The file of the new arm, made of one of an ECM."""
    path = folder / name
    path.parent.mkdir(exist_ok=True)
    path.write_text(yaml.safe_dump(content))


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    """The program with the new type, and its files: those of an ECM with one joint more."""
    assert len(SCOPE) <= 4
    root = tree_with(SCOPE, tmp_path / "tree")
    chain, io, gains = ours("kinematic/ECM.yaml"), ours("io/ECM-demo.yaml"), ours("pid/ECM.yaml")
    rows, (robot, *_) = chain["DH"]["joints"], io["robots"]
    rows.append({**rows[3], "name": "bend", "D": 0.05, "alpha": 1.5708})
    robot["actuators"].append({**robot["actuators"][3], "board_id": 5, "axis_id": 3})
    tolerances = robot["potentiometers"]["tolerances"]
    tolerances.append({**tolerances[3], "axis_id": 4})
    robot["name"], robot["number_of_actuators"] = "SCOPE1", 5
    gains["pid"].append({**gains["pid"][3], "index": 4, "name": "bend"})
    write(root / "configs", "kinematic/SCOPE.yaml", chain)
    write(root / "configs", "io/SCOPE.yaml", io)
    write(root / "configs", "pid/SCOPE.yaml", gains)
    write(root / "configs", "arms/SCOPE.yaml", {
        "$id": "dvrk-scope.schema.json", "$version": "1", "kinematic": "kinematic/SCOPE.yaml", "generation": "Classic"})
    return root


def test_an_arm_of_five_joints_is_added_in_one_file(robot: Robot, tree: Path, tmp_path: Path) -> None:
    robot.root = tree
    arm = {"type": "SCOPE", "arm_file": "arms/SCOPE.yaml"}
    arms = [{"name": "SCOPE1", "serial": "demo", "IO": "IO1", "IO_file": "io/SCOPE.yaml", **arm},
            {"name": "SCOPE2", "simulation": "KINEMATIC", **arm}]
    write(tmp_path, "scope.yaml", {"$id": "dvrk-system.schema.json", "$version": "1", "arms": arms,
                                   "IOs": [{"name": "IO1", "port": "udp"}], "trocar": {"boards": "emulated"}})
    robot.trocar("check", "arms/SCOPE.yaml")
    robot.up(tmp_path / "scope.yaml", *COARSE_ON_BOARDS)
    robot.trocar("home")
    for name in ("SCOPE1", "SCOPE2"):
        robot.trocar("send", name, "move_jp", *map(str, GOAL), "--wait")
        with closing(directory.reader(robot.name, name, "state")) as state:
            wait_for(lambda: state.newest() and np.abs(state.field("position")[:5] - GOAL).max() < 0.02,
                     30, f"{name} is at {GOAL}")
    assert tuple(json.loads(robot.trocar("echo", "SCOPE1/measured_js", "--json", "--once"))["name"]) == JOINTS
    assert "no inverse kinematics" in robot.trocar("send", "SCOPE1", "move_cp", *"0000001", code=1)
    listed = robot.trocar("list")
    assert "SCOPE1/measured_cp" in listed and "SCOPE1/jaw" not in listed and "SCOPE1/gripper" not in listed
