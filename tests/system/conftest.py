"""Fixtures for whole systems: all are stopped at the end of a test, nothing may be left behind."""

from __future__ import annotations

import contextlib
import itertools
import json
import os
import signal
from collections.abc import Callable, Iterator
from pathlib import Path

import psutil
import pytest

from tests.system.robot import LED, VERBS, Robot
from tests.system.robot_in_host import HOSTED, RobotInHost
from tests.system.verb_template import VerbTemplate
from trocar.shm.memory.parts import remove_all
from trocar.shm.ring.ring import RingReader
from trocar.shm.system import directory

COUNTER = itertools.count()
PRINTED = 5000


@pytest.fixture(scope="session", autouse=True)
def verbs() -> Iterator[None]:
    """Systems begin as forks of one process that has imported everything."""
    VERBS.append(VerbTemplate())
    yield
    VERBS.pop().close()


def clock_of(node: pytest.Item | pytest.Collector) -> str:
    """The usual clock of a test's systems: LED, or that which the mark names, where time is simulated."""
    simulated = node.get_closest_marker("simulated")
    return "wall" if simulated is None else str(simulated.args[0]) if simulated.args else LED


@contextlib.contextmanager
def systems(place: Path, clock: str = "wall") -> Iterator[Callable[[], Robot]]:
    """A maker of systems; all are stopped at the end, which fails when one leaves something behind."""
    made: list[Robot] = []

    def make() -> Robot:
        name = f"t{os.getpid()}-{next(COUNTER)}"
        folder = place / name
        folder.mkdir()
        made.append((RobotInHost if clock == HOSTED else Robot)(name, folder, clock))
        return made[-1]

    left: list[str] = []
    try:
        yield make
    finally:
        for robot in made:
            robot.down()
            print(f"{robot.name} printed:\n{robot.output()[-PRINTED:]}")  # pytest shows it where a test failed
            left += robot.left_over()
            for pid in robot.pids:
                if psutil.pid_exists(pid):
                    os.kill(pid, signal.SIGKILL)
            remove_all(robot.name)
    assert not left, f"left behind: {left}"


@pytest.fixture
def robots(tmp_path: Path, request: pytest.FixtureRequest) -> Iterator[Callable[[], Robot]]:
    """A maker of systems for one test."""
    with systems(tmp_path, clock_of(request.node)) as make:
        yield make


@pytest.fixture(scope="module")
def running_demo(tmp_path_factory: pytest.TempPathFactory, request: pytest.FixtureRequest) -> Iterator[Robot]:
    """The demo's system, started once for the tests of a file."""
    with systems(tmp_path_factory.mktemp("demo"), clock_of(request.node)) as make:
        robot = make()
        robot.up()
        yield robot


@pytest.fixture
def demo(running_demo: Robot) -> Robot:
    """The demo's system, homed whatever the test before left."""
    if not json.loads(running_demo.trocar("echo", "PSM1/operating_state", "--json", "--once"))["is_homed"]:
        running_demo.trocar("power-on")
        running_demo.trocar("home")
    return running_demo


@pytest.fixture
def robot(robots: Callable[[], Robot]) -> Robot:
    """One system."""
    return robots()


@pytest.fixture
def records() -> Iterator[Callable[[Robot, str, str], RingReader]]:
    """Readers of a system's records, given back at the end."""
    made: list[RingReader] = []

    def read(robot: Robot, instance: str, topic: str) -> RingReader:
        made.append(directory.reader(robot.name, instance, topic))
        return made[-1]

    yield read
    for reader in made:
        reader.close()
