"""The clock: wall time, and simulated time that advances only when everybody has finished."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

import pytest

from shm.clock import EPOCH_NS, Conductor, LockstepClock, WallClock
from shm.pulse import Pulse, create_control
from shm.segment import segment_name, unlink

PLAYER = """
import sys
from shm.clock import LockstepClock
from shm.pulse import Pulse
pulse = Pulse(sys.argv[1], sys.argv[2], write=True)
clock = LockstepClock(sys.argv[1], pulse)
period, count = int(sys.argv[3]), int(sys.argv[4])
deadline = clock.now_ns()
seen = []
for _ in range(count):
    deadline += period
    clock.sleep_until(deadline, lambda: False)
    seen.append(clock.now_ns())
clock.announce(10**18)
print(*seen)
"""
GIVE_UP_NS = 30_000_000_000


@pytest.fixture
def conductor(world: Any) -> Iterator[Conductor]:
    leader = Conductor(world.name)
    yield leader
    leader.close()
    unlink(segment_name(world.name, "supervisor", "clock"))


@pytest.fixture
def player(world: Any) -> Iterator[Pulse]:
    create_control(world.name, "A")
    page = Pulse(world.name, "A", write=True)
    yield page
    page.close()
    unlink(segment_name(world.name, "A", "control"))


def test_wall_time_never_goes_back_and_sleeps_long_enough() -> None:
    clock = WallClock(spin_ns=50_000)
    deadline = clock.now_ns() + 3_000_000
    clock.sleep_until(deadline, lambda: False)
    assert clock.now_ns() >= deadline
    assert abs(clock.now_ns() - time.monotonic_ns()) < 10**9


def test_a_deadline_that_has_passed_does_not_sleep(monkeypatch: pytest.MonkeyPatch) -> None:
    slept: list[float] = []
    monkeypatch.setattr(time, "sleep", slept.append)
    clock = WallClock(spin_ns=50_000)
    for deadline_ns in (0, clock.now_ns() - 10**15, clock.now_ns()):
        clock.sleep_until(deadline_ns, lambda: False)
    assert slept == []
    WallClock().sleep_until(clock.now_ns() + 10**15, lambda: False)
    assert [round(each, -3) for each in slept] == [10**6]  # a sleep would have been seen


def test_two_processes_advance_exactly_in_lock_step(world: Any, conductor: Conductor) -> None:
    for name in "AB":
        create_control(world.name, name)
    fast = world.start(PLAYER, "A", "1000000", "30")
    slow = world.start(PLAYER, "B", "2500000", "12")
    players = [Pulse(world.name, name, write=True) for name in "AB"]
    times = [conductor.now_ns]
    while conductor.now_ns < EPOCH_NS + 30_000_000:
        assert conductor.advance(players, GIVE_UP_NS)
        times.append(conductor.now_ns)
    seen = [[int(t) for t in world.finish(child).split()] for child in (fast, slow)]
    expected = [[EPOCH_NS + k * p for k in range(1, n + 1)] for p, n in ((1_000_000, 30), (2_500_000, 12))]
    assert seen == expected
    assert times == sorted({EPOCH_NS, *expected[0], *expected[1]})  # no step was left out, none was made up
    for page in players:
        page.close()
    world.remove()


def test_time_stands_while_a_player_works(conductor: Conductor, player: Pulse) -> None:
    clock = LockstepClock(conductor._segment.name.split("~")[1], player)
    assert clock.simulated and clock.now_ns() == EPOCH_NS
    assert not conductor.advance([player], 1_000_000)
    assert (conductor.now_ns, conductor.held_up_by) == (EPOCH_NS, "A")
    clock.announce(EPOCH_NS + 500)
    assert conductor.advance([player], 1_000_000) and conductor.held_up_by == ""
    assert clock.now_ns() == EPOCH_NS + 500
    assert not conductor.advance([player], 1_000_000)  # woken, but has not finished what is due now
    clock.announce(EPOCH_NS + 900)
    assert conductor.advance([player], 1_000_000) and clock.now_ns() == EPOCH_NS + 900


def test_a_stopped_player_does_not_wait_for_time(conductor: Conductor, player: Pulse) -> None:
    clock = LockstepClock(conductor._segment.name.split("~")[1], player)
    clock.sleep_until(EPOCH_NS + 10**12, lambda: True)
    assert clock.now_ns() == EPOCH_NS


def test_a_dead_player_stops_time_and_not_the_conductor(world: Any, conductor: Conductor, player: Pulse) -> None:
    child = world.start(PLAYER, "A", "1000000", "1000000")
    assert conductor.advance([player], GIVE_UP_NS)
    world.kill(child)
    while conductor.advance([player], 5_000_000):
        pass
    before = conductor.now_ns
    assert not conductor.advance([player], 5_000_000) and conductor.now_ns == before


def test_without_players_time_goes_on(conductor: Conductor) -> None:
    assert conductor.advance([], 0) and conductor.now_ns == EPOCH_NS + 1_000_000
