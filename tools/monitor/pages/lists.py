"""The pages that list: processes, topics, events, arms and commands."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from typing import TYPE_CHECKING, NamedTuple

from textual.binding import Binding
from textual.message import Message

from trocar.procs.crtk.topics import EVENT, TopicEntry
from trocar.tools.inspect.standing import Standing
from trocar.tools.monitor.events import (
    ACCEPTED,
    UNDER_WAY,
    AskedRow,
    EventRow,
    chosen,
    commands_of,
    events_of,
    under_way,
)
from trocar.tools.monitor.pages.page import InspectorPage
from trocar.tools.monitor.pages.table import Head, TableRow
from trocar.tools.monitor.processes import ProcessesData, ProcessRow, process_cells, standing_cells, standing_details
from trocar.tools.monitor.topics import TopicRow, TopicsData
from trocar.tools.output.printing import number, span

if TYPE_CHECKING:
    from trocar.tools.monitor.overview import Overview

SEVERITIES = ("", "status", "warning", "error")


class ProcessesPage(InspectorPage):
    """Every process: state, rate, jitter, resource use, restarts, and its last end."""

    TITLE = "processes"
    COLUMNS = (Head("process", 11), Head("state", 14), Head("pid", 7, True, True), Head("Hz", 7, True),
               Head("jitter", 6, True), Head("p99 ms", 7, True, True), Head("work p99", 8, True, True),
               Head("CPU %", 5, True), Head("MB", 4, True), Head("missed", 7, True, True),
               Head("restarts", 8, True), Head("problem", 0))
    DATA = (ProcessesData,)

    @property
    def remark(self) -> str:
        """Its selection."""
        return f"{len(self.read_once or ())} processes"

    def read(self, seen: Overview) -> list[ProcessRow]:
        """All of them."""
        found: list[ProcessRow] = self.data.rows(seen.processes)
        return found

    def made(self, row: ProcessRow) -> TableRow:
        """Past rows are grey, problems red; the kind is searched, too."""
        texts, colours = process_cells(row), self.palette
        styles = ((1, colours.bad), (11, colours.bad)) if row.status.problem else ()
        return TableRow(row.status.name, texts, colours.past if row.is_gone else "", styles, (*texts, row.status.kind))

    def about(self, row: ProcessRow) -> list[str]:
        """Its statistics, and the processes before it."""
        return row.details()


class TopicChosen(Message):
    """A person selects the values of a topic."""

    def __init__(self, topic: str) -> None:
        self.topic = topic
        super().__init__()


class TopicsPage(InspectorPage):
    """Every record with nominal and real rate, and the views on it."""

    TITLE = "topics"
    COLUMNS = (Head("topic", 20), Head("nominal", 9, True), Head("Hz", 7, True), Head("longest ms", 10, True),
               Head("age", 7, True), Head("lost", 5, True), Head("records", 12, True, True),
               Head("problem", 0))
    DETAILS = 2
    DATA = (TopicsData,)
    BINDINGS = [Binding("enter", "open_values", "values", priority=True)]  # noqa: RUF012  # as textual wants it

    @property
    def entries(self) -> list[TopicEntry]:
        """Topics with viewable values."""
        return [entry for entry in self.data.entries if entry.kind != EVENT] if self.data is not None else []

    @property
    def remark(self) -> str:
        """Its selection."""
        return f"{len(self.read_once or ())} records; rates are of the last 2 s"

    def read(self, seen: Overview) -> list[TopicRow]:
        """All records."""
        return self.data.rows(seen.silences) if self.data is not None else []

    def rows(self, read: list[TopicRow]) -> Iterable[TopicRow]:
        """A row whose name, or view, matches the search comes first."""
        return sorted(read, key=lambda row: not self.is_named(row.name, *self._names(row.name)))

    def made(self, row: TopicRow) -> TableRow:
        """Old rows are grey, with their age; names of the views on them are searched, too."""
        texts = [row.name, number(row.nominal_hz, "g") if row.nominal_hz else "on events", number(row.hz, ".1f"),
                 number(row.max_ms, ".3f"), span(row.age_s), str(row.lost), str(row.records), row.problem]
        colours = self.palette
        styles = ((7, colours.bad),) * bool(row.problem) + ((5, colours.warning),) * bool(row.lost)
        return TableRow(row.name, texts, colours.past if row.is_old else "", styles, (*texts, *self._names(row.name)))

    def action_open_values(self) -> None:
        """The page of values of this topic, or of the view on it that is searched for by its name."""
        key = self.table.key
        self.post_message(TopicChosen(next((name for name in self._names(key) if self.is_named(name)), key)))

    def _names(self, name: str) -> list[str]:
        """Of the views on a record."""
        entries = self.data.entries if self.data is not None else []
        place = next((entry for entry in entries if entry.name == name), None)
        return [entry.name for entry in entries if place is not None and entry.view is not None
                and (entry.instance, entry.ring) == (place.instance, place.ring)]

    def about(self, row: TopicRow) -> list[str]:
        """The views on it."""
        views = ", ".join(name.partition("/")[2] for name in self._names(row.name))
        return [f"{row.name}: problem: {row.problem}"] * bool(row.problem) + [
            f"{row.name}: Enter shows its values{f'; views: {views}' if views else ''}"]


class EventsPage(InspectorPage):
    """Reports of the processes, the newest last."""

    TITLE = "events"
    COLUMNS = (Head("at", 12), Head("from", 11), Head("what", 20), Head("text", 0))
    EVERY_S = 0.3
    AT_END = True
    DATA = (events_of,)
    BINDINGS = [  # noqa: RUF012  # as textual wants it
        Binding("s", "severity", "severity"), Binding("c", "component", "process"),
    ]
    _severity = _who = ""

    @property
    def remark(self) -> str:
        """The selection."""
        least = f"{self._severity} and worse" if self._severity not in ("", "error") else self._severity or "all"
        lost = f"; {self.data.lost} lost" if self.data is not None and self.data.lost else ""
        return f"{least} of {self._who or 'all processes'}{lost}"

    def rows(self, read: list[EventRow]) -> list[EventRow]:
        """Those of the chosen severity and process."""
        return chosen(read, self._severity, self._who)

    def made(self, row: EventRow) -> TableRow:
        """Errors red, warnings yellow."""
        colours = {"error": self.palette.bad, "warning": self.palette.warning, "": self.palette.past}
        return TableRow(f"{row.who} {row.data.get('sequence')}", [row.at, row.who, row.what, row.text], "",
                        ((2, colours.get(row.severity, "")),), (row.who, row.what, row.text, row.hint))

    def about(self, row: EventRow) -> list[str]:
        """The whole sentence, and the remedy."""
        return [f"{row.at} {row.who}: {row.what}", row.text] + ([f"remedy: {row.hint}"] if row.hint else [])

    def action_severity(self) -> None:
        """Only those of the next severity, and worse ones."""
        self._severity = SEVERITIES[(SEVERITIES.index(self._severity) + 1) % len(SEVERITIES)]
        self.again()

    def action_component(self) -> None:
        """Only those of the next process; after the last one all."""
        names = ["", *(self.data.names if self.data is not None else [])]
        self._who = names[(names.index(self._who) + 1) % len(names)] if self._who in names else ""
        self.again()


class ArmRow(NamedTuple):
    """State of one, and whether its process is dead."""

    one: Standing
    is_dead: bool


class ArmsPage(InspectorPage):
    """Arms, setup joints, teleoperations and consoles."""

    TITLE = "arms"
    COLUMNS = (Head("name", 12), Head("state", 16), Head("homed", 5), Head("fault", 16, False, True),
               Head("why, or waits for what", 0), Head("remedy", 0, is_wide=True))
    EVERY_S = 0.5
    DETAILS = 5

    @property
    def remark(self) -> str:
        """Its selection."""
        return "arms, setup joints, teleoperations, consoles"

    def read(self, seen: Overview) -> list[ArmRow]:
        """As the overview found them."""
        silences = seen.silences
        return [ArmRow(one, one.name in silences) for one in seen.standings]

    def made(self, row: ArmRow) -> TableRow:
        """In FAULT red, of a dead process grey."""
        texts, colours = standing_cells(row.one), self.palette
        if row.is_dead:
            texts[1] += " (dead)"
            return TableRow(row.one.name, texts, colours.past)
        styles = ((1, colours.bad), (3, colours.bad)) if row.one.is_fault else ((1, colours.good),) * bool(
            row.one.homed)
        return TableRow(row.one.name, texts, "", styles)

    def about(self, row: ArmRow) -> list[str]:
        """The error as it was reported, and the remedy."""
        return standing_details(row.one)


class CommandsPage(InspectorPage):
    """Commands under way on top, then earlier commands, the newest first."""

    TITLE = "commands"
    COLUMNS = (Head("at", 12), Head("asked", 9), Head("for", 18), Head("outcome", 9), Head("whose", 0),
               Head("reason", 0, is_wide=True))
    EVERY_S = 0.5
    DETAILS = 2
    DATA = (commands_of,)

    @property
    def remark(self) -> str:
        """Number of commands under way."""
        count = sum(row.outcome == UNDER_WAY for row in self.read_once or ())
        return f"{count} under way" if count else "none under way"

    def read(self, seen: Overview) -> list[AskedRow]:
        """Those under way on top."""
        rows: list[AskedRow] = super().read(seen)
        now = [dataclasses.replace(row, outcome=UNDER_WAY) for row in reversed(under_way(rows, seen.processes))]
        return [*now, *reversed(rows)]

    def made(self, row: AskedRow) -> TableRow:
        """Commands under way are highlighted."""
        colours = self.palette
        if row.outcome == UNDER_WAY:
            return TableRow(f"now {row.key}", row.cells, colours.accent)
        outcomes = {"refused": colours.bad, "failed": colours.bad, "done": colours.good}
        return TableRow(f"{row.key} {row.outcome} {row.order}", row.cells, "", ((3, outcomes.get(row.outcome, "")),))

    def about(self, row: AskedRow) -> list[str]:
        """The whole command."""
        outcome = ACCEPTED if row.outcome == UNDER_WAY else row.outcome
        return [f"{row.at} {row.who}: {row.command}: {outcome}, for {row.whose}",
                f"reason: {row.reason}" if row.reason else ""]
