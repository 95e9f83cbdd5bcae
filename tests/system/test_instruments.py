"""A PSM on emulated boards: its sterile adapter is put on, then an instrument, whose memory says which one it is."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import yaml

from tests.system.robot import DEMO, Robot, wait_for
from trocar.shm.system import directory

pytestmark = [pytest.mark.slow, pytest.mark.simulated("hosted")]
FASTEST = np.array((1.6, 1.6, 0.21, 19.0, 19.0, 19.0, 19.0)) / 500  # of actuators, in a cycle


def echo(robot: Robot, topic: str) -> dict:
    return json.loads(robot.trocar("echo", topic, "--json", "--once"))


def is_reported(robot: Robot, text: str) -> bool:
    """Whether an event says so."""
    events = directory.reader(robot.name, "PSM1", "events")
    texts = [row["text"].decode() for row in events.last(200)]
    events.close()
    return any(text in each for each in texts)


def with_memory(folder: Path) -> Path:
    """The demo, with nothing on its arm and the memory of instruments read."""
    arm = folder / "PSM1.yaml"
    keys = {"kinematic": "kinematic/PSM.yaml", "generation": "Classic", "tool_detection": "AUTOMATIC"}
    arm.write_text(yaml.safe_dump({"$id": "dvrk-psm.schema.json", "$version": "1", **keys}))
    system = yaml.safe_load(DEMO.read_text())
    system["arms"][0]["arm_file"] = str(arm)
    file = folder / "system.yaml"
    file.write_text(yaml.safe_dump(system))
    return file


def test_adapter_and_instrument_are_engaged_and_a_successor_keeps_them(robot: Robot, tmp_path: Path) -> None:
    robot.up(with_memory(tmp_path))
    robot.trocar("home", "PSM1")
    assert len(echo(robot, "PSM1/measured_js")["name"]) == 7
    robot.trocar("send", "boards", "press", "PSM1_adapter", "1")
    wait_for(lambda: is_reported(robot, "engaging adapter"), 300, "engaging the adapter")
    robot.trocar("home", "PSM1", "--timeout", "300", timeout=320)
    assert is_reported(robot, "engaging adapter 4 of 4")
    robot.trocar("send", "boards", "insert_instrument", "PSM1 LARGE_NEEDLE_DRIVER:400006")
    wait_for(lambda: is_reported(robot, "engaging tool"), 300, "engaging the instrument")
    robot.trocar("home", "PSM1", "--timeout", "300", timeout=320)
    assert is_reported(robot, "engaging tool 3 of 3")
    setpoints = directory.reader(robot.name, "IO1", "state")
    old = robot.kill("PSM1")
    wait_for(lambda: robot.pid("PSM1") != old and robot.state("PSM1") == "RUNNING", 60, "the arm's restart")
    wait_for(lambda: echo(robot, "PSM1/operating_state")["is_homed"], 60, "homed again, by shared memory alone")
    history = setpoints.last(4000)
    setpoints.close()
    assert (np.abs(np.diff(history["setpoint_position"][:, :7], axis=0)) <= FASTEST).all()
    state = echo(robot, "PSM1/state")
    assert state["tool"] == "LARGE_NEEDLE_DRIVER:400006" and state["count"] == 6 and state["cartesian_valid"]
    assert (state["adapter"], state["instrument"]) == (4, 4)
    robot.trocar("send", "PSM1", "jaw/move_jp", "0.5", "--wait")
    robot.trocar("send", "boards", "remove_instrument", "PSM1")
    wait_for(lambda: echo(robot, "PSM1/state")["count"] == 7, 60, "bare discs")
    robot.trocar("power-off")
