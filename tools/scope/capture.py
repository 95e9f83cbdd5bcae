"""From fields and a condition to a window of records: rings, wait for the trigger, records after it."""

from __future__ import annotations

import contextlib
import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from trocar.procs.crtk.demand import Wanted
from trocar.procs.crtk.field_paths import BadPath, FieldCells, FieldPath, cells_of
from trocar.procs.crtk.reported import event_rings
from trocar.procs.crtk.topics import TopicEntry, find
from trocar.procs.crtk.views import OpenTopic
from trocar.shm.memory.closable import Closable
from trocar.shm.memory.segment import SegmentError
from trocar.shm.system import directory
from trocar.shm.time.clock import monotonic_ns, pause
from trocar.shm.time.system_time import SystemTime
from trocar.tools.output.errors import Misuse, Problem
from trocar.tools.scope.grammar import Comparison, Condition, EventSeen, FaultSeen, Leaf, leaves
from trocar.tools.scope.trigger import Test, Trigger, event_test, field_test
from trocar.tools.scope.window import Gap, RingWindow, WindowRows, gaps_of
from trocar.tools.systems.find import is_up, unknown

POLL_S: Final = 0.02
SILENT_S: Final = 1.0  # no new record in any ring for this long: no records after the trigger are expected any more
PERIODS: Final = 3.0  # of a ring: its first record in a window may be so late
SLOWER: Final = 20.0  # real time per time of the system, at most


@dataclass(frozen=True, slots=True)
class ScopedField:
    """One field that is shown, and where its records are kept."""

    path: FieldPath
    cells: FieldCells
    topic: str
    column: int


@dataclass(frozen=True, slots=True)
class Capture:
    """The captured data. `moment_ns`: stamp of the trigger; `rows`: of each ring the records in the window.

    `short`: part of the window's beginning that was no longer in a ring, s, by topic; `unseen`: part of its end that
    did not arrive, or was not waited for.
    """

    moment_ns: int
    scoped: tuple[ScopedField, ...]
    rows: dict[str, WindowRows]
    gaps: tuple[Gap, ...]
    short: dict[str, float]
    unseen: dict[str, float]


