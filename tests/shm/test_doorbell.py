"""The doorbell: wakes who waits, costs nothing when nobody does, and every wait ends."""

from __future__ import annotations

import json
import os
import platform
import struct
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from shm.doorbell import PLACES, UNHEARD, Places
from shm.pulse import Pulse, create_control
from shm.segment import SegmentError, segment_name, unlink

LONG_S = 1800.0
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
    looks: list[int] = []

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


def test_a_flag_left_up_by_the_living_is_looked_into_seldom(
    world: Any, pulse: Pulse, monkeypatch: pytest.MonkeyPatch
) -> None:
    looked: list[int] = []
    monkeypatch.setattr(Places, "while_free", lambda self, place, act: bool(looked.append(place)))
    bell, flags = pulse.bell(), pulse.field("flags")
    flags[:] = 1
    for _ in range(10 * UNHEARD):
        bell.ring()
    assert sorted(looked) == list(range(PLACES))  # once each: it opens a file, which a loop can ill afford


def test_waiting_needs_write_access(world: Any, pulse: Pulse) -> None:
    reader = Pulse(world.name, "PSM1")
    with pytest.raises((SegmentError, OSError)):
        reader.waiter()
    reader.close()


def race(world: Any, which: str, *arguments: str) -> dict[str, Any]:
    """The report of a race in races.py."""
    if len(os.sched_getaffinity(0)) < 2:
        pytest.skip("a race needs two cores")
    child = world.start(f"from tests.shm.races import {which}; {which}()", *arguments)
    out, _ = child.communicate(timeout=LONG_S)
    assert child.returncode == 0, "a side of the race has failed"
    report: dict[str, Any] = json.loads(out)
    print(json.dumps(report))
    return report


@pytest.mark.slow
def test_with_the_fence_one_of_both_sees_the_other(world: Any) -> None:
    report = race(world, "stores", "100000", "with_fence")
    assert report["both_missed"] == 0 < report["one_missed"], report


@pytest.mark.soak
def test_ten_million_rounds_lose_nothing(world: Any) -> None:
    report = race(world, "stores", "10000000", "with_fence")
    assert report["both_missed"] == 0 < report["one_missed"], report


@pytest.mark.slow
def test_without_the_fence_both_miss_each_other(world: Any) -> None:
    missed = 0
    for rounds in (100_000, 1_000_000, 10_000_000):  # a few in a thousand on idle cores
        missed = missed or race(world, "stores", str(rounds), "without_fence")["both_missed"]
    assert missed > 0, "no load has overtaken a store: then the race with the fence has shown nothing either"


@pytest.mark.slow
def test_no_wait_sleeps_through_data(world: Any, pulse: Pulse) -> None:
    report = race(world, "wakeups", "2000", "10", "")
    assert (report["wakeups"], report["lost"]) == (2000, 0) and report["slept"] > 100, report


@pytest.mark.soak
def test_a_hundred_thousand_waits_sleep_through_no_data(world: Any, pulse: Pulse) -> None:
    report = race(world, "wakeups", "100000", "10", "")
    assert (report["wakeups"], report["lost"]) == (100_000, 0) and report["slept"] > 5000, report


@pytest.mark.slow
def test_a_counter_read_too_late_is_slept_through(world: Any, pulse: Pulse) -> None:
    report = race(world, "wakeups", "100000", "0.3", "counter_read_late")
    assert report["lost"] == 1, report


SLEEPS = {
    "a wait at the bell": "Pulse(sys.argv[1], 'PSM1', write=True).waiter().wait(lambda: False, 60_000_000_000)",
    "a clock's sleep": "WallClock().sleep_until(monotonic_ns() + 60_000_000_000, bool)",
    "a pause": "pause(60)",
}
SLEEPER = "import sys; from shm.clock import WallClock, monotonic_ns, pause; from shm.pulse import Pulse; "
CLOCK_NANOSLEEP, FUTEX_ON_X86_64 = 230, 202
CLOCK_MONOTONIC = 1


def call_of(child: Any) -> list[int]:
    """The system call a child is in, and its arguments; empty when it is in none."""
    try:
        words = Path(f"/proc/{child.pid}/syscall").read_text().split()
    except OSError as error:
        pytest.skip(f"/proc/…/syscall cannot be read here: {error}")
    return [int(word, 0) for word in words] if len(words) > 6 else []


def timespec(child: Any, at: int) -> tuple[int, int]:
    """Seconds and nanoseconds at an address of a child."""
    with Path(f"/proc/{child.pid}/mem").open("rb", buffering=0) as memory:
        memory.seek(at)
        seconds, nanoseconds = struct.unpack("<qq", memory.read(16))
    return seconds, nanoseconds


@pytest.mark.slow
@pytest.mark.skipif(platform.machine() != "x86_64", reason="the numbers of system calls are those of x86-64")
@pytest.mark.parametrize("how", SLEEPS)
def test_no_sleep_depends_on_the_wall_clock(world: Any, pulse: Pulse, how: str) -> None:
    child = world.start(SLEEPER + SLEEPS[how])
    wanted = FUTEX_ON_X86_64 if "bell" in how else CLOCK_NANOSLEEP
    world.until(lambda: call_of(child)[:1] == [wanted], "it sleeps")
    _, first, operation, value, timeout_at, *_ = call_of(child)
    if wanted == CLOCK_NANOSLEEP:
        assert first == CLOCK_MONOTONIC
    else:
        assert (operation, value) == (0, 0)  # FUTEX_WAIT: its time-out is relative; no FUTEX_CLOCK_REALTIME, shared
        assert timespec(child, timeout_at) == (60, 0)
    world.kill(child)


def test_a_ringer_without_descriptors_rings_on(pulse: Pulse, monkeypatch: pytest.MonkeyPatch) -> None:
    def none_left(*arguments: object) -> int:
        raise OSError(24, "Too many open files")

    bell, flags = pulse.bell(), pulse.field("flags")
    flags[0] = 1
    monkeypatch.setattr(os, "open", none_left)
    for _ in range(2 * UNHEARD):
        bell.ring()
    assert flags[0] == 1


NAPPER = """
import sys
from shm.pulse import Pulse
pulse = Pulse(sys.argv[1], "PSM1", write=True)
nap, cycles = pulse.nap(), pulse.field("cycles")
for seen in range(int(sys.argv[2])):
    while not nap.sleep(lambda: int(cycles) > seen, 60_000_000_000):
        pass
    print(seen + 1, flush=True)
"""


def test_a_sleeper_is_roused_by_whoever_has_news(world: Any, pulse: Pulse) -> None:
    other = Pulse(world.name, "PSM1", write=True)
    naps, cycles, word = (pulse.nap(), other.nap()), pulse.field("cycles"), pulse.field("nap")
    child = world.start(NAPPER, "20")
    for i in range(1, 21):
        world.until(lambda: word == 1, "it sleeps")
        cycles[...] = i
        naps[i % 2].rouse()
        assert child.stdout.readline() == f"{i}\n"
    world.finish(child)
    other.close()


def test_a_nap_ends_by_itself_and_news_need_no_rousing(pulse: Pulse) -> None:
    nap, word = pulse.nap(), pulse.field("nap")
    nap.rouse()
    assert not nap.sleep(lambda: False, 1_000_000) and word == 0
    assert nap.sleep(lambda: True, 10**12) and word == 0
