"""Pacing on absolute deadlines, on a clock of numbers and a control page of arrays."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.cases import cases
from trocar.procs.node.pacing import GAIN, INTERVAL_NS, ROOM, SHORT_NS, Pacing, phase_ns
from trocar.procs.tables.manifest import PROCS

PERIOD = 1_000_000


class Page:
    """Stands in for a control page."""

    def __init__(self) -> None:
        self.cells: dict[str, Any] = {}

    def field(self, name: str) -> Any:
        return self.cells.setdefault(name, np.zeros(()))

    def __getitem__(self, name: str) -> float:
        return float(self.cells[name])


@pytest.fixture
def page() -> Page:
    return Page()


def loop(pacing: Pacing, now: int, work: list[int]) -> list[int]:
    """Run one cycle per entry of `work` (ns) on a perfect clock; returns when each cycle began."""
    begun = []
    for spent in work:
        now = max(now, pacing.end_of_work(now))
        begun.append(now)
        pacing.begin_work(now)
        now += spent
    pacing.end_of_work(now)
    return begun


def test_deadlines_lie_on_a_grid(page: Page) -> None:
    pacing = Pacing(page, PERIOD, 0)  # type: ignore[arg-type]  # a stand-in
    pacing.begin(5_000, False)
    assert loop(pacing, 5_000, [300, 500_000, 10] * 3) == [5_000 + k * PERIOD for k in range(1, 10)]
    assert (page["missed"], page["overruns"], page["cycles"], page["period_ns"]) == (0, 0, 9, PERIOD)


def test_a_late_cycle_does_not_shift_the_grid(page: Page) -> None:
    pacing = Pacing(page, PERIOD, 0)  # type: ignore[arg-type]
    pacing.begin(0, False)
    begun = loop(pacing, 0, [100, PERIOD + 200_000, 100, 100])
    assert begun == [PERIOD, 2 * PERIOD, 3 * PERIOD + 200_000, 4 * PERIOD]
    assert (page["missed"], page["overruns"]) == (1, 1)


def test_deadlines_that_passed_are_skipped_and_counted(page: Page) -> None:
    pacing = Pacing(page, PERIOD, 0)  # type: ignore[arg-type]
    pacing.begin(0, False)
    begun = loop(pacing, 0, [5 * PERIOD + 1, 0, 0])
    assert begun == [PERIOD, 6 * PERIOD + 1, 7 * PERIOD]
    assert (page["missed"], page["overruns"]) == (5, 1)


@pytest.mark.parametrize("made_at", [0, 100, PERIOD // 2, PERIOD - 100])
def test_who_is_called_by_another_misses_what_it_was_not_called_for_and_what_it_took_too_long_for(
        page: Page, made_at: int) -> None:
    pacing = Pacing(page, PERIOD, 0)  # type: ignore[arg-type]
    pacing.begin(made_at, False)
    for call in (1, 2, 3.1, 4, 5, 8, 9, 10):  # 6 and 7 were missed
        pacing.called(round(call * PERIOD))
        pacing.end_of_work(round(call * PERIOD) + 500)
    assert (page["missed"], page["overruns"], page["cycles"]) == (2, 0, 8)
    pacing.called(11 * PERIOD)
    pacing.end_of_work(13 * PERIOD + 500)
    pacing.called(13 * PERIOD + 500)
    pacing.end_of_work(13 * PERIOD + 600)
    pacing.called(14 * PERIOD)
    assert (page["missed"], page["overruns"]) == (4, 1)


def test_who_has_nothing_to_do_sleeps_through_periods_and_misses_none(page: Page) -> None:
    pacing = Pacing(page, PERIOD, 0)  # type: ignore[arg-type]
    pacing.begin(0, False)
    assert pacing.end_of_work(100, periods=10) == 10 * PERIOD
    pacing.begin_work(10 * PERIOD)
    assert pacing.end_of_work(10 * PERIOD + 100) == 11 * PERIOD
    assert (page["missed"], page["overruns"]) == (0, 0)


def test_many_missed_deadlines_mean_that_time_is_short_for_a_while(page: Page) -> None:
    pacing = Pacing(page, PERIOD, 0)  # type: ignore[arg-type]
    pacing.begin(0, False)
    now = loop(pacing, 0, [100] * 1100)[-1]
    assert pacing.short_until_ns <= now
    now = loop(pacing, now, ([2 * PERIOD] * 20 + [100] * 160) * 4)[-1]
    assert pacing.short_until_ns > now and pacing.short_until_ns <= now + SHORT_NS[0]


@pytest.mark.slow
def test_where_time_is_short_again_soon_it_counts_as_short_for_twice_as_long_up_to_a_limit(page: Page) -> None:
    pacing = Pacing(page, PERIOD, 0)  # type: ignore[arg-type]
    pacing.begin(0, False)
    now, lasted = 0, []
    for _ in range(6):
        while pacing.short_until_ns <= now:
            now = loop(pacing, now, [2 * PERIOD])[-1]
        lasted.append(0)
        while pacing.short_until_ns > now:
            now = loop(pacing, now, [100] * 100)[-1]
            lasted[-1] += 100 * PERIOD
    first, most = SHORT_NS
    assert np.allclose(lasted, [min(first * 2**again, most) for again in range(6)], atol=0.5e9) and lasted[-1] > 50e9
    now = loop(pacing, now, [100] * (2 * most // PERIOD))[-1]
    while pacing.short_until_ns <= now:
        now = loop(pacing, now, [2 * PERIOD])[-1]
    assert pacing.short_until_ns <= now + first, "after a long time without it begins anew"


def test_one_pause_of_the_machine_does_not_mean_that_time_is_short(page: Page) -> None:
    pacing = Pacing(page, PERIOD, 0)  # type: ignore[arg-type]
    pacing.begin(0, False)
    now = loop(pacing, 0, [100] * 300 + [50 * PERIOD] + [100] * 1000)[-1]
    assert page["missed"] > 40 and pacing.short_until_ns <= now


def test_work_of_exactly_one_period_misses_nothing(page: Page) -> None:
    pacing = Pacing(page, PERIOD, 0)  # type: ignore[arg-type]
    pacing.begin(0, False)
    loop(pacing, 0, [PERIOD] * 5)
    assert (page["missed"], page["overruns"]) == (0, 0)


@given(st.lists(st.integers(0, 4 * PERIOD), max_size=50), st.integers(0, 10**15))
def test_every_deadline_is_met_or_counted(work: list[int], start: int) -> None:
    page = Page()
    pacing = Pacing(page, PERIOD, 0)  # type: ignore[arg-type]
    pacing.begin(start, False)
    begun = loop(pacing, start, work)
    assert all(b > a for a, b in pairwise(begun))
    on_time = sum((b - start) % PERIOD == 0 for b in begun)
    assert not work or on_time + page.cells["missed"] >= (begun[-1] - start) // PERIOD


@pytest.mark.parametrize("now", [0, 1, 333_333, 999_999, PERIOD, 10**12])
@pytest.mark.parametrize("phase", [0, 500_000])
def test_lock_step_cycles_lie_on_their_phase(page: Page, now: int, phase: int) -> None:
    pacing = Pacing(page, PERIOD, phase)  # type: ignore[arg-type]
    pacing.begin(now, True)
    begun = loop(pacing, now, [0] * 3)
    assert [b % PERIOD for b in begun] == [phase] * 3
    assert 0 < begun[0] - now <= PERIOD and page["heartbeat_ns"] == 0, "that is real time"


@pytest.mark.parametrize("away", [-400_000, -1000, 1000, 499_000])
def test_follow_pulls_the_grid_gently(page: Page, away: int) -> None:
    pacing = Pacing(page, PERIOD, 0)  # type: ignore[arg-type]
    pacing.begin(0, False)
    now, begun = 0, [0]
    for _ in range(200):
        pacing.follow(now - now % PERIOD + away)
        now = max(now, pacing.end_of_work(now))
        pacing.begin_work(now)
        begun.append(now)
    assert abs((begun[-1] - away + PERIOD // 2) % PERIOD - PERIOD // 2) < 100
    steps = np.diff(begun)
    assert np.all(np.abs(steps - PERIOD) <= GAIN * PERIOD / 2 + 1)
    assert page["missed"] == 0


@pytest.mark.parametrize("followed, apart", [(2 / 3, 1 / 3), (1 / 2, 1 / 2), (1, 1), (3 / 2, 1 / 2), (2, 1)])
@pytest.mark.parametrize("work", [60_000, 200_000, 350_000])
@pytest.mark.parametrize("begin", [0, 123_456, 555_555, 890_000])
def test_who_follows_another_period_finds_its_place_whichever_of_its_stamps_are_seen(
    page: Page, followed: float, apart: float, work: int, begin: int
) -> None:
    """`work` after a stamp its record is out: what is the newest depends on where one's own cycles lie."""
    pacing, period, lead = Pacing(page, PERIOD, 0), round(followed * PERIOD), 190_000  # type: ignore[arg-type]
    pacing.follows(period)
    pacing.begin(begin, False)
    now, behind = begin, []
    for _ in range(1000):
        now = max(now, pacing.end_of_work(now))
        pacing.begin_work(now)
        pacing.follow((now - work) // period * period + lead)
        behind.append((now - lead) / PERIOD % apart)
    settled = np.array(behind[500:])
    assert np.minimum(settled, apart - settled).max() < 0.002


def test_figures_are_of_the_last_second(page: Page) -> None:
    pacing = Pacing(page, PERIOD, 0)  # type: ignore[arg-type]
    pacing.begin(0, False)
    loop(pacing, 0, [100_000] * 999 + [300_000] * 10)
    assert page["interval_cycles"] == INTERVAL_NS // PERIOD
    assert [page[f"period_{f}"] for f in ("avg", "min", "max", "p99")] == [pytest.approx(1e-3)] * 4
    assert page["work_max"] == pytest.approx(1e-4) and page["period_std"] == pytest.approx(0, abs=1e-12)


def test_latencies_are_of_the_cycles_that_had_one(page: Page) -> None:
    pacing = Pacing(page, PERIOD, 0)  # type: ignore[arg-type]
    pacing.begin(0, False)
    for latency_ns in (60_000, 70_000, 110_000):
        pacing.latency(latency_ns)
    loop(pacing, 0, [0] * 1002)
    found = [page[f"latency_{f}"] for f in ("avg", "min", "max", "p99")]
    assert found == [pytest.approx(x) for x in (8e-5, 6e-5, 1.1e-4, 1.1e-4)]
    loop(pacing, 2 * INTERVAL_NS, [0] * 1002)
    assert [page[f"latency_{f}"] for f in ("avg", "std", "min", "max", "p99")] == [0.0] * 5


def test_more_cycles_than_there_is_room_are_counted_not_kept(page: Page) -> None:
    pacing = Pacing(page, 10_000, 0)  # type: ignore[arg-type]
    pacing.begin(0, False)
    loop(pacing, 0, [10] * (INTERVAL_NS // 10_000 + 1))
    assert page["interval_cycles"] == ROOM and page["cycles"] == INTERVAL_NS // 10_000 + 1


def test_a_clock_that_jumps_far_costs_one_step(page: Page) -> None:
    pacing = Pacing(page, PERIOD, 0)  # type: ignore[arg-type]
    pacing.begin(0, False)
    pacing.begin_work(PERIOD)
    assert pacing.end_of_work(10**18) <= 10**18
    assert page["missed"] == pytest.approx(10**12, rel=1e-6)


def test_a_cycle_that_begins_early_moves_no_deadline(page: Page) -> None:
    pacing = Pacing(page, PERIOD, 0)  # type: ignore[arg-type]
    pacing.begin(0, simulated=False)
    assert pacing.end_of_work(100) == PERIOD
    for now in (200_000, 400_000, 700_000):
        pacing.early(now)
        pacing.begin_work(now)
        assert pacing.end_of_work(now + 1000) == PERIOD
    pacing.begin_work(PERIOD)
    assert pacing.end_of_work(PERIOD + 1000) == 2 * PERIOD and page["missed"] == 0


@pytest.mark.parametrize(("periods", "slept"), [(1, 0.7), (10, 0.4), (10, 6.0), (10, 9.3)])
def test_a_cycle_before_its_deadline_misses_nothing_and_keeps_the_grid(page: Page, periods: int, slept: float) -> None:
    pacing = Pacing(page, PERIOD, 0)  # type: ignore[arg-type]
    pacing.begin(0, False)
    pacing.begin_work(0)
    assert pacing.end_of_work(100, periods) == periods * PERIOD
    woken = round(slept * PERIOD)
    pacing.early(woken)
    pacing.begin_work(woken)
    following = pacing.end_of_work(woken + 100)
    assert following % PERIOD == 0 and 0 < following - woken <= PERIOD + 100 and page["missed"] == 0


@cases("io_ns", [333_333, 500_000, 666_667, 1_000_000, 2_000_000])
@cases("times", [0.125, 0.25, 0.5, 1, 2, 3, 4, 5, 10, 15])
def test_no_turn_of_a_member_comes_in_the_instant_of_ios(io_ns: int, times: float) -> None:
    io_ns *= 8  # so that all of these are whole
    period_ns = round(io_ns * times)
    for share in {row.phase for row in PROCS if row.phase}:
        first = phase_ns(share, period_ns, [3 * io_ns, io_ns])
        assert 0 < first < period_ns
        assert all((first + turn * period_ns) % io_ns for turn in range(1000))


def test_without_io_the_phase_is_of_the_own_period() -> None:
    assert phase_ns(0.5, PERIOD, []) == PERIOD // 2
