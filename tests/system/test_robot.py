"""The first robot: starts, homes and leaves nothing behind."""

from __future__ import annotations

import hashlib
import json
import shlex
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.system.robot import SLOWER, TELEOP_AT_500_HZ, Robot
from trocar.tools.cli import VERBS, examples_of

pytestmark = [pytest.mark.slow, pytest.mark.simulated]


def test_a_real_site_file_starts_on_emulated_boards_and_homes(robot: Robot, data: Callable[[str], Path]) -> None:
    file = data("dvrk-site/jhu-dVRK/system-PSM1.json")
    before = hashlib.sha256(file.read_bytes()).hexdigest()
    robot.up(file, "--path", str(data("dvrk-share")), "--boards", "emulated")
    assert "port fw replaced by emulated boards 6, 7" in robot.output()
    robot.trocar("power-on")
    robot.home()
    state = json.loads(robot.trocar("echo", "PSM1/operating_state", "--json", "--once"))
    assert state["state"] == "ENABLED"
    assert state["is_homed"] is True
    assert state["is_busy"] is False
    assert hashlib.sha256(file.read_bytes()).hexdigest() == before
    robot.trocar("power-off")
    assert robot.down() == 0


def test_the_demo_ends_by_itself_and_says_how_it_went(robot: Robot) -> None:
    (example,) = (line for verb in VERBS for line in examples_of(verb) if line.startswith("trocar demo"))
    words = shlex.split(example.replace("--for 10", "--for 3"))[1:]
    words += ["--json", "--system", robot.name, *SLOWER, *TELEOP_AT_500_HZ]
    summary = json.loads(robot.insist(*words, timeout=300))
    assert summary["homed_after_s"] > 0.0 and summary["supervisor_exit"] == 0
    assert summary["clock"] == "paced" and summary["following"] and 0.0 < summary["speed"] < 1.1
    assert 2.0 < summary["followed_s"] < 4.0 and summary["error_mm_rms"] < 2.0 and summary["latency_ms_p50"] > 0.0
    assert {row["missed"] for row in summary["processes"]} == {0}
    assert robot.left_over() == []
