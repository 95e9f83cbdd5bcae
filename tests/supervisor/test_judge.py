"""Who is late, who hangs, and when nobody is judged: on made-up marks and times."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable

import pytest

from tests.cases import cases
from trocar.procs.document.system import Process
from trocar.procs.supervisor.judge import HUNG, LATE, OWN_LATE_NS, RESUMED, Judge, JudgedProcess
from trocar.procs.tables.manifest import SIMULATED_HUNG_S, hung_s, late_s, rest_periods, silence_s

BEAT_NS = 20_000_000
Marks = Callable[[int], int]


def judged(seconds: float, *marks: Marks, beat_ns: int = BEAT_NS, held_up: Iterable[int] = ()) -> list[tuple[int, str]]:
    """Verdicts (beat, what) of processes A, B, … whose marks follow from the time, allowed are 30 ms and 1 s.

    Before the beats in `held_up` we are held up for 2 s.
    """
    judge, now_ns, found = Judge(), 0, []
    for k in range(round(seconds * 1e9 / beat_ns)):
        now_ns += beat_ns + (2_000_000_000 if k in held_up else 0)
        members = [JudgedProcess(name, mark(now_ns), 30e6, 1e9) for name, mark in zip("AB", marks, strict=False)]
        found += [(k, f"{verdict.name} {verdict.what}") for verdict in judge.beat(now_ns, members)]
    return found


def beating(now_ns: int) -> int:
    return now_ns


def still(now_ns: int) -> int:
    return 7


def until(end_s: float, again_s: float = 1e9) -> Marks:
    return lambda now_ns: min(now_ns, round(end_s * 1e9)) if now_ns < again_s * 1e9 else now_ns


def test_who_beats_is_not_judged() -> None:
    assert judged(10.0, beating, beating) == []


def test_silence_is_reported_at_once_and_once_and_then_killed() -> None:
    (first, late), (second, hung) = judged(1.2, beating, until(0.1))
    assert (late, hung) == (f"B {LATE}", f"B {HUNG}")
    silent_ms = [(k + 1) * 20 - 100 for k in (first, second)]
    assert silent_ms == [40, 1020]


def test_who_beats_again_is_reported_once_more() -> None:
    assert [what for _, what in judged(2.0, until(0.1, 0.6))] == [f"A {LATE}", f"A {RESUMED}"]


def test_slow_cycles_one_after_the_other_are_one_episode() -> None:
    slow = judged(5.0, lambda now_ns: now_ns // 100_000_000)
    assert [what for _, what in slow] == [f"A {LATE}", f"A {RESUMED}"]


def test_who_shows_in_some_of_our_beats_that_it_goes_on_is_not_judged_for_what_held_us_up() -> None:
    assert judged(0.9, beating, until(0.1, 0.2), held_up=(3, 20, 40)) == []
    reports = judged(0.45, beating, still, held_up=(3, 20))  # 0.5 s of what held us up count, of 4 s
    assert [what for _, what in reports] == [f"B {LATE}"]


@pytest.mark.parametrize("beat_ns", [BEAT_NS, OWN_LATE_NS + 1, 200_000_000])
def test_who_hangs_is_found_in_time_by_a_supervisor_that_is_always_late(beat_ns: int) -> None:
    beat, what = next(found for found in judged(3.0, still, beat_ns=beat_ns) if found[1] != f"A {LATE}")
    assert what == f"A {HUNG}" and (beat + 1) * beat_ns == pytest.approx(1e9, abs=2 * beat_ns)


def test_who_is_not_to_be_judged_is_forgotten() -> None:
    judge = Judge()
    for k in range(200):
        members = [JudgedProcess("A", 7, 30e6, 1e9)] if k % 40 else []
        assert HUNG not in [verdict.what for verdict in judge.beat(k * BEAT_NS, members)]


def test_who_waits_for_one_that_hangs_is_spared() -> None:
    judge, found = Judge(), []
    for k in range(100):
        members = [JudgedProcess("boards", 7, math.inf, 1e9),
                   JudgedProcess("IO1", 7 if k > 3 else k, math.inf, 1e9, "boards")]
        found += [f"{verdict.name} {verdict.what}" for verdict in judge.beat(k * BEAT_NS, members)]
    assert found == [f"boards {HUNG}"]


@cases(("kind", "period_s", "late", "silence", "hung"), [
    ("io", 1 / 1500, 0.03, 0.03, 1.0), ("arm", 1 / 1500, 0.03, 0.03, 1.0), ("system", 0.01, 0.03, 0.06, 1.0),
    ("teleop", 0.001, 0.03, 0.2, 1.0), ("teleop", 1.0, 2.0, 2.0, 2.0), ("console", 0.1, 0.2, 0.2, 1.0),
])
def test_limits_leave_everybody_time_to_sleep(kind: str, period_s: float, late: float, silence: float, hung: float
                                              ) -> None:
    row = Process("A", kind, period_s)
    assert (late_s(row), silence_s(row), hung_s(row, simulated=False)) == pytest.approx((late, silence, hung))


@cases(("kind", "period_s", "timeout_s", "periods"), [
    ("arm", 1 / 1500, 0.03, 15), ("arm", 1 / 1500, 0.006, 3), ("arm", 1 / 1500, 0.001, 1), ("arm", 0.02, 0.03, 1),
    ("teleop", 0.001, math.inf, 100), ("console", 0.01, math.inf, 2), ("io", 1 / 1500, math.inf, 1),
])
def test_a_process_at_rest_keeps_to_a_third_of_the_timeout_of_its_readers(
        kind: str, period_s: float, timeout_s: float, periods: int) -> None:
    assert rest_periods(Process("A", kind, period_s), timeout_s) == periods


def test_limits_are_those_configured() -> None:
    row = Process("A", "arm", 1 / 1500, late_s=0.2, hung_s=5.0)
    assert (late_s(row), hung_s(row, simulated=False)) == (0.2, 5.0)
    assert hung_s(Process("A", "arm", 1 / 1500, late_s=3.0), simulated=False) == 3.0


def test_what_is_configured_holds_in_simulated_time_too_and_else_it_is_longer() -> None:
    assert hung_s(Process("A", "arm", 1 / 1500, hung_s=0.5), simulated=True) == 0.5
    assert hung_s(Process("A", "arm", 1 / 1500), simulated=True) == SIMULATED_HUNG_S > 1.0
