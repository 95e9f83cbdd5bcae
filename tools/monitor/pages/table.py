"""A table that changes in place: only changed cells are redrawn, and the cursor keeps its position."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from textwrap import wrap

from rich.text import Text
from textual.widgets import DataTable

from trocar.tools.output.printing import printable

WIDE = 110
"""From this many columns of the terminal on, a table's columns for wide terminals are shown."""


@dataclass(frozen=True, slots=True)
class Head:
    """A column: its title, characters (0: the rest, shared), flush right, only on a wide terminal.

    A text that is too long continues on the next line.
    """

    title: str
    width: int
    is_right: bool = False
    is_wide: bool = False


@dataclass(frozen=True, slots=True)
class TableRow:
    """A row: its key, its cells in the order of all columns, and a style for all, or for one, of them.

    `more`: the searched text, if that is not the cells.
    """

    key: str
    cells: Sequence[str]
    style: str = ""
    styles: tuple[tuple[int, str], ...] = ()
    more: Sequence[str] = ()

    @property
    def searched(self) -> Sequence[str]:
        """The texts that are searched."""
        return self.more or self.cells

    def texts(self, columns: Sequence[Head], widths: Mapping[int, int]) -> list[Text]:
        """The visible cells, by their indices, each in its width."""
        own, made = dict(self.styles), []
        for k, width in widths.items():
            words = printable(self.cells[k].replace("\n", " "), "")
            lines = [line.rjust(width) if columns[k].is_right else line for line in wrap(words, width) or [""]]
            made.append(Text("\n".join(lines), no_wrap=True, end="", style=own.get(k, self.style)))
        return made


def _height(texts: Sequence[Text]) -> int:
    """Lines of a row."""
    return max(text.plain.count("\n") + 1 for text in texts)


class LiveTable(DataTable[Text]):
    """See the module. `show` is all that pages need."""

    def __init__(self, columns: Sequence[Head]) -> None:
        super().__init__(cursor_type="row", zebra_stripes=False, cell_padding=0)
        self._all = tuple(columns)
        self._widths: dict[int, int] = {}
        self._shown: list[tuple[str, list[Text]]] = []
        self._laid_out = 0

    def show(self, rows: Sequence[TableRow], *, at_end: bool = False) -> None:
        """Show these rows, in this order. `at_end`: a cursor on the last row stays on the last row."""
        self._lay_out()
        made = [(row.key, row.texts(self._all, self._widths)) for row in rows]
        if [(key, _height(texts)) for key, texts in made] != [(key, _height(texts)) for key, texts in self._shown]:
            self._refill(made, at_end)
        else:
            keys = list(self.columns)
            for (key, texts), (_, before) in zip(made, self._shown, strict=True):
                for column, new, old in zip(keys, texts, before, strict=True):
                    if new != old or new.style != old.style:
                        self.update_cell(key, column, new)
        self._shown = made

    @property
    def key(self) -> str:
        """The row under the cursor; empty: none."""
        at = self.cursor_row
        return self._shown[at][0] if 0 <= at < len(self._shown) else ""

    def _refill(self, made: list[tuple[str, list[Text]]], at_end: bool) -> None:
        key, scroll, was_last = self.key, self.scroll_y, self.cursor_row >= len(self._shown) - 1
        with self.app.batch_update():
            self.clear()
            for row_key, texts in made:
                self.add_row(*texts, key=row_key, height=_height(texts))
            keys = [row_key for row_key, _ in made]
            if at_end and was_last:
                self.move_cursor(row=len(made) - 1, animate=False)
            elif key in keys:
                self.move_cursor(row=keys.index(key), animate=False, scroll=False)
                self.scroll_to(y=scroll, animate=False)

    def _lay_out(self) -> None:
        """Columns for the present width; recomputed when that has changed."""
        width = self.size.width or self.app.size.width
        if width == self._laid_out:
            return
        self._laid_out = width
        is_wide = self.app.size.width >= WIDE
        places = [k for k, column in enumerate(self._all) if is_wide or not column.is_wide]
        self.clear(columns=True)
        self._shown = []
        left = width - 2 - sum(self._all[k].width for k in places) - len(places)
        flexible = max(1, sum(self._all[k].width == 0 for k in places))
        self._widths = {k: self._all[k].width or max(8, left // flexible) for k in places}
        for k, own in self._widths.items():
            column = self._all[k]
            self.add_column(Text(column.title.rjust(own) if column.is_right else column.title), width=own + 1)
