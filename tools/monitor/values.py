"""The page of values: the current content of one topic, field by field, in words and with its course."""

from __future__ import annotations

from collections import deque
from collections.abc import Collection
from dataclasses import dataclass
from typing import Any

import numpy as np

from trocar.procs.crtk.demand import Wanted
from trocar.procs.crtk.field_paths import FieldCells, all_cells
from trocar.procs.crtk.topics import TopicEntry
from trocar.procs.crtk.views import OpenTopic
from trocar.shm.memory.segment import SegmentError
from trocar.shm.time.clock import monotonic_ns
from trocar.tools.inspect.enumerations import in_words
from trocar.tools.monitor.topics import OLD_S
from trocar.tools.output.columns import values_of

KEPT = 60  # values of a cell, for its course
BEFORE_S = 3.0  # of the ring's content, at the beginning
A_LINE = 12  # cells that a line shows


@dataclass(frozen=True, slots=True)
class ValueRow:
    """A field, or one cell of it. `course`: its values so far, empty: not a number, or several; `state`: "", "invalid"
    or "not computed" (on demand, without a subscriber).
    """

    key: str
    name: str
    value: str
    unit: str
    course: tuple[float, ...]
    text: str
    state: str = ""
    size: int = 1


@dataclass(frozen=True, slots=True)
class Values:
    """Content of a topic. `age_s` is None before its first record; `is_old`: these are values of the past."""

    topic: str
    sequence: int
    age_s: float | None
    is_old: bool
    problem: str
    rows: tuple[ValueRow, ...]
    has_groups: bool
    is_wanted: bool


class ValuesData:
    """One topic, open. Without a subscription unless `want` was called."""

    def __init__(self, system: str, entry: TopicEntry) -> None:
        """Attach; SegmentError when it cannot be read."""
        self.entry = entry
        self._source = OpenTopic(system, entry)
        self._demand = Wanted(system)
        self.is_wanted = False
        self._cells: list[FieldCells] = []
        self._count = -1
        self._courses: dict[str, deque[float]] = {}
        self._sequence, self._changed_ns = 0, 0

    def want(self) -> None:
        """Subscribe to it, as `echo` does; SegmentError if that is impossible."""
        self._demand.want(self._source.entry)
        self.is_wanted = True

    def look(self, opened: Collection[str] = (), silent_s: float = 0.0) -> Values:
        """The newest record; of the fields in `opened` every cell has a line.

        `silent_s`: since the last heartbeat of its process, if that is dead.
        """
        source, now_ns = self._source, monotonic_ns()
        has_one = source.newest()
        if source.sequence != self._sequence or not self._changed_ns:
            self._sequence, self._changed_ns = source.sequence, now_ns
        problem = source.problem()
        if not has_one:
            return Values(self.entry.name, 0, None, True, problem, (), bool(source.groups), self.is_wanted)
        self._resolve()
        age_s = max(source.age_s, (now_ns - self._changed_ns) * 1e-9, silent_s)
        is_old = bool(problem) or bool(self.entry.rate_hz and age_s > max(OLD_S, 10.0 / self.entry.rate_hz))
        rows = [row for cells in self._cells for row in self._rows(cells, opened, is_old)]
        return Values(self.entry.name, source.sequence, age_s, is_old, problem, tuple(rows), bool(source.groups),
                      self.is_wanted)

    def newest(self) -> dict[str, Any] | None:
        """The newest record in JSON types; None: there is none."""
        return self._source.as_dict() if self._source.newest() else None

    def _resolve(self) -> None:
        """The cells; found again when the number of an arm's joints changes."""
        record = self._source.record
        count = int(record["count"][0]) if "count" in (record.dtype.names or ()) else 0
        if count == self._count:
            return
        self._count = count
        self._cells = all_cells(self.entry, record)
        self._courses = {label: deque(maxlen=KEPT) for cells in self._cells if not cells.is_text
                         for label in cells.labels}
        for row in self._source.rows_since(BEFORE_S, KEPT):
            self._remember(row)

    def _remember(self, record: Any) -> None:
        for cells in self._cells:
            if not cells.is_text:
                for label, value in zip(cells.labels, cells.numbers(record)[0].tolist(), strict=True):
                    self._courses[label].append(value)

    def _rows(self, cells: FieldCells, opened: Collection[str], is_old: bool) -> list[ValueRow]:
        record = self._source.record
        values = values_of([cells], record)
        if not cells.is_text and not is_old:
            for label, number in zip(cells.labels, cells.numbers(record)[0].tolist(), strict=True):
                self._courses[label].append(number)
        name = cells.labels[0].partition(".")[2].partition("[")[0]
        state = self._state(cells, record)
        field = cells.field
        several = len(cells.labels) > 1
        course = () if several or cells.is_text else tuple(self._courses[cells.labels[0]])
        shown = " ".join(shown_value(in_words(field, value)) for value in values[:A_LINE])
        shown += f" … {len(values)} in all" if len(values) > A_LINE else ""
        rows = [ValueRow(name, name, shown, field.unit, course, field.text, state, len(values))]
        if several and name in opened:
            for label, value in zip(cells.labels, values, strict=True):
                course = () if cells.is_text else tuple(self._courses[label])
                rows.append(ValueRow(label, "  " + label.partition(".")[2][len(name):],
                                     shown_value(in_words(field, value)), field.unit, course, "", state))
        return rows

    def _state(self, cells: FieldCells, record: Any) -> str:
        if not bool(cells.valid(record)[0]):
            return "invalid"
        if cells.field.group and not cells.is_text and not np.isfinite(cells.numbers(record)).any():
            return "not computed"
        return ""

    def close(self) -> None:
        """Unmap and unsubscribe."""
        self._demand.close()
        self._source.close()


def shown_value(value: Any) -> str:
    """One value in readable form."""
    if value is None:
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        value += 0.0  # no -0
        return f"{value:.5g}" if abs(value) < 1e7 else f"{value:.6e}"
    return str(value) if value != "" else "(empty)"


def open_values(system: str, entry: TopicEntry) -> ValuesData | str:
    """A topic, open; or why it cannot be read."""
    try:
        return ValuesData(system, entry)
    except SegmentError as error:
        return str(error)
