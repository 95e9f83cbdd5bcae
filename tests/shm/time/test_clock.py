"""The wall clock."""

from __future__ import annotations

import time

import pytest

from trocar.shm.time.clock import WallClock


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
