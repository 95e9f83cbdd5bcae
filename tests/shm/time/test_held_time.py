"""Simulated time that a program holds back: it goes as far as that says, and goes on when that dies."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from typing import Any

import pytest

from tests.shm.time.test_lockstep import MS, PLAYER
from trocar.shm.memory.segment import SegmentError
from trocar.shm.time import held_time
from trocar.shm.time.clock import monotonic_ns
from trocar.shm.time.control_page import create_control
from trocar.shm.time.held_time import HeldTime
from trocar.shm.time.lockstep import EPOCH_NS, Table, Timekeeper

SECOND = 1_000_000_000
HOLDER = """
import sys
from trocar.shm.time.held_time import HeldTime
held = HeldTime(sys.argv[1])
print("holds", flush=True)
sys.stdin.read()
"""


@pytest.fixture
def time_(world: Any) -> Iterator[Timekeeper]:
    for name in ("A", "B"):
        create_control(world.name, name)
    made = Timekeeper(world.name, Table(("A", "B")))
    yield made
    made.close()
    world.remove()


def begin(world: Any, time_: Timekeeper) -> None:
    for name, period in (("A", MS), ("B", 2 * MS + MS // 2)):
        world.start(PLAYER, name, str(period), "100000000")
    time_.admit(["A", "B"])


@pytest.mark.slow
def test_time_goes_as_far_as_the_holder_says(world: Any, time_: Timekeeper) -> None:
    with HeldTime(world.name) as held:
        begin(world, time_)
        for until, stands in ((0, 0), (MS - 1, 0), (MS, MS), (int(2.2 * MS), 2 * MS), (int(2.5 * MS), int(2.5 * MS)),
                              (40 * MS, 40 * MS)):
            assert held.run_until(EPOCH_NS + until, 20.0)
            time_.let_pass(0.005)
            assert held.now_ns() == EPOCH_NS + stands == time_.now_ns(), until
            assert held.wake_ns("A") == EPOCH_NS + stands - stands % MS + MS
    world.until(lambda: time_.now_ns() > EPOCH_NS + 60 * MS, "time goes on")
    for child in list(world.children):
        world.kill(child)


@pytest.mark.slow
def test_time_goes_on_when_the_holder_dies(world: Any, time_: Timekeeper) -> None:
    holder = world.start(HOLDER)
    assert holder.stdout.readline() == "holds\n"
    begin(world, time_)
    with pytest.raises(SegmentError, match="another program holds the time"):
        HeldTime(world.name)
    time_.let_pass(0.05)
    assert time_.now_ns() == EPOCH_NS
    world.kill(holder)
    time_.let_pass(0.001)
    world.until(lambda: time_.now_ns() > EPOCH_NS + 20 * MS, "time goes on")
    for child in [child for child in world.children if child is not holder]:
        world.kill(child)


def test_a_run_that_takes_too_long_is_told(world: Any, time_: Timekeeper) -> None:
    time_.admit(["A", "B"])
    with HeldTime(world.name) as held:
        assert not held.run_until(EPOCH_NS + MS, 0.05), "A and B are awake"


def test_a_pause_of_the_whole_machine_is_no_time_that_was_waited(world: Any, time_: Timekeeper,
                                                                  monkeypatch: pytest.MonkeyPatch) -> None:
    with HeldTime(world.name) as held:
        begin(world, time_)
        looks = itertools.count()
        monkeypatch.setattr(held_time, "monotonic_ns", lambda: monotonic_ns() + (next(looks) > 0) * 1000 * SECOND)
        assert held.run_until(EPOCH_NS + MS, 20.0)
    for child in list(world.children):
        world.kill(child)


def test_who_makes_the_page_holds_time_until_all_are_up(world: Any, time_: Timekeeper) -> None:
    time_.hold(True)
    begin(world, time_)
    time_.let_pass(0.05)
    assert time_.now_ns() == EPOCH_NS
    time_.hold(False)
    time_.let_pass(0.001)
    world.until(lambda: time_.now_ns() > EPOCH_NS + 20 * MS, "time goes on")
    for child in list(world.children):
        world.kill(child)
