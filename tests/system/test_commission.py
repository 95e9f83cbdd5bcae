"""Commissioning of running systems: a whole rehearsal, and what only processes can show going wrong."""

from __future__ import annotations

import contextlib
import dataclasses
import json
import shlex
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
import yaml

from tests.system.robot import DEMO, Robot
from tests.system.robot_in_host import HOSTED, RobotInHost
from trocar.procs.document.system import from_json
from trocar.shm.system import directory
from trocar.tools.cli import VERBS, examples_of
from trocar.tools.client.remote import Remote
from trocar.tools.commission import depth, home, move, scan, stop
from trocar.tools.commission import verb as commission
from trocar.tools.commission.bench import RunningBench
from trocar.tools.commission.finding import Outcome
from trocar.tools.commission.person import Act, Stop
from trocar.tools.commission.person_sim import AtBoards
from trocar.tools.commission.stages import NAMES, STAGES
from trocar.tools.output.errors import Problem
from trocar.tools.systems.supervising import StartRequest

pytestmark = [pytest.mark.slow, pytest.mark.patient]
WATCHDOG_S = 0.3  # the most that boards take: a busy machine holds io up for longer than the usual 0.03 s now and then
PATIENCE = {"late_s": 5.0, "hung_s": 60.0}


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
def hosted_where_possible(robot: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    """The command runs in this process. So does its system, but for the stages that need a bus or real time."""
    started = commission.up_meanwhile

    @contextlib.contextmanager
    def up_meanwhile(request: StartRequest) -> Iterator[object]:
        if "clock=wall" in request.sets:
            with started(request) as background:
                yield background
            return
        host = RobotInHost(robot.name, robot.logs, HOSTED)
        try:
            sets = (word for each in request.sets for word in ("--set", each))
            host.up(request.file, "--boards", request.boards, *sets)
            yield host
        finally:
            host.down()

    on_the_bus, *others = STAGES
    assert on_the_bus.name == "scan"
    monkeypatch.setattr(commission, "STAGES", (dataclasses.replace(on_the_bus, real_time=True), *others))
    monkeypatch.setattr(commission, "up_meanwhile", up_meanwhile)
    monkeypatch.setattr("tests.system.robot.OWN_PROCESS", ())
    monkeypatch.setattr(move, "RATIO", 0.5)  # faster than beside a person
    monkeypatch.setattr(depth, "TIMES", 2)


@pytest.mark.usefixtures("hosted_where_possible")
def test_a_good_robot_is_commissioned_by_one_command(robot: Robot, file: Path, tmp_path: Path) -> None:
    (example,) = (line for verb in VERBS for line in examples_of(verb) if line.startswith("trocar commission"))
    _, verb, given, *options = shlex.split(example)
    assert given == str(DEMO.relative_to(robot.root))
    book = tmp_path / "book.json"
    command = verb, str(file), *options, "--system", robot.name, "--report", str(book)
    done = robot.types(*command)
    assert ".py:" not in done.stderr and "Clipped" not in done.stderr
    tries = json.loads(book.read_text())["tries"]
    if done.returncode:  # real time is measured in one stage: the same command resumes there
        failed = tries.pop()
        assert failed["stage"] == "stop" and "the load of other programs" in done.stderr, done.stderr
        robot.trocar(*command)
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
