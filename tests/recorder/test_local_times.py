"""Dates of records, on clocks that jump: the time of day is set, and the computer is suspended."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import pytest

from trocar.procs.recorder import sources
from trocar.procs.recorder.sources import LocalTimes

S, DAY_NS = 1_000_000_000, 86_400 * 1_000_000_000


@dataclass
class LocalClocks:
    """CLOCK_MONOTONIC, which is the system's time, and the time of day."""

    monotonic_ns: int = 50 * S
    local_ns: int = 1_000 * DAY_NS
    simulated = False

    def now_ns(self) -> int:
        return self.monotonic_ns

    def passes(self, monotonic_ns: int, local_ns: int) -> None:
        self.monotonic_ns += monotonic_ns
        self.local_ns += local_ns


@pytest.fixture
def clocks(monkeypatch: pytest.MonkeyPatch) -> LocalClocks:
    made = LocalClocks()
    monkeypatch.setattr(sources, "monotonic_ns", lambda: made.monotonic_ns)
    monkeypatch.setattr(sources, "local_ns", lambda: made.local_ns)
    return made


@pytest.mark.parametrize("step_ns", [0, DAY_NS, -DAY_NS, 3_600 * S], ids=["none", "ahead", "back", "suspended"])
def test_a_record_after_a_jump_has_the_new_time_of_day(clocks: LocalClocks, step_ns: int) -> None:
    clock: Any = clocks
    times = LocalTimes(clock)
    clocks.passes(S // 100, S // 100 + step_ns)
    times.look()
    stamp_ns, local_ns = clocks.monotonic_ns + S // 500, clocks.local_ns + S // 500
    clocks.passes(S // 100, S // 100)
    times.look()
    assert times.of(stamp_ns) == local_ns
    assert times.of(stamp_ns - S) == local_ns - S, "as that of a record of before, by the new time"
