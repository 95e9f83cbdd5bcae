"""KINEMATIC arms as whole systems: no boards process, and otherwise powered, homed, moved, killed like the others."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import yaml

from tests.system.robot import DEMO, ROOT, Robot, wait_for
from trocar.shm.system import directory

pytestmark = [pytest.mark.slow, pytest.mark.simulated]
KINEMATIC = ROOT / "configs/systems/kinematic.yaml"
HOME = (0, 0, 0.12, 0, 0, 0)
PLACE = (0.1, -0.1, 0.15, 0.2, 0.1, -0.1)


def echo(robot: Robot, topic: str) -> dict:
    return json.loads(robot.trocar("echo", topic, "--json", "--once"))


def there(robot: Robot, arm: str, goal: tuple[float, ...]) -> bool:
    position = echo(robot, f"{arm}/measured_js")["position"]
    return bool(np.abs(np.array(position) - goal).max() < 1e-12)


def test_a_system_of_one_arm_is_homed_as_a_whole_and_its_arm_stopped_alone(robot: Robot, tmp_path: Path) -> None:
    arm = {"name": "PSM1", "type": "PSM", "simulation": "KINEMATIC", "arm_file": "arms/PSM1-demo.yaml"}
    file = tmp_path / "system-PSM1.json"
    file.write_text(json.dumps({"$id": "dvrk-system.schema.json", "$version": "1", "arms": [arm]}))
    robot.up(file)
    robot.trocar("send", "system", "home", "--wait")
    assert echo(robot, "system/state")["arm_homed"] == [True]
    assert "depends on it" not in robot.trocar("stop", "PSM1", code=2)
    robot.trocar("stop", "PSM1", "--yes")
    assert robot.state("system") == "RUNNING"
    wait_for(lambda: echo(robot, "system/state")["arm_fresh"] == [False], 60, "the arm is seen no more")
    assert "PSM1" in robot.trocar("send", "system", "home", "--wait", code=1)


def test_kinematic_arm_is_powered_homed_moved_and_shown_as_such(robot: Robot) -> None:
    robot.up(KINEMATIC)
    assert "PSM1 is KINEMATIC" in robot.output()
    robot.home()
    wait_for(lambda: there(robot, "PSM1", HOME), 60, "home")
    robot.trocar("send", "PSM1", "move_jp", *map(str, PLACE))
    wait_for(lambda: there(robot, "PSM1", PLACE), 60, "the move")
    rows = {row["name"]: row for row in json.loads(robot.trocar("status", "--json"))["processes"]}
    assert {name: row["simulation"] for name, row in rows.items()} == {
        "supervisor": "", "io": "KINEMATIC", "PSM1": "KINEMATIC", "system": ""}
    listed = [json.loads(line) for line in robot.trocar("list", "--json").splitlines()]
    assert {"io/PSM1/measured_js", "PSM1/measured_cp"} <= {row["topic"] for row in listed}
    assert {row["simulation"] for row in listed if row["topic"].startswith(("io/", "PSM1/state"))} == {"KINEMATIC"}
    state = echo(robot, "io/state")
    assert state["simulated"] is True or state["simulated"] == [True]
    assert set(state["current"]) == {None} and echo(robot, "PSM1/state")["simulated"] is True
    (rate,) = [json.loads(line) for line in robot.trocar("hz", "io/state", "--json").splitlines()]
    assert rate["hz"] > 450
    history = directory.reader(robot.name, "io", "state")
    assert len(history.last(300)) == 300 and history.last(300)["simulated"].all()
    history.close()
    killed_io_comes_back_without_power_and_a_person_homes(robot)
    robot.trocar("power-off")
    assert robot.down() == 0


def killed_io_comes_back_without_power_and_a_person_homes(robot: Robot) -> None:
    robot.trocar("send", "PSM1", "move_jp", "0", "0", "0.12", "0", "0", "0", "--wait")
    old = robot.kill("io")
    robot.comes_back("io", old)
    wait_for(lambda: echo(robot, "PSM1/state")["state"] == "FAULT", 60, "FAULT")
    wait_for(lambda: not np.any(echo(robot, "io/state")["powered"]), 60, "a record of the new io")
    state = echo(robot, "io/state")
    assert state["position"][2] == pytest.approx(0.12, abs=1e-5), "where it was, perhaps a cycle before the last one"
    robot.home()
    assert echo(robot, "PSM1/operating_state")["is_homed"] is True


@pytest.mark.parametrize("options", [pytest.param(("--clock", "wall"), marks=pytest.mark.soak), ()])
def test_killed_arm_is_held_and_goes_on_without_a_jump(robot: Robot, options: tuple[str, ...]) -> None:
    robot.up(KINEMATIC, *options)
    robot.home()
    robot.trocar("send", "PSM1", "move_jp", *map(str, PLACE))
    wait_for(lambda: there(robot, "PSM1", PLACE), 60, "the move")
    io = directory.reader(robot.name, "io", "state")
    assert io.newest()
    first = int(io.field("cycle"))
    old = robot.kill("PSM1")
    robot.comes_back("PSM1", old)
    wait_for(lambda: echo(robot, "PSM1/state")["is_homed"], 60, "homed again, by shared memory alone")
    history = io.last(3000)
    history = history[history["cycle"] >= first]
    assert history["pid_enabled"].all() and np.abs(np.diff(history["position"], axis=0)).max() < 1e-12
    io.close()
    robot.trocar("send", "PSM1", "move_jp", "0", "0", "0.12", "0", "0", "0")
    wait_for(lambda: there(robot, "PSM1", HOME), 60, "a move afterwards")


def test_real_and_kinematic_arms_run_side_by_side(robot: Robot, tmp_path: Path) -> None:
    system = yaml.safe_load(DEMO.read_text())
    system["arms"].append({"name": "PSM2", "type": "PSM", "simulation": "KINEMATIC",
                           "arm_file": "arms/PSM1-demo.yaml"})
    file = tmp_path / "mixed.json"
    file.write_text(json.dumps(system))
    robot.up(file)
    robot.home()
    for arm, goal in (("PSM1", PLACE), ("PSM2", tuple(-0.5 * np.array(PLACE) + (0, 0, 0.2, 0, 0, 0)))):
        robot.trocar("send", arm, "move_jp", *map(str, goal))
        wait_for(lambda: np.abs(np.array(echo(robot, f"{arm}/measured_js")["position"]) - goal).max() < 0.02,  # noqa: B023
                 60, f"the move of {arm}")
    rows = {row["name"]: row["simulation"] for row in json.loads(robot.trocar("status", "--json"))["processes"]}
    assert rows == {"supervisor": "", "boards": "", "IO1": "", "PSM1": "", "io": "KINEMATIC", "PSM2": "KINEMATIC",
                    "system": ""}
    assert echo(robot, "PSM1/state")["simulated"] is False
    robot.kill("io")
    wait_for(lambda: echo(robot, "PSM2/state")["state"] == "FAULT", 60, "FAULT of the kinematic arm")
    assert echo(robot, "PSM1/operating_state")["is_homed"] is True, "the other arm notices nothing"


@pytest.mark.simulated("hosted")
def test_stock_full_system_homes_the_arms_there_are(robot: Robot, data: Callable[[str], Path]) -> None:
    robot.up(data("dvrk-share/system/system-full-system-simulated.json"), "--path", str(data("dvrk-share")))
    robot.home()
    for arm in ("PSM1", "PSM2", "PSM3"):
        wait_for(lambda: there(robot, arm, HOME), 60, f"{arm} at home")  # noqa: B023
    wait_for(lambda: there(robot, "ECM", (0, 0, 0.12, 0)), 60, "ECM at home")
    wait_for(lambda: there(robot, "MTML", (0,) * 7), 60, "MTML at home")
