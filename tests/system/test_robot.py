"""The first robot: starts, homes, moves, is looked at, and leaves nothing behind."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from pathlib import Path

import pytest

from shm import directory
from shm.pulse import Pulse
from tests.system.robot import DEMO, Robot

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


def test_a_recorded_motion_is_followed_through_the_whole_stack(robot: Robot, data: Callable[[str], Path]) -> None:
    file = data("real/psm_measured_one.csv")
    robot.up(DEMO)
    robot.trocar("power-on")
    robot.trocar("home")
    result = json.loads(robot.trocar("stream", "PSM1", str(file), "--rate", "200", "--json"))
    rms = result["rms"]
    assert rms[0] <= 0.02
    assert rms[1] <= 0.02
    assert rms[2] <= 0.001
    assert result["jaw_clipped_rows"] > 0
    assert json.loads(robot.trocar("echo", "PSM1/operating_state", "--json", "--once"))["is_homed"] is True


def test_status_list_and_hz_tell_about_a_running_system(robot: Robot) -> None:
    robot.up(DEMO)
    status = json.loads(robot.trocar("status", "--json"))
    names = {row["name"] for row in status["processes"]}
    assert {"boards", "IO1", "PSM1"} <= names
    topics = robot.trocar("list")
    assert "PSM1/measured_js" in topics
    assert "IO1/PSM1/measured_js" in topics
    rates = json.loads(robot.trocar("hz", "IO1/state", "--json"))
    assert rates


def test_the_demo_ends_by_itself_and_was_healthy(robot: Robot) -> None:
    said = robot.trocar("demo", "--for", "6", "--json", "--system", robot.name)
    summary = json.loads(said.splitlines()[-1])
    assert summary["state"] == "ENABLED"
    assert robot.left_over() == []


def test_whoever_waits_at_a_bell_is_woken_by_the_next_cycle(robot: Robot) -> None:
    robot.up(DEMO)
    for instance in ("IO1", "PSM1", "boards"):
        page = Pulse(robot.name, instance, write=True)
        place, reader = page.waiter(), directory.reader(robot.name, instance, "state")
        for _ in range(50):
            seen = reader.head
            waits = (place.wait(lambda: reader.head != seen, 20_000_000_000) for _ in range(3))  # noqa: B023
            assert any(waits), "a ring for the record before may come first"
        reader.close()
        page.close()
