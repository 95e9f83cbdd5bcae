"""Who is late, who hangs, and when nobody is judged: on made-up marks and times."""

from __future__ import annotations

import math
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterable

import pytest

from procs.document.system import Process
from procs.manifest import hung_s, late_s
from procs.supervisor.cores import IDLE, core_time_ns
from procs.supervisor.judge import HUNG, LATE, OWN_LATE_NS, RESUMED, Judge, JudgedProcess

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


def test_nobody_is_judged_for_what_held_us_up() -> None:
    whats = judged(0.9, beating, still, held_up=(3, 20, 40))
    assert [what for _, what in whats] == [f"B {LATE}"]  # 0.9 s of our own beats, whatever lay between them
    assert judged(10.0, still, beat_ns=OWN_LATE_NS + 1) == []


def test_a_stopped_process_is_found_by_a_supervisor_that_is_often_late() -> None:
    assert f"A {HUNG}" in [what for _, what in judged(2.0, still, held_up=range(0, 100, 3))]


def test_who_is_not_to_be_judged_is_forgotten() -> None:
    judge = Judge()
    for k in range(200):
        members = [JudgedProcess("A", 7, 30e6, 1e9)] if k % 40 else []
        assert HUNG not in [verdict.what for verdict in judge.beat(k * BEAT_NS, members)]


def hung_after_s(core_ns: Callable[[int], int]) -> float:
    """When one that is silent from the beginning is killed, having had a core for so long; inf: not in 20 s."""
    judge = Judge()
    for now_ns in range(0, 20_000_000_000, BEAT_NS):
        member = JudgedProcess("A", 7, math.inf, 1e9, lambda now_ns=now_ns: core_ns(now_ns))
        if any(verdict.what == HUNG for verdict in judge.beat(now_ns, [member])):
            return now_ns * 1e-9
    return math.inf


def test_who_waits_for_a_core_does_not_hang() -> None:
    assert hung_after_s(lambda now_ns: 0) == math.inf
    assert hung_after_s(lambda now_ns: now_ns // 10) > 9.0, "a tenth of a core"
    assert hung_after_s(lambda now_ns: now_ns) < 1.1, "it goes round and round"
    assert hung_after_s(lambda now_ns: IDLE) < 1.1, "it was stopped"


def test_who_waits_for_one_that_hangs_is_spared() -> None:
    judge, found = Judge(), []
    for k in range(100):
        members = [JudgedProcess("boards", 7, math.inf, 1e9),
                   JudgedProcess("IO1", 7 if k > 3 else k, math.inf, 1e9, None, "boards")]
        found += [f"{verdict.name} {verdict.what}" for verdict in judge.beat(k * BEAT_NS, members)]
    assert found == [f"boards {HUNG}"]


def test_a_process_has_core_time_only_while_it_wants_a_core() -> None:
    busy = subprocess.Popen([sys.executable, "-c", "while True: pass"])
    try:
        end = time.monotonic() + 20.0
        while (first := core_time_ns(busy.pid)) < 20_000_000:
            assert time.monotonic() < end
        while core_time_ns(busy.pid) < first + 20_000_000:
            assert time.monotonic() < end
        busy.send_signal(signal.SIGSTOP)
        while core_time_ns(busy.pid) != IDLE:
            assert time.monotonic() < end
    finally:
        busy.kill()
        busy.wait()
    assert core_time_ns(busy.pid) == IDLE, "it is gone"


@pytest.mark.parametrize(("kind", "period_s", "late", "hung"), [
    ("io", 1 / 1500, 0.03, 1.0), ("system", 0.01, 0.03, 1.0), ("teleop", 0.001, 0.03, 1.0), ("teleop", 0.1, 2.0, 2.0),
    ("console", 0.1, 0.2, 1.0),
])
def test_limits_leave_everybody_time_to_sleep(kind: str, period_s: float, late: float, hung: float) -> None:
    row = Process("A", kind, period_s)
    assert (late_s(row), hung_s(row)) == (pytest.approx(late), pytest.approx(hung))


def test_limits_are_those_configured() -> None:
    row = Process("A", "arm", 1 / 1500, late_s=0.2, hung_s=5.0)
    assert (late_s(row), hung_s(row)) == (0.2, 5.0)
    assert hung_s(Process("A", "arm", 1 / 1500, late_s=3.0)) == 3.0
