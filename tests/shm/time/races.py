"""Two processes on two cores that race for a wake-up; run by test_wakeup.py, which reads the line of JSON they print.

`stores` is the bare race of the nap's steps P1-P3 against Q1-Q3; `wakeups` is the real thing, asleep in a futex.
"""

from __future__ import annotations

import json
import mmap
import os
import random
import sys
from collections.abc import Callable
from typing import Any

import numpy as np

from tests.shm.witness import die_with_parent
from trocar.shm.memory.order import full_fence
from trocar.shm.time.clock import monotonic_ns
from trocar.shm.time.control_page import ControlPage
from trocar.shm.time.wakeup import Wakeup

PHASES = 4096
PATIENT_SPINS = 2000  # then let others have the core
PATIENCE_NS = 60_000_000_000
JITTER = 10  # turns of an empty loop
NEAR_US, FAR_US = 3, 60  # how long after a wake-up the next data come: while the sleeper lies down, or sleeps
OURS, THEIRS = 0, 16  # words on cache lines of their own


def beside(act: Callable[[int], None]) -> None:
    """Run `act(0)` here and `act(1)` in a fork of us, each on a core of its own, until both are through."""
    cores = sorted(os.sched_getaffinity(0))[:2]
    pid = os.fork()
    if pid == 0:
        status = 3
        try:
            die_with_parent()
            os.sched_setaffinity(0, cores[1:])
            act(1)
            status = 0
        finally:
            os._exit(status)
    os.sched_setaffinity(0, cores[:1])
    act(0)
    if os.waitpid(pid, 0)[1]:
        raise RuntimeError("the other side has failed")


def catch_up(words: memoryview, at: int, n: int) -> None:
    """Until the word is at least `n`."""
    spins, begin = 0, 0
    while words[at] < n:
        spins += 1
        if spins > PATIENT_SPINS:
            os.sched_yield()
            begin = begin or monotonic_ns()
            if monotonic_ns() - begin > PATIENCE_NS:
                raise TimeoutError("the other side does not go on")


def with_fence(words: memoryview, mine: int, other: int, missed: mmap.mmap, phases: list[range]) -> None:
    """One side: each round it stores its word, and looks at the other's."""
    fence = full_fence()
    for n in range(1, len(missed)):
        for _ in phases[n % PHASES]:
            pass
        words[mine] = n  # P1, or Q1
        fence()  # P2, or Q2
        if words[other] < n:  # P3, or Q3
            missed[n] = 1
            catch_up(words, other, n)


def without_fence(words: memoryview, mine: int, other: int, missed: mmap.mmap, phases: list[range]) -> None:
    """The same, the fence left out."""
    for n in range(1, len(missed)):
        for _ in phases[n % PHASES]:
            pass
        words[mine] = n
        if words[other] < n:
            missed[n] = 1
            catch_up(words, other, n)


def stores() -> None:
    """Arguments: rounds, "with_fence" or "without_fence". How often did both sides miss the other's store?"""
    rounds, side = int(sys.argv[2]), {"with_fence": with_fence, "without_fence": without_fence}[sys.argv[3]]
    words = memoryview(mmap.mmap(-1, mmap.PAGESIZE)).cast("Q")
    missed = [mmap.mmap(-1, rounds + 1) for _ in range(2)]

    def race(i: int) -> None:
        draw = random.Random(i)
        phases = [range(draw.randrange(JITTER + 1)) for _ in range(PHASES)]
        side(words, (OURS, THEIRS)[i], (THEIRS, OURS)[i], missed[i], phases)

    begin = monotonic_ns()
    beside(race)
    first, second = (np.frombuffer(m, np.uint8) for m in missed)
    both = np.flatnonzero(first & second)
    print(json.dumps({"rounds": rounds, "one_missed": int((first ^ second).sum()), "both_missed": len(both),
                      "first": int(both[0]) if len(both) else 0, "seconds": round((monotonic_ns() - begin) / 1e9, 2)}))


def looked_too_early(self: Wakeup, news: Callable[[], bool], timeout_ns: int) -> bool:
    """A mistake: P3 before P1, so that news between them are slept through."""
    if not news():
        self.begin()
        self.wait(timeout_ns)
        self.end()
    return news()


def wakeups() -> None:
    """Arguments: system, wake-ups, timeout in s, a mistake or nothing. PSM1 sleeps until each
    datum is there; data come at random after the last was taken. Stops at the first wake-up that was lost."""
    system, count, timeout_ns = sys.argv[1], int(sys.argv[2]), round(1e9 * float(sys.argv[3]))
    if sys.argv[4] == "looked_too_early":
        Wakeup.sleep = looked_too_early  # type: ignore[method-assign]
    notes = memoryview(mmap.mmap(-1, mmap.PAGESIZE)).cast("Q")
    taken, data, lost, slept = 0, 16, 32, 48
    begin = monotonic_ns()

    def wake(wakeup: Wakeup) -> None:
        draw = random.Random(1)
        for n in range(1, count + 1):
            due = monotonic_ns() + draw.randrange(1000 * (NEAR_US if n % 2 else FAR_US))
            while monotonic_ns() < due:
                pass
            notes[data] = n  # Q1
            wakeup.wake()
            catch_up(notes, taken, n)
            if notes[lost]:
                return

    def sleep(wakeup: Wakeup) -> None:
        for n in range(1, count + 1):
            n_is_there = Looks(notes, data, n)
            there = False
            while not there:
                began = monotonic_ns()
                there = wakeup.sleep(n_is_there, timeout_ns)
                notes[lost] += there and monotonic_ns() - began >= timeout_ns
            notes[slept] += n_is_there.looks > 1
            notes[taken] = n
            if notes[lost]:
                return

    def side(i: int) -> None:
        (wake if i else sleep)(ControlPage(system, "PSM1", write=True).wakeup())

    beside(side)
    print(json.dumps({"wakeups": notes[taken], "slept": notes[slept], "lost": notes[lost],
                      "seconds": round((monotonic_ns() - begin) / 1e9, 2)}))


class Looks:
    """Whether a word is at least `n`; counts how often it was asked."""

    def __init__(self, words: memoryview, at: int, n: int) -> None:
        self._words, self._at, self._n, self.looks = words, at, n, 0

    def __call__(self) -> Any:
        self.looks += 1
        return self._words[self._at] >= self._n
