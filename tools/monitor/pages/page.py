"""What every page is: a table of rows, and below it what is known of the one that the cursor is on."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, ClassVar

from rich.text import Text
from textual.app import ComposeResult
from textual.containers import Vertical
from textual.widgets import Static

from trocar.tools.monitor.pages.palette import Palette, palette
from trocar.tools.monitor.pages.table import Head, LiveTable, TableRow
from trocar.tools.output.printing import printable

if TYPE_CHECKING:
    from trocar.tools.monitor.overview import Overview


class InspectorPage(Vertical):
    """One page. `read` is called away from the screen's own thread, `render_rows` and `details` in it."""

    TITLE: ClassVar[str]
    COLUMNS: ClassVar[Sequence[Head]]
    EVERY_S: ClassVar[float] = 1.0
    AT_END: ClassVar[bool] = False
    DETAILS: ClassVar[int] = 3
    can_focus = False

    def __init__(self, name: str) -> None:
        super().__init__(id=name)
        self.words = ""
        """What is searched for."""
        self._told = ""
        self.read_once: Any = None
        """What was read last."""

    def compose(self) -> ComposeResult:
        """The table and the lines below it."""
        yield LiveTable(self.COLUMNS)
        yield Static("", classes="details", markup=False)

    @property
    def table(self) -> LiveTable:
        """Its table."""
        return self.query_one(LiveTable)

    @property
    def palette(self) -> Palette:
        """The colours of the theme."""
        return palette(self.app.current_theme.dark)

    def open(self, system: str) -> None:
        """Attach to what the page shows."""

    def close(self) -> None:
        """Unmap."""

    def read(self, seen: Overview) -> Any:
        """What there is now."""
        raise NotImplementedError

    def table_rows(self, read: Any) -> list[TableRow]:
        """Rows of what was read, but for those that are not searched for."""
        raise NotImplementedError

    def details(self, read: Any, key: str) -> list[str]:
        """What is known of a row."""
        raise NotImplementedError

    @property
    def remark(self) -> str:
        """What stands beside the title: what is chosen."""
        return ""

    def show(self, read: Any) -> None:
        """Put what was read on the screen."""
        self.read_once = read
        self.table.show(self.table_rows(read), at_end=self.AT_END)
        self.show_details()

    def clear(self) -> None:
        """Nothing: there is no system."""
        self.read_once = None
        self.table.show([])
        self._tell("")

    def _tell(self, text: str) -> None:
        """Below the table; only when it is something else, as the screen is laid out anew by it."""
        if text != self._told:
            self._told = text
            self.query_one(".details", Static).update(Text(printable(text), overflow="ellipsis"))

    def show_details(self) -> None:
        """The lines below the table, of the row that the cursor is on."""
        if self.read_once is None:
            return
        wide = self.app.size.height >= 40
        lines = self.details(self.read_once, self.table.key)[: self.DETAILS * (3 if wide else 1)]
        self._tell("\n".join(lines))

    def again(self) -> None:
        """Show the same once more: another search, another theme."""
        if self.read_once is not None:
            self.show(self.read_once)

    def search_for(self, words: str) -> None:
        """Show what has these words, with the cursor on the first row; empty: everything."""
        self.words = words
        self.again()
        if words and not self.AT_END:
            self.table.move_cursor(row=0, animate=False)

    def has(self, *texts: str) -> bool:
        """Whether what is searched for is in one of these."""
        return self.words.casefold() in " ".join(texts).casefold()

    def is_named(self, *names: str) -> bool:
        """Whether what is searched for is one of these."""
        return self.words.casefold() in (name.casefold() for name in names)
