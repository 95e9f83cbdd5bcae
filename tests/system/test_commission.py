"""Commissioning of running systems: a whole rehearsal, and what only processes can show going wrong."""

from __future__ import annotations

import json
import shlex
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
import yaml

from tests.system.robot import DEMO, Robot
from trocar.procs.document.system import from_json
from trocar.shm.system import directory
from trocar.tools.cli import VERBS, examples_of
from trocar.tools.client.remote import Remote
from trocar.tools.commission import home, move, scan, stop
from trocar.tools.commission.bench import RunningBench
from trocar.tools.commission.finding import Outcome
from trocar.tools.commission.person import Act, Stop
from trocar.tools.commission.person_sim import AtBoards
from trocar.tools.commission.stages import NAMES
from trocar.tools.output.errors import Problem

pytestmark = [pytest.mark.slow, pytest.mark.patient]
WATCHDOG_S = 0.3  # the most that boards take: a busy machine holds io up for longer than the usual 0.03 s now and then
PATIENCE = {"late_s": 5.0, "hung_s": 60.0}
BUSY = "import time; end = time.monotonic() + 8.0\nwhile time.monotonic() < end: pass"
"""Longer than the stage that measures real time."""


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """The demo with boards and a supervisor that are as patient as we are."""
    system = yaml.safe_load(DEMO.read_text())
    system["IOs"][0]["watchdog_timeout"] = WATCHDOG_S
    system["trocar"] |= {"supervisor_lost_s": 30.0, "processes": {"IO1": PATIENCE, "PSM1": PATIENCE}}
    system["trocar"] |= {part: {"period_s": 0.002} for part in ("io", "arm", "emulation")}
    path = tmp_path / DEMO.name
    path.write_text(yaml.safe_dump(system))
    return path


@pytest.fixture
def busy() -> Iterator[list[subprocess.Popen[bytes]]]:
    """Two programs that take all the time they get while the robot is looked at and stopped."""
    loops = [subprocess.Popen([sys.executable, "-c", BUSY]) for _ in range(2)]
    try:
        yield loops
    finally:
        for loop in loops:
            loop.kill()
            loop.wait()


def test_a_good_robot_is_commissioned_beside_two_busy_programs(
    robot: Robot, file: Path, tmp_path: Path, busy: list[subprocess.Popen[bytes]]
) -> None:
    (example,) = (line for verb in VERBS for line in examples_of(verb) if line.startswith("trocar commission"))
    _, verb, given, *options = shlex.split(example)
    assert given == str(DEMO.relative_to(robot.root))
    book = tmp_path / "book.json"
    command = verb, str(file), *options, "--system", robot.name, "--report", str(book)
    done = robot.types(*command, timeout=1200.0)
    assert ".py:" not in done.stderr and "Clipped" not in done.stderr
    tries = json.loads(book.read_text())["tries"]
    if done.returncode:  # real time is measured in one stage: the same command resumes there once the machine is free
        failed = tries.pop()
        assert failed["stage"] == "stop" and "the load of other programs" in done.stderr, done.stderr
        for loop in busy:
            loop.kill()
        robot.trocar(*command, timeout=1200.0)
        tries += json.loads(book.read_text())["tries"][len(tries) + 1 :]
    assert [row["stage"] for row in tries] == list(NAMES)
    assert all(row["passed"] for row in tries)
    figures = {row["stage"]: row["figures"] for row in tries}
    assert {row["board"] for row in figures["scan"]["IO1"]} == {6, 7}
    assert all(0.0 < seconds < WATCHDOG_S + 0.05 for seconds in figures["stop"]["IO1 watchdog_s"].values())
    assert figures["stop"]["IO1 stop_s"]["PSM1"] <= 0.1
    assert (tmp_path / "PSM1-demo-rehearsed.json").exists()
    assert robot.left_over() == []


class Absent(AtBoards):
    """A person who presses a stop that is not wired to anything."""

    def doing(self, act: Act, text: str) -> Iterator[None]:
        return iter((None,) * 5) if isinstance(act, Stop) else super().doing(act, text)


@pytest.fixture
def running(robot: Robot, file: Path) -> Iterator[tuple[Robot, RunningBench]]:
    robot.up(file)
    document = from_json(directory.document(robot.name))
    with Absent(document) as person, RunningBench(document, person) as bench:
        yield robot, bench


def _order(robot: Robot, command: str, *values: float, text: str) -> None:
    with Remote(robot.name, "boards") as boards:
        boards.ask(command, values, text)


def _found(robot: Robot, run: Callable[[RunningBench], Outcome], bench: RunningBench) -> list[str]:
    """What a stage says is wrong where the machine was not too busy for it."""
    found: list[str] = []

    def attempt() -> str:
        try:
            found[:] = [str(each) for each in run(bench).problems]
        except Problem as problem:
            found[:] = [str(problem)]
        return "\n".join(found)

    robot.retry(attempt, run.__module__)
    return found


def test_stages_stop_at_a_stuck_axis_a_stop_without_effect_a_dead_amplifier_and_a_missing_board(
        running: tuple[Robot, RunningBench]) -> None:
    robot, bench = running
    _order(robot, "jam", 0, 1, text="PSM1")
    (found,) = _found(robot, move.run, bench)
    assert "yaw" in found and "allowed: " in found
    assert not np.any(bench.sample("IO1", 0.3).fields["amp_on"][-1])
    _order(robot, "jam", 0, 0, text="PSM1")
    reported = _found(robot, stop.run, bench)
    assert "PSM1 axis 0 (yaw), board 6: its amplifier is still on after the emergency stop; allowed: off" in reported[0]
    assert not np.any(bench.sample("IO1", 0.3).fields["amp_on"][-1])
    _order(robot, "amp_fault", 3, 1, text="PSM1")
    (failing,) = _found(robot, home.run, bench)
    assert "PSM1, boards 6, 7" in failing
    assert "amplifier" in failing
    assert "allowed: homed" in failing
    assert not np.any(bench.sample("IO1", 0.3).fields["amp_on"][-1])
    _order(robot, "unplug_board", 7, text="IO1")
    (missing,) = _found(robot, scan.run, bench)
    assert "board 7 on IO1" in missing
