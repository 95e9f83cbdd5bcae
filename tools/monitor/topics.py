"""The page of topics: nominal and actual rate of each, age of its newest record, losses."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trocar.procs.crtk.topics import RECORD, TopicEntry, catalogue, writer_gone
from trocar.shm.memory.segment import Segment, SegmentError, segment_name
from trocar.shm.ring.stamps import head_of, newest_stamps
from trocar.shm.time.clock import monotonic_ns
from trocar.shm.time.system_time import SystemTime

OLD_S = 0.5
"""A record of a topic with a rate is old from here on, and from ten of its periods."""
WINDOW_NS = 2_000_000_000
"""Window for rates."""


@dataclass(frozen=True, slots=True)
class TopicRow:
    """One record topic. `hz` is of the last two seconds, None: no records.

    `lost`: since the first look, records missing in the steady spacing of its stamps (a stalled writer).
    """

    name: str
    nominal_hz: float | None
    hz: float | None
    max_ms: float | None
    age_s: float | None
    records: int
    lost: int
    problem: str

    @property
    def is_old(self) -> bool:
        """Whether the topic has no current data."""
        if self.problem or self.age_s is None:
            return True
        return self.nominal_hz is not None and self.age_s > max(OLD_S, 10.0 / self.nominal_hz)


class _Watched:
    """One ring, between looks."""

    def __init__(self, system: str, entry: TopicEntry) -> None:
        self.entry = entry
        self._segment = Segment(segment_name(system, entry.instance, entry.ring))
        self._head, self._lost = head_of(self._segment), 0
        self._looked_ns = self._changed_ns = 0
        self._counts: list[tuple[int, int]] = []

    def row(self, now_ns: int, system_ns: int, silent_s: float) -> TopicRow:
        segment, head, nominal = self._segment, head_of(self._segment), self.entry.rate_hz or None
        new = max(0, head - self._head)
        if new or not self._looked_ns:
            self._changed_ns = now_ns
        self._head, self._looked_ns = head, now_ns
        if nominal and new:
            self._lost += missing(self._stamps(new + 1))
        self._counts = [*((at, n) for at, n in self._counts if at > now_ns - WINDOW_NS), (now_ns, head)]
        begun_ns, before = self._counts[0]
        stamps = self._stamps(max(2, head - before))
        gaps = np.diff(stamps) * 1e-6 if head > before else np.zeros(0)
        # A stopped clock makes no record younger.
        age_s = max((system_ns - int(stamps[-1])) * 1e-9, (now_ns - self._changed_ns) * 1e-9, silent_s) if len(
            stamps) else None
        return TopicRow(self.entry.name, nominal, self._hz(gaps, head - before, now_ns - begun_ns),
                        float(gaps.max()) if len(gaps) else None, age_s, head, self._lost,
                        writer_gone(segment.gone) or self._lacks(head, has_whole=len(stamps) > 0))

    def _stamps(self, count: int) -> NDArray[np.int64]:
        """Those of the newest records, as far as they are kept."""
        return newest_stamps(self._segment, min(count, self._segment.header.depth - 1))

    def _hz(self, gaps: NDArray[np.float64], count: int, passed_ns: int) -> float | None:
        """Rate of a steady topic by its stamps, else by counting; None: no record came."""
        if self.entry.rate_hz and gaps.sum() > 0.0:
            return 1e3 / float(gaps.mean())
        return count / (passed_ns * 1e-9) if count > 0 and passed_ns > 0 else None

    def _lacks(self, head: int, *, has_whole: bool) -> str:
        if head:
            return "" if has_whole else "no record is whole"
        return "nothing was ever written" if self.entry.rate_hz else ""

    def close(self) -> None:
        self._segment.close()


def missing(stamps: NDArray[np.int64]) -> int:
    """Number of records missing between these, based on their usual spacing."""
    gaps = np.diff(stamps)
    usual = float(np.median(gaps)) if len(gaps) > 2 else 0.0
    return int(np.maximum(0.0, np.round(gaps / usual) - 1.0).sum()) if usual > 0.0 else 0


class TopicsData:
    """All record topics of a system. Read-only, without subscriptions."""

    def __init__(self, system: str) -> None:
        self._watched: list[_Watched] = []
        self._unreadable: list[TopicEntry] = []
        self.entries = catalogue(system)
        """All topics, views and events too."""
        self._time = SystemTime(system)
        for entry in self.entries:
            if entry.kind == RECORD:
                try:
                    self._watched.append(_Watched(system, entry))
                except SegmentError:
                    self._unreadable.append(entry)

    def rows(self, silences: Mapping[str, float] | None = None) -> list[TopicRow]:
        """The current topics. `silences`: for crashed processes the time since their last heartbeat, s."""
        now_ns, system_ns, silent = monotonic_ns(), self._time.now_ns(), silences or {}
        found = [watched.row(now_ns, system_ns, silent.get(watched.entry.instance, 0.0)) for watched in self._watched]
        return found + [TopicRow(entry.name, entry.rate_hz or None, None, None, None, 0, 0, entry.problem)
                        for entry in self._unreadable]

    def close(self) -> None:
        """Unmap."""
        self._time.close()
        for watched in self._watched:
            watched.close()
