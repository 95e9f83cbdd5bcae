"""The page of processes."""

from __future__ import annotations

from typing import TYPE_CHECKING

from trocar.tools.monitor.pages.page import InspectorPage
from trocar.tools.monitor.pages.table import Head, TableRow
from trocar.tools.monitor.processes import ProcessesData, ProcessRow, cells

if TYPE_CHECKING:
    from trocar.tools.monitor.overview import Overview


class ProcessesPage(InspectorPage):
    """Every process: state, rate, jitter, what it uses, restarts, and how the last one ended."""

    TITLE = "processes"
    COLUMNS = (Head("process", 11), Head("state", 14), Head("pid", 7, True, True), Head("Hz", 7, True),
               Head("jitter", 6, True), Head("p99 ms", 7, True, True), Head("work p99", 8, True, True),
               Head("CPU %", 5, True), Head("MB", 4, True), Head("missed", 7, True, True),
               Head("restarts", 8, True), Head("problem", 0))

    def open(self, system: str) -> None:
        """Begin to measure shares of a core."""
        self._data = ProcessesData()

    @property
    def remark(self) -> str:
        """What it is about."""
        return f"{len(self.read_once or ())} processes"

    def read(self, seen: Overview) -> list[ProcessRow]:
        """All of them."""
        return self._data.rows(seen.processes)

    def table_rows(self, read: list[ProcessRow]) -> list[TableRow]:
        """A row a process; what is gone is grey, what is wrong red."""
        made = []
        for row in read:
            texts, colours = cells(row), self.palette
            styles = ((1, colours.bad), (11, colours.bad)) if row.status.problem else ()
            if self.has(*texts, row.status.kind):
                made.append(TableRow(row.status.name, texts, colours.past if row.is_gone else "", styles))
        return made

    def details(self, read: list[ProcessRow], key: str) -> list[str]:
        """Its statistics, and the processes before it."""
        return next((row.details() for row in read if row.status.name == key), [])
