"""Deadlines by native code and by Python: the same after every cycle; and the wait for the next one."""

from __future__ import annotations

import ctypes
import threading
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trocar.procs.native.bound import BoundStruct
from trocar.procs.native.library import bind, native
from trocar.procs.native.pace_fields import DEADLINE, PACE
from trocar.procs.node.pacing import INTERVAL_NS, ROOM, Pacing
from trocar.shm.time.clock import monotonic_ns, pause
from trocar.shm.time.control_page import CONTROL
from trocar.shm.time.wakeup import FUTEX, SYSCALL, WAKE

pytestmark = pytest.mark.skipif(native().library is None, reason=f"no native library: {native().why}")

PERIOD = 1_000_000
NUMBERS = {"<u4": np.uint32, "<i8": np.int64, "<u8": np.uint64}


class Cells:
    """A control page's cells, with its types."""

    def __init__(self) -> None:
        self.cells = {field.name: np.zeros((), NUMBERS.get(field.dtype, np.float64)) for field in CONTROL.fields}

    def field(self, name: str) -> Any:
        return self.cells[name]


def paced(period_ns: int = PERIOD) -> tuple[Cells, Pacing]:
    cells = Cells()
    return cells, Pacing(cells, period_ns, 0)  # type: ignore[arg-type]  # a stand-in


def bound(pacing: Pacing) -> BoundStruct:
    found = bind(PACE, pacing)
    assert isinstance(found, BoundStruct), found
    return found


CYCLE = st.tuples(st.integers(0, 3 * PERIOD), st.integers(1, 10), st.integers(-PERIOD, PERIOD), st.booleans())


@given(st.lists(CYCLE, min_size=1, max_size=60), st.integers(0, 10**15), st.sampled_from([1, 2, 3]))
def test_both_come_to_the_same_in_every_cycle(cycles: list[tuple[int, int, int, bool]], start: int, third: int) -> None:
    (page, slow), (other_page, quick) = paced(), paced()
    by_native = bound(quick)
    end_of_work, begin_work = by_native.function("end_of_work"), by_native.function("begin_work")
    now = start
    for each in (slow, quick):
        each.follows(PERIOD * third // 3)
        each.begin(now, False)
    for spent, periods, away, follows in cycles:
        now += spent
        if follows:
            slow.follow(now + away)
            quick.follow(now + away)
        deadline = slow.end_of_work(now, periods)
        assert end_of_work(now, periods) == deadline
        now = max(now, deadline)
        slow.begin_work(now)
        if begin_work(now):
            quick.look(now)
        assert quick.words.tolist() == slow.words.tolist() and quick.short_until_ns == slow.short_until_ns
        assert np.array_equal(quick.periods, slow.periods) and np.array_equal(quick.work, slow.work)
        assert {name: cell.item() for name, cell in page.cells.items()} == {
            name: cell.item() for name, cell in other_page.cells.items()}
    assert not by_native.moved()


@pytest.mark.slow
def test_more_cycles_than_there_is_room_for_are_counted_not_kept() -> None:
    cells, pacing = paced(10_000)
    by_native = bound(pacing)
    pacing.begin(0, False)
    now = 0
    while now < 2 * INTERVAL_NS and not cells.field("interval_cycles"):
        now = by_native.function("end_of_work")(now, 1)
        if by_native.function("begin_work")(now):
            pacing.look(now)
    assert cells.field("interval_cycles") == ROOM and cells.field("cycles") > ROOM


@pytest.mark.parametrize("spin_ns", [0, 50_000])
def test_a_wait_ends_at_the_deadline_and_says_when_it_is_time_to_look(spin_ns: int) -> None:
    cells, pacing = paced(5 * PERIOD)
    wait = bound(pacing).function("wait")
    begin = monotonic_ns()
    pacing.begin(begin, False)
    first = wait(1, spin_ns)
    assert first < 0, "nobody has looked yet"
    pacing.look(-first)
    second = wait(2, spin_ns)
    assert -first >= begin + 5 * PERIOD and second >= begin + 15 * PERIOD
    assert cells.field("cycles") == 2 and cells.field("heartbeat_ns") == second == pacing.begun_ns


def test_other_threads_go_on_while_one_waits() -> None:
    _, pacing = paced(50 * PERIOD)
    wait, asked, went_on = bound(pacing).function("wait"), threading.Event(), []

    def other() -> None:
        asked.wait(10.0)
        went_on.append(monotonic_ns())

    thread = threading.Thread(target=other)
    thread.start()
    pacing.begin(monotonic_ns(), False)
    asked.set()
    woken = abs(wait(10, 0))
    thread.join(10.0)
    assert went_on and went_on[0] < woken


def test_a_sleep_without_news_ends_at_its_deadline() -> None:
    cells, pacing = paced(2 * PERIOD)
    sleep, begin = bound(pacing).function("sleep"), monotonic_ns()
    pacing.begin(begin, False)
    cells.field("wakeup")[...] = 1
    assert abs(sleep(3)) >= begin + 6 * PERIOD
    assert cells.field("wakeup") == 0, "it is awake"
    assert pacing.words[DEADLINE] == begin + 6 * PERIOD


@pytest.mark.parametrize("by", ["futex", "news before it slept"])
def test_a_sleep_ends_early_with_news_but_not_too_early_and_the_grid_stays(by: str) -> None:
    cells, pacing = paced(PERIOD // 2)
    sleep, begin = bound(pacing).function("sleep"), monotonic_ns()
    periods = 40_000_000
    pacing.begin(begin, False)
    word = cells.field("wakeup")
    if by == "futex":
        word[...] = 1
        waking = threading.Thread(target=wake, args=(word,))
        waking.start()
        woken = abs(sleep(periods))
        waking.join(10.0)
    else:
        woken = abs(sleep(periods))
    assert begin + PERIOD // 2 <= woken < begin + periods * (PERIOD // 2), "it slept on"
    deadline = int(pacing.words[DEADLINE])
    assert deadline <= woken < deadline + PERIOD // 2 and (deadline - begin) % (PERIOD // 2) == 0
    assert cells.field("cycles") == 1


def wake(word: Any) -> None:
    """Wake its sleeper, as shm/time/wakeup.py does."""
    pause(0.005)
    word[...] = 0
    SYSCALL(FUTEX, ctypes.c_void_p(word.ctypes.data), WAKE, 1, None, None, 0)
