"""`trocar down` says what is true: other users, damaged pages, who hangs and who was left over, with real systems."""

from __future__ import annotations

import contextlib
import itertools
import os
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest
from typer.testing import CliRunner

from tests.system.robot import DEMO, Robot, wait_for
from tests.system.test_memory import as_root, as_user
from trocar.shm.memory.parts import remove_all
from trocar.shm.memory.segment import FOLDER, names_of, path_of, segment_name
from trocar.shm.system import directory
from trocar.shm.time.clock import monotonic_ns
from trocar.tools import cli
from trocar.tools.systems.processes import running

pytestmark = pytest.mark.slow
COUNTER = itertools.count()
FILE = DEMO.parent / "kinematic.yaml"


@contextlib.contextmanager
def up(place: Path, *options: str) -> Iterator[Robot]:
    """A running system without boards, and its processes."""
    robot = Robot(f"t{os.getpid()}-d{next(COUNTER)}", place)
    try:
        robot.up(FILE, *options)
        yield robot
    finally:  # whatever is left; the test has failed then
        for process in running(robot.name):
            os.kill(process.pid, signal.SIGKILL)
        assert robot.supervisor is not None
        robot.supervisor.wait(10)
        remove_all(robot.name)


def is_down(robot: Robot) -> bool:
    """Nothing runs, nothing lies in shared memory."""
    assert robot.supervisor is not None
    robot.supervisor.wait(10)
    return not robot.left_over() and not list(FOLDER.glob(f"trocar~{robot.name}~*")) and not running(robot.name)


def scribble(robot: Robot, instance: str, what: str) -> None:
    """The header of a segment makes no sense any more; who has mapped it goes on."""
    with path_of(segment_name(robot.name, instance, what)).open("r+b") as file:
        file.write(b"nonsense")


def reported_to(user: str, *words: str) -> str:
    """Exit code and messages of a verb that another user types."""
    app = cli.build()

    def verb() -> str:
        result = CliRunner().invoke(app, list(words))
        return f"{result.exit_code} {result.output}"

    return as_user(user, verb)


def test_another_user_is_told_whose_the_system_is(tmp_path: Path) -> None:
    as_root()
    with up(tmp_path) as robot:
        for verb in ("down", "status", "list", "logs", "power-off", "up"):
            reported = reported_to("nobody", verb, "--system", robot.name)
            assert reported.startswith(f"1 trocar: not permitted: system {robot.name} belongs to user root"), (verb,
                                                                                                               reported)
        assert robot.state("PSM1") == "RUNNING"
        os.truncate(path_of(segment_name(robot.name, "supervisor", "control")), 0)  # it dies, others as well
        reported = robot.trocar("down", "--system", robot.name)
        assert f"system {robot.name} is down" in reported or "segments left by" in reported
        assert is_down(robot), names_of(robot.name)


def test_a_supervisor_that_cannot_be_asked_is_ended_by_a_signal(tmp_path: Path) -> None:
    with up(tmp_path) as robot:
        for what in ("control", "mailbox", "document"):
            scribble(robot, "supervisor", what)
        assert f"system {robot.name} is down" in robot.trocar("down", "--system", robot.name)
        assert is_down(robot)


def test_who_hangs_is_not_taken_for_off_and_is_woken_to_end(tmp_path: Path) -> None:
    with up(tmp_path, "--set", "supervisor_lost_s=60") as robot:
        for instance in ("supervisor", "PSM1"):
            os.kill(robot.pid(instance), signal.SIGSTOP)
        state = directory.reader(robot.name, "PSM1", "state")
        wait_for(lambda: state.newest() and monotonic_ns() - state.stamp_ns > 300_000_000, 10.0, "an old record")
        state.close()
        assert "NOT disabled" in robot.trocar("power-off", "--timeout", "0.2", "--system", robot.name, code=1)
        too_soon = robot.trocar("down", "--timeout", "0.5", "--system", robot.name, code=1)
        assert f"is not down after 0.5 s: supervisor (pid {robot.pid('supervisor')})" in too_soon
        assert "segments in shared memory" in too_soon
        assert f"system {robot.name} is down" in robot.trocar("down", "--system", robot.name)
        assert is_down(robot)


def test_processes_of_a_dead_supervisor_are_ended_before_their_memory_goes(tmp_path: Path) -> None:
    with up(tmp_path) as robot:
        os.kill(robot.pid("PSM1"), signal.SIGSTOP)
        robot.kill("supervisor")
        assert robot.supervisor is not None
        robot.supervisor.wait(10)
        assert "segments left by" in robot.trocar("down", "--system", robot.name)
        assert is_down(robot)
        assert robot.name not in directory.systems()
