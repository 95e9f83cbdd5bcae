"""The page of events."""

from __future__ import annotations

from typing import TYPE_CHECKING

from textual.binding import Binding

from trocar.tools.monitor.events import EventRow, EventsData, chosen
from trocar.tools.monitor.pages.page import InspectorPage
from trocar.tools.monitor.pages.table import Head, TableRow

if TYPE_CHECKING:
    from trocar.tools.monitor.overview import Overview

SEVERITIES = ("", "status", "warning", "error")


class EventsPage(InspectorPage):
    """What the processes report, the newest last."""

    TITLE = "events"
    COLUMNS = (Head("at", 12), Head("from", 11), Head("what", 20), Head("text", 0))
    EVERY_S = 0.3
    AT_END = True
    BINDINGS = [  # noqa: RUF012  # as textual wants it
        Binding("s", "severity", "severity"), Binding("c", "component", "process"),
    ]
    _data: EventsData | None = None

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self._severity, self._who = "", ""

    def open(self, system: str) -> None:
        """Attach to the events of all processes."""
        self._data = EventsData(system)

    def close(self) -> None:
        """Unmap."""
        if self._data is not None:
            self._data.close()

    @property
    def remark(self) -> str:
        """What is chosen."""
        least = f"{self._severity} and worse" if self._severity not in ("", "error") else self._severity or "all"
        lost = f"; {self._data.lost} lost" if self._data is not None and self._data.lost else ""
        return f"{least} of {self._who or 'all processes'}{lost}"

    def read(self, seen: Overview) -> list[EventRow]:
        """All that are known."""
        return self._data.rows() if self._data is not None else []

    def table_rows(self, read: list[EventRow]) -> list[TableRow]:
        """A row an event; errors red, warnings yellow."""
        colours = {"error": self.palette.bad, "warning": self.palette.warning, "": self.palette.past}
        return [TableRow(f"{row.who} {row.data.get('sequence')}", [row.at, row.who, row.what, row.text], "",
                         ((2, colours.get(row.severity, "")),))
                for row in chosen(read, self._severity, self._who, self.words)]

    def details(self, read: list[EventRow], key: str) -> list[str]:
        """The whole sentence, and what a person can do."""
        row = next((row for row in read if f"{row.who} {row.data.get('sequence')}" == key), None)
        if row is None:
            return []
        return [f"{row.at} {row.who}: {row.what}", row.text] + ([f"remedy: {row.hint}"] if row.hint else [])

    def action_severity(self) -> None:
        """Only those of the next severity, and worse ones."""
        self._severity = SEVERITIES[(SEVERITIES.index(self._severity) + 1) % len(SEVERITIES)]
        self.again()

    def action_component(self) -> None:
        """Only those of the next process; after the last one all."""
        names = ["", *(self._data.names if self._data is not None else [])]
        self._who = names[(names.index(self._who) + 1) % len(names)] if self._who in names else ""
        self.again()
