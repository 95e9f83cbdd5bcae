"""Fixtures for whole systems: all are stopped at the end of a test, nothing may be left behind."""

from __future__ import annotations

import itertools
import os
import signal
from collections.abc import Callable, Iterator
from pathlib import Path

import psutil
import pytest

from shm.segment import names_of, segment_name, unlink
from tests.system.robot import Robot

COUNTER = itertools.count()


@pytest.fixture
def robots(tmp_path: Path) -> Iterator[Callable[[], Robot]]:
    """A maker of systems; all are stopped at the end, and the test fails when one leaves something behind."""
    made: list[Robot] = []

    def make() -> Robot:
        name = f"t{os.getpid()}-{next(COUNTER)}"
        folder = tmp_path / name
        folder.mkdir()
        made.append(Robot(name, folder))
        return made[-1]

    yield make
    left: list[str] = []
    for robot in made:
        robot.down()
        left += robot.left_over()
        for pid in robot.pids:
            if psutil.pid_exists(pid):
                os.kill(pid, signal.SIGKILL)
        for parts in names_of(robot.name):
            unlink(segment_name(*parts))
    assert not left, f"left behind: {left}"


@pytest.fixture
def robot(robots: Callable[[], Robot]) -> Robot:
    """One system."""
    return robots()
