"""The page of commands."""

from __future__ import annotations

from typing import TYPE_CHECKING

from trocar.tools.monitor.commands import AskedRow, CommandsData, sought, under_way
from trocar.tools.monitor.pages.page import InspectorPage
from trocar.tools.monitor.pages.table import Head, TableRow

if TYPE_CHECKING:
    from trocar.tools.monitor.overview import Overview


class CommandsPage(InspectorPage):
    """What is being carried out on top, then what was asked for, the newest first."""

    TITLE = "commands"
    COLUMNS = (Head("at", 12), Head("asked", 9), Head("for", 18), Head("outcome", 9), Head("whose", 0),
               Head("reason", 0, is_wide=True))
    EVERY_S = 0.5
    DETAILS = 2
    _data: CommandsData | None = None

    def open(self, system: str) -> None:
        """Attach to what is kept of commands."""
        self._data = CommandsData(system)

    def close(self) -> None:
        """Unmap."""
        if self._data is not None:
            self._data.close()

    @property
    def remark(self) -> str:
        """How many are under way."""
        count = len(self.read_once[1]) if self.read_once else 0
        return f"{count} under way" if count else "none under way"

    def read(self, seen: Overview) -> tuple[list[AskedRow], list[AskedRow]]:
        """All that are known, and those under way."""
        rows = self._data.rows() if self._data is not None else []
        return rows, under_way(rows, seen.processes)

    def table_rows(self, read: tuple[list[AskedRow], list[AskedRow]]) -> list[TableRow]:
        """Those under way on top."""
        rows, now = read
        colours = self.palette
        outcomes = {"refused": colours.bad, "failed": colours.bad, "done": colours.good}
        made = [TableRow(f"now {row.key}", [*row.cells[:3], "under way", *row.cells[4:]], colours.accent)
                for row in sought(reversed(now), self.words)]
        return made + [TableRow(f"{row.key} {row.outcome} {row.order}", row.cells, "",
                                ((3, outcomes.get(row.outcome, "")),)) for row in sought(reversed(rows), self.words)]

    def details(self, read: tuple[list[AskedRow], list[AskedRow]], key: str) -> list[str]:
        """The whole of it."""
        for row in reversed(read[0]):
            if key in (f"now {row.key}", f"{row.key} {row.outcome} {row.order}"):
                return [f"{row.at} {row.who}: {row.command}: {row.outcome}, for {row.whose}",
                        f"reason: {row.reason}" if row.reason else ""]
        return []
