"""The wake-up word: who has news wakes who sleeps, it costs nothing when nobody does, and every sleep ends."""

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

from trocar.shm.memory.segment import SegmentError, segment_name, unlink
from trocar.shm.time.control_page import ControlPage, create_control

LONG_S = 1800.0
SLEEPER_OF_PAGE = """
import sys
from trocar.shm.time.control_page import ControlPage
page = ControlPage(sys.argv[1], "PSM1", write=True)
wakeup, cycles = page.wakeup(), page.field("cycles")
for seen in range(int(sys.argv[2])):
    while not wakeup.sleep(lambda: int(cycles) > seen, 60_000_000_000):
        pass
    print(seen + 1, flush=True)
"""


@pytest.fixture
def control_page(world: Any) -> Iterator[ControlPage]:
    """The control page of PSM1."""
    create_control(world.name, "PSM1")
    page = ControlPage(world.name, "PSM1", write=True)
    yield page
    page.close()
    unlink(segment_name(world.name, "PSM1", "control"))


def test_a_sleeper_is_woken_by_whoever_has_news(world: Any, control_page: ControlPage) -> None:
    other = ControlPage(world.name, "PSM1", write=True)
    wakeups = control_page.wakeup(), other.wakeup()
    cycles, word = control_page.field("cycles"), control_page.field("wakeup")
    child = world.start(SLEEPER_OF_PAGE, "20")
    for i in range(1, 21):
        world.until(lambda: word == 1, "it sleeps")
        cycles[...] = i
        wakeups[i % 2].wake()
        assert child.stdout.readline() == f"{i}\n"
    world.finish(child)
    other.close()


def test_a_sleep_ends_by_itself_and_news_need_no_waking(control_page: ControlPage) -> None:
    wakeup, word = control_page.wakeup(), control_page.field("wakeup")
    wakeup.wake()
    assert not wakeup.sleep(lambda: False, 1_000_000) and word == 0
    assert wakeup.sleep(lambda: True, 10**12) and word == 0


def test_a_sleep_lasts_as_long_as_it_may(control_page: ControlPage) -> None:
    wakeup, begin = control_page.wakeup(), time.monotonic_ns()
    assert not wakeup.sleep(lambda: False, 20_000_000)
    assert time.monotonic_ns() - begin >= 19_000_000
    assert not wakeup.sleep(lambda: False, 0) and not wakeup.sleep(lambda: False, -5)


def test_waking_who_is_awake_changes_nothing(control_page: ControlPage) -> None:
    wakeup, before = control_page.wakeup(), bytes(control_page.segment.view)
    for _ in range(5):
        wakeup.wake()
    assert bytes(control_page.segment.view) == before


def test_news_between_look_and_sleep_are_not_slept_through(control_page: ControlPage) -> None:
    wakeup, looks = control_page.wakeup(), iter((False, True))

    def news() -> bool:
        found = next(looks)
        if not found:
            wakeup.wake()  # right behind our look: the word is 0, so the futex must not sleep
        return found

    assert wakeup.sleep(news, 60_000_000_000)


def test_an_error_while_looking_leaves_nobody_asleep(control_page: ControlPage) -> None:
    with pytest.raises(ZeroDivisionError):
        control_page.wakeup().sleep(lambda: 1 // 0 > 0, 10**9)
    assert control_page.get("wakeup") == 0


def test_a_dead_sleeper_costs_one_wake_up(world: Any, control_page: ControlPage) -> None:
    child = world.start(SLEEPER_OF_PAGE, "1")
    world.until(lambda: control_page.get("wakeup") == 1, "it sleeps")
    world.kill(child)
    wakeup = control_page.wakeup()
    assert wakeup.sleeps and wakeup.wake_after_fence() and not wakeup.wake_after_fence()


def test_sleeping_needs_write_access(world: Any, control_page: ControlPage) -> None:
    reader = ControlPage(world.name, "PSM1")
    with pytest.raises(SegmentError, match="a futex needs write access"):
        reader.wakeup()
    reader.close()


def race(world: Any, which: str, *arguments: str) -> dict[str, Any]:
    """The report of a race in races.py."""
    if len(os.sched_getaffinity(0)) < 2:
        pytest.skip("a race needs two cores")
    child = world.start(f"from tests.shm.time.races import {which}; {which}()", *arguments)
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
def test_nobody_sleeps_through_news(world: Any, control_page: ControlPage) -> None:
    report = race(world, "wakeups", "2000", "10", "")
    assert (report["wakeups"], report["lost"]) == (2000, 0) and report["slept"] > 100, report


@pytest.mark.soak
def test_a_hundred_thousand_sleeps_miss_no_news(world: Any, control_page: ControlPage) -> None:
    report = race(world, "wakeups", "100000", "10", "")
    assert (report["wakeups"], report["lost"]) == (100_000, 0) and report["slept"] > 5000, report


@pytest.mark.slow
def test_news_looked_for_too_early_are_slept_through(world: Any, control_page: ControlPage) -> None:
    # it is a matter of chance: once, 100,000 sleeps on a busy machine did not show it
    assert any(race(world, "wakeups", "100000", "0.3", "looked_too_early")["lost"] == 1 for _ in range(5))


SLEEPS = {
    "a wake-up word": "ControlPage(sys.argv[1], 'PSM1', write=True).wakeup().sleep(lambda: False, 60_000_000_000)",
    "a clock's sleep": "WallClock().sleep_until(monotonic_ns() + 60_000_000_000, bool)",
    "a pause": "pause(60)",
}
SLEEPER = ("import sys; from trocar.shm.time.clock import WallClock, monotonic_ns, pause; "
           "from trocar.shm.time.control_page import ControlPage; ")
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
def test_no_sleep_depends_on_the_wall_clock(world: Any, control_page: ControlPage, how: str) -> None:
    child = world.start(SLEEPER + SLEEPS[how])
    wanted = FUTEX_ON_X86_64 if "wake-up" in how else CLOCK_NANOSLEEP
    world.until(lambda: call_of(child)[:1] == [wanted], "it sleeps")
    _, first, operation, value, timeout_at, *_ = call_of(child)
    if wanted == CLOCK_NANOSLEEP:
        assert first == CLOCK_MONOTONIC
    else:
        assert (operation, value) == (0, 1)  # FUTEX_WAIT: its timeout is relative; no FUTEX_CLOCK_REALTIME, shared
        assert timespec(child, timeout_at) == (60, 0)
    world.kill(child)
