"""Gains tuned on a whole system, saved, and used by the next start."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from procs.lib.config import load_system
from procs.lib.gains import GAINS, value_of
from tests.system.robot import DEMO, Robot

pytestmark = pytest.mark.slow


def test_gains_tuned_while_holding_are_those_of_the_next_start(robot: Robot, tmp_path: Path) -> None:
    robot.up()
    robot.trocar("power-on")
    robot.trocar("home")
    robot.trocar("pid", "set", "PSM1", "3", "p_gain=6.6", "d_gain=0.1", "i_gain=0.001", "i_limit=0.3")
    robot.trocar("pid", "set", "PSM1", "insertion", f"p_gain={17000 / 3}")
    told = robot.trocar("echo", "IO1/status", "--once", "--json")
    assert "p_gain 6000 -> 5666.66667" in told
    used = [json.loads(line) for line in robot.trocar("pid", "show", "--json").splitlines()]
    robot.trocar("pid", "save", "PSM1", str(tmp_path / "tuned.json"))
    state = json.loads(robot.trocar("echo", "PSM1/state", "--once", "--json"))
    assert state["state"] == "ENABLED" and state["is_homed"]  # holding all the time
    text = DEMO.read_text()
    assert "pid/PSM.yaml" in text
    (tmp_path / "next.yaml").write_text(text.replace("pid/PSM.yaml", "tuned.json"))
    system = load_system(tmp_path / "next.yaml", boards="emulated").system
    assert system is not None
    axes = system.io("IO1").pids[0].axes
    assert [{gain.key: value_of(axis, gain.key) for gain in GAINS} for axis in axes] == [
        {gain.key: row[gain.key] for gain in GAINS} for row in used]
    assert used[2]["p_gain"] == 17000 / 3 and used[3]["changed"] == ["p_gain", "d_gain", "i_gain", "i_limit"]
