"""Two I/O processes, each alone on its bus: what becomes of one does not touch the other."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import yaml

from tests.system.robot import AT_250_HZ, ROOT, Robot, wait_for
from tests.system.robot_in_host import HOSTED
from trocar.shm.system import directory
from trocar.tools.bench.io_loop import write_system

pytestmark = [pytest.mark.slow, pytest.mark.simulated]


def two_buses(folder: Path) -> Path:
    """Two PSMs, each on a bus of its own."""
    file = write_system(folder, 2)
    system = yaml.safe_load(file.read_text())
    system["IOs"] = [{"name": "IO1", "port": "udp"}, {"name": "IO2", "port": "udp:169.254.0.101"}]
    system["arms"][1]["IO"] = "IO2"
    file.write_text(yaml.safe_dump(system))
    return file


def shown(robot: Robot, instance: str, name: str) -> list[float]:
    """One field of an instance's newest record."""
    reader = directory.reader(robot.name, instance, "state")
    assert reader.newest()
    value = reader.field(name).tolist()
    reader.close()
    return list(value) if isinstance(value, list) else [value]


def test_an_io_that_is_killed_leaves_the_robot_of_another_homed_and_holding(robot: Robot, tmp_path: Path) -> None:
    robot.up(two_buses(tmp_path))
    robot.trocar("power-on")
    robot.home("PSM2")
    faults = shown(robot, "IO2", "fault")
    died = robot.kill("IO1")
    wait_for(lambda: not any(shown(robot, "boards", "amp_on")[:7]), 60, "the first bus cuts its amplifiers")
    wait_for(lambda: robot.state("IO1") == "RUNNING" and robot.pid("IO1") != died, 60, "IO1 is there again")
    assert shown(robot, "IO2", "fault") == faults == [0]
    assert all(shown(robot, "boards", "amp_on")[7:]) and all(shown(robot, "IO2", "powered"))
    state = json.loads(robot.trocar("echo", "PSM2/operating_state", "--json", "--once"))
    assert state["state"] == "ENABLED" and state["is_homed"], state
    assert all(shown(robot, "IO2", "pid_enabled"))
    robot.trocar("power-on", "PSM1")
    wait_for(lambda: all(shown(robot, "IO1", "powered")), 60, "IO1 has power again")


def two_masters_of_one_name(folder: Path) -> Path:
    """The masters of two consoles: each on its bus with the same files, pedals included."""
    row = {"type": "MTM", "serial": "demo", "name_on_IO": "MTML",
           **{key: f"{ROOT}/configs/{value}" for key, value in (
               ("arm_file", "arms/MTML-demo.yaml"), ("IO_file", "io/MTML-demo.yaml"),
               ("IO_gripper_file", "io/MTML-gripper-demo.yaml"), ("PID_file", "pid/MTM.yaml"))}}
    pedals = [f"{ROOT}/configs/io/pedals-demo.yaml"]
    system = {
        "$id": "dvrk-system.schema.json", "$version": "1",
        "IOs": [{"name": "IO1", "port": "udp", "configuration_files": pedals},
                {"name": "IO2", "port": "udp:169.254.0.101", "configuration_files": pedals}],
        "arms": [{"name": "MTML", "IO": "IO1", **row}, {"name": "MTML2", "IO": "IO2", **row}],
    }
    file = folder / "consoles.yaml"
    file.write_text(yaml.safe_dump(system))
    return file


@pytest.mark.simulated(HOSTED)
def test_robots_of_one_name_on_two_buses_are_homed_and_pushed_apart(robot: Robot, tmp_path: Path) -> None:
    robot.up(two_masters_of_one_name(tmp_path), "--boards", "emulated", *AT_250_HZ)
    robot.trocar("power-on")
    robot.trocar("home", "MTML2")
    assert '"HOMED"' in robot.trocar("echo", "MTML2/operating_state", "--json", "--once")
    assert '"ENABLED"' in robot.trocar("echo", "MTML/operating_state", "--json", "--once")
    robot.trocar("send", "boards", "press", "1", "IO2/clutch", "--wait")
    wait_for(lambda: shown(robot, "IO2", "input")[0], 60, "the second console's pedal")
    assert not shown(robot, "IO1", "input")[0]
    refused = robot.trocar("send", "boards", "press", "1", "clutch", "--wait", code=1)
    assert "IO1/clutch" in refused and "IO2/clutch" in refused
    robot.trocar("send", "boards", "amp_fault", "2", "1", "IO2/MTML", "--wait")
    wait_for(lambda: "FAULT" in robot.trocar("echo", "MTML2/operating_state", "--json", "--once"), 60, "its fault")
    assert "FAULT" not in robot.trocar("echo", "MTML/operating_state", "--json", "--once")
