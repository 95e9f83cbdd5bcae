"""The first robot: starts, homes and leaves nothing behind."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.system.robot import Robot

pytestmark = pytest.mark.slow


def test_a_real_site_file_starts_on_emulated_boards_and_homes(robot: Robot, data: Callable[[str], Path]) -> None:
    file = data("dvrk-site/jhu-dVRK/system-PSM1.json")
    before = hashlib.sha256(file.read_bytes()).hexdigest()
    robot.up(file, "--path", str(data("dvrk-share")), "--boards", "emulated")
    assert "port fw replaced by emulated boards 6, 7" in robot.said()
    robot.trocar("power-on")
    robot.trocar("home")
    state = json.loads(robot.trocar("echo", "PSM1/operating_state", "--json", "--once"))
    assert state["state"] == "ENABLED"
    assert state["is_homed"] is True
    assert state["is_busy"] is False
    assert hashlib.sha256(file.read_bytes()).hexdigest() == before
    robot.trocar("power-off")
    assert robot.down() == 0


def test_the_demo_ends_by_itself_and_says_how_it_went(robot: Robot) -> None:
    said = robot.trocar("demo", "--for", "6", "--json", "--system", robot.name, code=None)
    summary = json.loads(said.splitlines()[-1])
    assert summary["homed_after_s"] > 0.0 and summary["supervisor_exit"] == 0
    if summary["followed_s"] > 1.0:  # a machine with much else to do is told of
        assert summary["error_mm_rms"] < 2.0 and summary["latency_ms_p50"] > 0.0
    assert summary["following"] is not any(" is " in problem for problem in summary["problems"])
    assert robot.left_over() == []
