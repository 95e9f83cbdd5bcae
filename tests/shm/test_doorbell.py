"""The doorbell: wakes who waits, costs nothing when nobody does, and every wait ends."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

import pytest

from shm.doorbell import PLACES, UNHEARD
from shm.pulse import Pulse, create_control
from shm.segment import SegmentError, segment_name, unlink

WAITER = """
import sys
from shm.pulse import Pulse
pulse = Pulse(sys.argv[1], "PSM1", write=True)
waiter, cycles = pulse.waiter(), pulse.field("cycles")
print("waiting", flush=True)
seen = 0
for _ in range(int(sys.argv[2])):
    while not waiter.wait(lambda: int(cycles) > seen, 60_000_000_000):
        pass
    seen += 1
    print(seen, flush=True)
"""


@pytest.fixture
def pulse(world: Any) -> Iterator[Pulse]:
    """The control page of PSM1."""
    create_control(world.name, "PSM1")
    page = Pulse(world.name, "PSM1", write=True)
    yield page
    page.close()
    unlink(segment_name(world.name, "PSM1", "control"))


def test_a_waiter_in_another_process_is_woken_each_time(world: Any, pulse: Pulse) -> None:
    bell, cycles, flags = pulse.bell(), pulse.field("cycles"), pulse.field("flags")
    child = world.start(WAITER, "20")
    assert child.stdout.readline() == "waiting\n"
    for i in range(1, 21):
        world.until(lambda: flags[0] == 1, "the waiter waits")
        cycles[...] = i
        bell.ring()
        assert child.stdout.readline() == f"{i}\n"
    world.finish(child)


def test_data_that_is_there_already_needs_no_ring(pulse: Pulse) -> None:
    waiter = pulse.waiter()
    assert waiter.wait(lambda: True, 10**12)
    assert not pulse.field("flags").any()


def test_a_wait_without_a_ring_ends(pulse: Pulse) -> None:
    waiter = pulse.waiter()
    begin = time.monotonic_ns()
    assert not waiter.wait(lambda: False, 20_000_000)
    assert time.monotonic_ns() - begin >= 19_000_000
    assert not waiter.wait(lambda: False, 0) and not waiter.wait(lambda: False, -5)
    assert not pulse.field("flags").any()


def test_a_ring_nobody_waits_for_changes_nothing(pulse: Pulse) -> None:
    bell, before = pulse.bell(), bytes(pulse.segment.view)
    for _ in range(5):
        bell.ring()
    assert bytes(pulse.segment.view) == before


def test_only_who_waits_is_rung(pulse: Pulse) -> None:
    bell = pulse.bell()
    pulse.field("flags")[3] = 1
    bell.ring()
    assert pulse.field("counters").tolist() == [0, 0, 0, 1] + [0] * (PLACES - 4)


def test_a_ring_between_look_and_sleep_is_not_lost(pulse: Pulse) -> None:
    bell, waiter = pulse.bell(), pulse.waiter()
    looks = []

    def ready() -> bool:
        looks.append(len(looks))
        if len(looks) == 1:
            bell.ring()  # right behind our look at the data: the counter has moved, so the futex must not sleep
            return False
        return True

    assert waiter.wait(ready, 60_000_000_000)


def test_an_error_while_looking_leaves_no_flag(pulse: Pulse) -> None:
    waiter = pulse.waiter()
    with pytest.raises(ZeroDivisionError):
        waiter.wait(lambda: 1 // 0 > 0, 10**9)
    assert not pulse.field("flags").any()


def test_places_are_freed_by_kill_9(world: Any, pulse: Pulse) -> None:
    child = world.start(WAITER, "1")
    assert child.stdout.readline() == "waiting\n"
    pages = [Pulse(world.name, "PSM1", write=True) for _ in range(PLACES)]
    for page in pages[:-1]:
        page.waiter()
    with pytest.raises(SegmentError, match="all 16 places are taken"):
        pages[-1].waiter()
    world.kill(child)
    pages[-1].waiter()
    assert pulse.field("flags").sum() == 0  # the heir of the dead waiter's place clears its flag
    for page in pages:
        page.close()


def test_the_flag_of_a_dead_waiter_is_taken_down_by_the_ringer(world: Any, pulse: Pulse) -> None:
    bell, flags = pulse.bell(), pulse.field("flags")
    child = world.start(WAITER, "1")
    world.until(lambda: flags[0] == 1, "the waiter waits")
    world.kill(child)
    assert flags[0] == 1
    for _ in range(UNHEARD):
        bell.ring()
    assert flags[0] == 0
    before = bytes(pulse.segment.view)
    bell.ring()
    assert bytes(pulse.segment.view) == before  # a dead waiter costs nothing any more


def test_the_flag_of_a_living_waiter_stays_up_however_often_it_is_rung(world: Any, pulse: Pulse) -> None:
    bell, flags = pulse.bell(), pulse.field("flags")
    waiter = Pulse(world.name, "PSM1", write=True)
    waiter.waiter()
    flags[0] = 1  # as it is before its futex sleeps
    for _ in range(3 * UNHEARD):
        bell.ring()
    assert flags[0] == 1
    waiter.close()


def test_waiting_needs_write_access(world: Any, pulse: Pulse) -> None:
    reader = Pulse(world.name, "PSM1")
    with pytest.raises((SegmentError, OSError)):
        reader.waiter()
    reader.close()
