"""The page of topics."""

from __future__ import annotations

from typing import TYPE_CHECKING

from textual.binding import Binding
from textual.message import Message

from trocar.procs.crtk.topics import TopicEntry
from trocar.tools.monitor.pages.page import InspectorPage
from trocar.tools.monitor.pages.table import Head, TableRow
from trocar.tools.monitor.topics import TopicRow, TopicsData
from trocar.tools.monitor.values import shown_entries
from trocar.tools.output.printing import number, span

if TYPE_CHECKING:
    from trocar.tools.monitor.overview import Overview


class TopicChosen(Message):
    """A person wants to see the values of a topic."""

    def __init__(self, topic: str) -> None:
        self.topic = topic
        super().__init__()


class TopicsPage(InspectorPage):
    """Every record with declared and real rate, and the views on it."""

    TITLE = "topics"
    COLUMNS = (Head("topic", 20), Head("declared", 9, True), Head("Hz", 7, True), Head("longest ms", 10, True),
               Head("age", 7, True), Head("lost", 5, True), Head("records", 12, True, True),
               Head("problem", 0))
    DETAILS = 2
    BINDINGS = [Binding("enter", "open_values", "values", priority=True)]  # noqa: RUF012  # as textual wants it
    _data: TopicsData | None = None

    def open(self, system: str) -> None:
        """Attach to every ring."""
        self._data = TopicsData(system)

    def close(self) -> None:
        """Unmap."""
        if self._data is not None:
            self._data.close()

    @property
    def entries(self) -> list[TopicEntry]:
        """Those whose values can be looked at."""
        return shown_entries(self._data.entries) if self._data is not None else []

    @property
    def remark(self) -> str:
        """What it is about."""
        return f"{len(self.read_once or ())} records; rates are of the last 2 s"

    def read(self, seen: Overview) -> list[TopicRow]:
        """All records."""
        return self._data.rows(seen.silences) if self._data is not None else []

    def table_rows(self, read: list[TopicRow]) -> list[TableRow]:
        """A row a record; what is old is grey, with its age. One whose name, or view, is sought comes first."""
        made = []
        for row in sorted(read, key=lambda row: not self.is_named(row.name, *self._names(row.name))):
            texts = [row.name, number(row.nominal_hz, "g") if row.nominal_hz else "on events",
                     number(row.hz, ".1f"), number(row.max_ms, ".3f"), span(row.age_s), str(row.lost),
                     str(row.records), row.problem]
            colours = self.palette
            styles = ((7, colours.bad),) * bool(row.problem) + ((5, colours.warning),) * bool(row.lost)
            if self.has(*texts, *self._names(row.name)):
                made.append(TableRow(row.name, texts, colours.past if row.is_old else "", styles))
        return made

    def action_open_values(self) -> None:
        """The page of values of this topic, or of the view on it that is searched for by its name."""
        key = self.table.key
        self.post_message(TopicChosen(next((name for name in self._names(key) if self.is_named(name)), key)))

    def _names(self, name: str) -> list[str]:
        """Of the views on a record."""
        entries = self._data.entries if self._data is not None else []
        place = next((entry for entry in entries if entry.name == name), None)
        return [entry.name for entry in entries if place is not None and entry.view is not None
                and (entry.instance, entry.ring) == (place.instance, place.ring)]

    def details(self, read: list[TopicRow], key: str) -> list[str]:
        """What is a view on it."""
        views = self._names(key)
        problem = next((row.problem for row in read if row.name == key), "")
        return [f"{key}: problem: {problem}"] * bool(problem) + [f"{key}: Enter shows its values"
                + (f"; views: {', '.join(name.partition('/')[2] for name in views)}" if views else "")]