class Capturing(Closable):
    """The rings of some fields and of a condition, open; a context manager."""

    def __init__(self, system: str, paths: Sequence[FieldPath], condition: Condition | None) -> None:
        """Attach; Misuse and Problem name the missing parts."""
        self.system = system
        self.is_up = is_up(system)
        self._stack = contextlib.ExitStack()
        self._windows: dict[str, RingWindow] = {}
        self._scoped: list[ScopedField] = []
        try:
            self._open(paths, condition)
        except BaseException:
            self._stack.close()
            raise

    def _open(self, paths: Sequence[FieldPath], condition: Condition | None) -> None:
        cells: dict[str, list[FieldCells]] = {}
        for path in paths:
            entry, found = self._found(path)
            kept = cells.setdefault(_ring(entry), [])
            self._scoped.append(ScopedField(path, found, _ring(entry), len(kept)))
            kept.append(found)
        tests = [(leaf, self._tests(leaf)) for leaf in leaves(condition)] if condition is not None else []
        for topic in {*cells, *(topic for _, made in tests for topic in made)}:
            reader = directory.reader(self.system, *topic.split("/", 1), often=False)
            self._windows[topic] = RingWindow(topic, reader, cells.get(topic, ()))
            self._stack.callback(self._windows[topic].close)
        watched = {topic for leaf, made in tests if isinstance(leaf, Comparison) for topic in made}
        rates = {topic: self._windows[topic].rate_hz for topic in watched}
        self._trigger = Trigger(condition, tests, rates) if condition is not None else None

    def _found(self, path: FieldPath) -> tuple[TopicEntry, FieldCells]:
        entry = find(self.system, path.topic)
        with OpenTopic(self.system, entry) as source:
            source.newest()
            try:
                found = cells_of(entry, path, source.record)
            except BadPath as error:
                raise Misuse(str(error)) from None
        if self.is_up:  # in a crashed system nothing is computed any more
            demand = self._stack.enter_context(Wanted(self.system, every=True))
            fields = (found.field,) if found.field in entry.fields else ()
            with contextlib.suppress(SegmentError), OpenTopic(self.system, dataclasses.replace(entry, fields=fields)
                                                              ) as source:
                demand.want(source.entry)
        return entry, found

    def _tests(self, leaf: Leaf) -> dict[str, Test]:
        """Tests for the records, by ring."""
        if isinstance(leaf, Comparison):
            entry, cells = self._found(leaf.path)
            return {_ring(entry): field_test(leaf, cells)}
        known = sorted({instance for instance, ring in directory.rings(self.system) if ring == "events"})
        words = leaf.words if isinstance(leaf, EventSeen) else (leaf.name,) * bool(leaf.name)
        if words and words[0] in known:
            names, words = [words[0]], words[1:]
        elif isinstance(leaf, FaultSeen) and words:
            raise unknown("process", words[0], known)
        else:
            names = _tellers(self.system)
        if len(words) > 1:
            raise unknown("process", words[0], known)
        return {f"{name}/events": event_test(leaf, words) for name in names}

    def last(self, seconds: float) -> Capture:
        """The newest records kept; the trigger is the newest record. Problem if there is none."""
        for window in self._windows.values():
            window.collect()
        return self._cut(self._newest_ns(), seconds, 0.0)

    def past(self, before_s: float, after_s: float) -> Capture | None:
        """Around the last time at which the condition became true in the rings' history; None: it never did."""
        assert self._trigger is not None
        for topic, window in self._windows.items():
            self._trigger.take(topic, window.collect())
        stamps, flags = self._trigger.look(to_end=True)
        begins = np.flatnonzero(flags & ~np.concatenate([[False], flags[:-1]]))
        return self._cut(int(stamps[begins[-1]]), before_s, after_s) if len(begins) else None

    def wait(self, before_s: float, after_s: float, timeout_s: float | None) -> Capture | None:
        """Around the first moment from now on at which the condition holds; None: it did not in time."""
        assert self._trigger is not None
        with SystemTime(self.system) as time:
            begun_ns, end_ns = time.now_ns(), None if timeout_s is None else monotonic_ns() + round(timeout_s * 1e9)
            kept_ns = begun_ns - round(before_s * 1e9)
            for topic, window in self._windows.items():
                self._trigger.begin(topic, window.newest_before(begun_ns))
            while True:
                for topic, window in self._windows.items():
                    records = window.collect(kept_ns if window.rate_hz else 0)  # earlier events: a fault before
                    self._trigger.take(topic, records, begun_ns)
                stamps, flags = self._trigger.look(time.now_ns())
                if flags.any():
                    moment_ns = int(stamps[np.argmax(flags)])
                    self._follow(time, moment_ns + round(after_s * 1e9), after_s)
                    return self._cut(moment_ns, before_s, after_s)
                if end_ns is not None and monotonic_ns() >= end_ns:
                    return None
                if not is_up(self.system) and all(window.gone for window in self._windows.values()):
                    raise Problem(f"system {self.system} went down before the condition held; "
                                  "what it left: trocar scope … --past")
                newest_ns = self._newest_ns(or_ns=begun_ns)
                for window in self._windows.values():
                    window.forget(min(newest_ns, time.now_ns()) - round(before_s * 1e9) - 1_000_000_000)
                pause(POLL_S)

    def _follow(self, time: SystemTime, until_ns: int, after_s: float) -> None:
        """Read records until the end of the window, or until none arrive any more.

        The silence of an event-driven topic does not show the end of the window: the system's time does.
        """
        limit_ns = monotonic_ns() + round((after_s * SLOWER + SILENT_S) * 1e9)
        shown = [self._windows[topic] for topic in {one.topic for one in self._scoped}]
        seen, since_ns = (0, 0), monotonic_ns()
        while monotonic_ns() < limit_ns:
            now_ns = time.now_ns()
            for window in self._windows.values():
                window.collect()
            if now_ns >= until_ns and all(window.newest_ns >= until_ns for window in shown if window.rate_hz):
                return
            now_seen = min(now_ns, until_ns), max(window.newest_ns for window in shown)
            if now_seen != seen:
                seen, since_ns = now_seen, monotonic_ns()
            elif monotonic_ns() - since_ns > SILENT_S * 1e9:
                return
            if not is_up(self.system) and all(window.gone for window in shown):
                return
            pause(POLL_S)

    def _known_until_ns(self) -> int:
        """Until then all event-driven records are present."""
        if not self.is_up:
            return self._newest_ns(or_ns=0)
        with SystemTime(self.system) as time:
            return time.now_ns()

    def _newest_ns(self, or_ns: int | None = None) -> int:
        newest = max((window.newest_ns for window in self._windows.values()), default=0)
        if not newest:
            if or_ns is None:
                raise Problem(f"nothing was written to {', '.join(sorted(self._windows))} yet")
            return or_ns
        return newest

    def _cut(self, moment_ns: int, before_s: float, after_s: float) -> Capture:
        first_ns, last_ns = moment_ns - round(before_s * 1e9), moment_ns + round(after_s * 1e9)
        until_ns = self._known_until_ns()
        rows: dict[str, WindowRows] = {}
        short: dict[str, float] = {}
        unseen: dict[str, float] = {}
        for topic in dict.fromkeys(one.topic for one in self._scoped):
            kept = self._windows[topic].rows()
            rows[topic] = kept.between(first_ns, last_ns)
            # One that is older than the window shows that nothing of it is missing at its beginning.
            rate_hz = self._windows[topic].rate_hz
            begin_ns = int(kept.stamps[0]) if rate_hz and len(kept) and int(kept.sequences[0]) > 1 else first_ns
            if begin_ns > first_ns + PERIODS * 1e9 / rate_hz if rate_hz else False:
                short[topic] = min(begin_ns - first_ns, last_ns - first_ns) * 1e-9
            end_ns = self._windows[topic].newest_ns if rate_hz else until_ns
            if after_s and last_ns - end_ns > max(PERIODS / rate_hz if rate_hz else 0.0, POLL_S) * 1e9:
                unseen[topic] = min(last_ns - end_ns, last_ns - first_ns) * 1e-9
        gaps = tuple(gap for topic, part in rows.items() for gap in gaps_of(topic, part))
        return Capture(moment_ns, tuple(self._scoped), rows, gaps, short, unseen)

    def close(self) -> None:
        """Unmap."""
        self._stack.close()


def _ring(entry: TopicEntry) -> str:
    return f"{entry.instance}/{entry.ring}"


def _tellers(system: str) -> list[str]:
    """The processes whose events count."""
    names = []
    for name, reader in event_rings(system):
        reader.close()
        names.append(name)
    return names


def stamps_in_all(capture: Capture) -> Any:
    """All stamps of a capture, in order, each once."""
    return np.unique(np.concatenate([part.stamps for part in capture.rows.values()]))


