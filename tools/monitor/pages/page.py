"""Base of all pages: a table of rows, and below it details of the row under the cursor."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, cast

from rich.text import Text
from textual.app import ComposeResult
from textual.containers import Vertical
from textual.widgets import Static

from trocar.tools.monitor.pages.table import Head, LiveTable, TableRow
from trocar.tools.output.printing import printable

if TYPE_CHECKING:
    from trocar.tools.monitor.overview import Overview


@dataclass(frozen=True, slots=True)
class Palette:
    """Styles of rich, by meaning."""

    past: str
    bad: str
    warning: str
    good: str
    accent: str


DARK = Palette("#8b949e", "#ff7b72", "#e3b341", "#7ee787", "#79c0ff")
LIGHT = Palette("#6a737d", "#b31d28", "#7a4b00", "#176f2c", "#0349b4")


def palette(is_dark: bool) -> Palette:
    """The colours for a background."""
    return DARK if is_dark else LIGHT


class InspectorPage(Vertical):
    """One page. `read` is called away from the screen's own thread, `rows`, `made` and `about` in it."""

    TITLE: ClassVar[str]
    COLUMNS: ClassVar[Sequence[Head]]
    EVERY_S: ClassVar[float] = 1.0
    AT_END: ClassVar[bool] = False
    DETAILS: ClassVar[int] = 3
    DATA: ClassVar[tuple[Callable[[str], Any], ...]] = ()
    """Makes an object with `rows` for a system, closed with the page; none: the page handles that itself."""
    data: Any = None
    can_focus = False

    def __init__(self, name: str) -> None:
        super().__init__(id=name)
        self.words = ""
        """The search text."""
        self._told = ""
        self.read_once: Any = None
        """The last data read."""
        self._shown: dict[str, tuple[Any, TableRow]] = {}

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
        """Attach to the page's data."""
        self.data = self.DATA[0](system) if self.DATA else None

    def close(self) -> None:
        """Unmap."""
        if self.data is not None:
            self.data.close()

    def read(self, seen: Overview) -> Any:
        """The current data: rows, unless the page has its own `rows`."""
        return self.data.rows() if self.data is not None else []

    def rows(self, read: Any) -> Iterable[Any]:
        """The rows of the data, in order."""
        return cast(Iterable[Any], read)

    def made(self, row: Any) -> TableRow:
        """A row of the table."""
        raise NotImplementedError

    def about(self, row: Any) -> list[str]:
        """Details of a row."""
        raise NotImplementedError

    @property
    def remark(self) -> str:
        """Text beside the title: the selection."""
        return ""

    def show(self, read: Any) -> None:
        """Show the data on the screen."""
        self.read_once = read
        self._shown = {made.key: (row, made) for row in self.rows(read) if self.has(*(made := self.made(row)).searched)}
        self.table.show([made for _, made in self._shown.values()], at_end=self.AT_END)
        self.show_details()

    def clear(self) -> None:
        """Empty: there is no system."""
        self.read_once = None
        self.table.show([])
        self._tell("")

    def _tell(self, text: str) -> None:
        """Below the table; only on a change, which repeats the layout of the screen."""
        if text != self._told:
            self._told = text
            self.query_one(".details", Static).update(Text(printable(text), overflow="ellipsis"))

    def show_details(self) -> None:
        """The lines below the table, of the row that the cursor is on."""
        if self.read_once is None:
            return
        wide = self.app.size.height >= 40
        shown = self._shown.get(self.table.key)
        lines = self.about(shown[0])[: self.DETAILS * (3 if wide else 1)] if shown is not None else []
        self._tell("\n".join(lines))

    def again(self) -> None:
        """Show the same data again: after another search or theme."""
        if self.read_once is not None:
            self.show(self.read_once)

    def search_for(self, words: str) -> None:
        """Show the rows with these words, with the cursor on the first one; empty: all."""
        self.words = words
        self.again()
        if words and not self.AT_END:
            self.table.move_cursor(row=0, animate=False)

    def has(self, *texts: str) -> bool:
        """Whether the search text is in one of these."""
        return self.words.casefold() in " ".join(texts).casefold()

    def is_named(self, *names: str) -> bool:
        """Whether the search text is one of these."""
        return self.words.casefold() in (name.casefold() for name in names)
