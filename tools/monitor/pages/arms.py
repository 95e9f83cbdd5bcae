"""The page of arms."""

from __future__ import annotations

from typing import TYPE_CHECKING

from trocar.tools.inspect.standing import Standing
from trocar.tools.monitor.arms import cells, details, sought
from trocar.tools.monitor.pages.page import InspectorPage
from trocar.tools.monitor.pages.table import Head, TableRow

if TYPE_CHECKING:
    from trocar.tools.monitor.overview import Overview


class ArmsPage(InspectorPage):
    """Arms, setup joints, teleoperations and consoles."""

    TITLE = "arms"
    COLUMNS = (Head("name", 12), Head("state", 16), Head("homed", 5), Head("fault", 16, False, True),
               Head("why, or waits for what", 0), Head("remedy", 0, is_wide=True))
    EVERY_S = 0.5
    DETAILS = 5

    @property
    def remark(self) -> str:
        """What it is about."""
        return "arms, setup joints, teleoperations, consoles"

    def read(self, seen: Overview) -> tuple[list[Standing], dict[str, float]]:
        """As the overview found them, and which of their processes are dead."""
        return list(seen.standings), seen.silences

    def table_rows(self, read: tuple[list[Standing], dict[str, float]]) -> list[TableRow]:
        """A row each; in FAULT red, of a dead process grey."""
        found, silent = read
        colours, made = self.palette, []
        for one in sought(found, self.words):
            texts = cells(one)
            texts[1] += " (dead)" if one.name in silent else ""
            styles = ((1, colours.bad), (3, colours.bad)) if one.is_fault else ((1, colours.good),) * bool(one.homed)
            made.append(TableRow(one.name, texts, colours.past if one.name in silent else "",
                                 () if one.name in silent else styles))
        return made

    def details(self, read: tuple[list[Standing], dict[str, float]], key: str) -> list[str]:
        """The error as it was reported, and the remedy."""
        return next((details(one) for one in read[0] if one.name == key), [])
