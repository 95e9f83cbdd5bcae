"""Paced time through the front door: the usual clock without hardware, and what is said of it."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time

import pytest

from tests.system.robot import DEMO, Robot, wait_for
from trocar.shm.time.system_time import SystemTime

pytestmark = [pytest.mark.slow, pytest.mark.simulated("paced")]
PACED = ("--clock", "paced")


def test_up_and_status_say_which_clock_and_how_fast(robot: Robot) -> None:
    robot.up(DEMO, "--boards", "emulated", *PACED)
    assert "clock: paced, simulated time, never faster than real time" in robot.output()
    wait_for(lambda: json.loads(robot.trocar("status", "--json"))["speed"] > 0.0, 20.0, "a speed")
    status = json.loads(robot.trocar("status", "--json"))
    assert status["clock"] == "paced" and status["speed"] < 1.02
    assert "of real time" in robot.trocar("status")
    assert robot.down() == 0


def test_a_busy_machine_costs_no_deadline_and_no_fault(robot: Robot) -> None:
    robot.up(DEMO, *PACED)
    busy = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in os.sched_getaffinity(0)]
    try:
        robot.trocar("power-on")
        with SystemTime(robot.name) as clock:
            begin, simulated = time.monotonic_ns(), clock.now_ns()
            clock.pause(2.0, 60.0)
            assert 1.9e9 < clock.now_ns() - simulated <= time.monotonic_ns() - begin + 10e6
    finally:
        for each in busy:
            each.kill()
            each.wait()
    state = json.loads(robot.trocar("echo", "PSM1/operating_state", "--json", "--once"))
    assert state["state"] == "ENABLED"
    rows = json.loads(robot.trocar("status", "--json"))["processes"]
    assert {row["name"]: (row["missed"], row["problem"], row["restarts"]) for row in rows} == {
        row["name"]: (0, "", 0) for row in rows}
    assert robot.down() == 0


def test_another_clock_can_be_asked_for(robot: Robot) -> None:
    robot.up(DEMO, "--clock", "wall")
    status = json.loads(robot.trocar("status", "--json"))
    assert (status["clock"], status["speed"]) == ("wall", 1.0) and "clock: wall" in robot.output()
    assert "allowed are wall, paced, lockstep" in robot.trocar("up", "--clock", "sundial", code=2)
    assert robot.down() == 0
