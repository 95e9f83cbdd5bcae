"""The page of values."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from textual.binding import Binding

from trocar.procs.crtk.topics import TopicEntry
from trocar.shm.memory.segment import SegmentError
from trocar.tools.monitor.pages.page import InspectorPage
from trocar.tools.monitor.pages.table import Head, TableRow
from trocar.tools.monitor.values import ValueRow, Values, ValuesData, open_values
from trocar.tools.output.printing import span
from trocar.tools.scope.drawing import sparkline

if TYPE_CHECKING:
    from trocar.tools.monitor.overview import Overview

SPARK = 20
USUAL = ("position", "orientation", "linear", "angular", "force", "torque")
"""Parts of views whose cells have a line each from the beginning."""


class ValuesPage(InspectorPage):
    """One topic, field by field."""

    TITLE = "values"
    COLUMNS = (Head("field", 20), Head("value", 0), Head("unit", 9), Head("course", SPARK),
               Head("meaning", 42, False, True))
    EVERY_S = 0.4
    DETAILS = 2
    BINDINGS = [  # noqa: RUF012  # as textual wants it
        Binding("n", "step(1)", "next"), Binding("p", "step(-1)", "prev"),
        Binding("w", "want", "want"), Binding("enter", "open_field", "cells", priority=True),
    ]
    _system = ""
    data: ValuesData | None = None
    _problem = ""
    _is_new = _is_asked = False

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self._entries: list[TopicEntry] = []
        self._topic = ""
        self._opened: dict[str, set[str]] = {}

    def open(self, system: str) -> None:
        """Set the system; a topic is attached when it is selected."""
        self._system = system

    def choose_from(self, entries: list[TopicEntry]) -> None:
        """The topics there are; the one that was chosen before, else the first state of a process."""
        self._entries = entries
        names = [entry.name for entry in entries]
        usual = next((name for name in names if name.endswith("/state")), names[0] if names else "")
        self.choose(self._topic if self._topic in names else usual)
        self.close()

    def choose(self, topic: str) -> None:
        """Show this one from the next look on."""
        self._topic, self._is_new = topic, True

    def _open_topic(self) -> None:
        self.close()
        self._is_new = self._is_asked = False
        entry = next((entry for entry in self._entries if entry.name == self._topic), None)
        opened = open_values(self._system, entry) if entry is not None else "there is no such topic"
        self.data, self._problem = (None, opened) if isinstance(opened, str) else (opened, "")
        if entry is not None and entry.view is not None:
            self._opened.setdefault(self._topic, {*(part for part, _ in entry.view.fields), *USUAL})

    def close(self) -> None:
        """Unmap."""
        super().close()
        self.data = None

    @property
    def remark(self) -> str:
        """Topic, age, and fields that are not computed."""
        values: Values | None = self.read_once
        if self._problem or values is None:
            return f"{self._topic}: {self._problem}" if self._problem else self._topic
        age = "no record yet" if values.age_s is None else f"record {values.sequence}, {span(values.age_s)} old"
        wanted = ", on demand: requested" if values.is_wanted else ", on demand: not requested (w)" * values.has_groups
        return f"{values.topic}: {age}{wanted}" + (f"; {values.problem}" if values.problem else "")

    def read(self, seen: Overview) -> Values | None:
        """Its newest record."""
        if self._is_new:
            self._open_topic()
        data = self.data
        if data is None:
            return None
        if self._is_asked and not data.is_wanted:
            try:
                data.want()
            except SegmentError as error:
                self._problem, self._is_asked = str(error), False
        return data.look(self._opened.get(self._topic, ()), seen.silences.get(data.entry.instance, 0.0))

    def rows(self, read: Values | None) -> Sequence[ValueRow]:
        """A row a field, or a cell."""
        return read.rows if read is not None else ()

    def made(self, row: ValueRow) -> TableRow:
        """Old rows are grey and have no course; only names are searched."""
        is_old = bool(self.read_once.is_old)
        shown = f"{row.value} ({row.state})" if row.state and row.value.strip("– ") else row.state or row.value
        course = sparkline(np.array(row.course, np.float64), SPARK) if row.course and not is_old else ""
        return TableRow(row.key, [row.name, shown, row.unit, course, row.text],
                        self.palette.past if is_old or row.state else "", (), (row.key,))

    def about(self, row: ValueRow) -> list[str]:
        """Meaning of the field, and its path as typed."""
        path = row.key if "." in row.key else f"{self.read_once.topic}.{row.key}"
        lines = [f"{path}: {row.text}" if row.text else path]
        if row.state == "not computed":
            return [*lines, "not requested, so not computed: press w to request it"]
        return [*lines, "Enter: each cell, or all in one line"] if row.size > 1 else lines

    def action_step(self, by: int) -> None:
        """The next topic, or the one before."""
        names = [entry.name for entry in self._entries]
        if names:
            at = names.index(self._topic) if self._topic in names else 0
            self.choose(names[(at + by) % len(names)])

    def action_want(self) -> None:
        """Subscribe to the data computed on demand."""
        self._is_asked = True

    def action_open_field(self) -> None:
        """Every cell of the field under the cursor on a line of its own, or all on one."""
        opened = self._opened.setdefault(self._topic, set())
        key = self.table.key.partition(".")[2].partition("[")[0] if "." in self.table.key else self.table.key
        opened.symmetric_difference_update({key} if key else set())
