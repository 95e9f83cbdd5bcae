"""Tables in lines of text, for any width: no word and no number is cut, and texts are wrapped between words."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Mapping, Sequence
from typing import Final

GAP: Final = "  "
READABLE: Final = 20
"""Minimum number of characters a line of a text, if there is room beside the first column."""


def wrapped(text: str, within: int, indent: str = "") -> list[str]:
    """Lines of a text, broken between words at the width; all but the first begin with `indent`."""
    return [line for part in text.split("\n") for line in textwrap.wrap(
        part, max(within, 1), subsequent_indent=indent, break_long_words=False, break_on_hyphens=False) or [""]]


def table_lines(columns: Sequence[str], rows: Iterable[Sequence[str]], right: Sequence[str], within: int) -> list[str]:
    """A table, `right` naming the columns that are flush right, in lines of at most `within` letters.

    Columns for which there is no room follow below, beside the first column again; empty ones are left out. Only a word
    that is longer than a line makes a line longer.
    """
    cells = [[cell.replace("\t", " ") for cell in row] for row in (columns, *rows)]
    used = [k for k in range(len(columns)) if not k or any(row[k] for row in cells[1:])]
    needs = {k: _needs([row[k] for row in cells]) for k in used}
    lines: list[str] = []
    for block in _blocks(needs, within):
        widths = _widths([needs[k] for k in block], within)
        justify = [str.rjust if columns[k] in right else str.ljust for k in block]
        parts = [[wrapped(row[k], width) for k, width in zip(block, widths, strict=True)] for row in cells]
        shown = [GAP.join(put(cell[n] if n < len(cell) else "", width)
                          for cell, put, width in zip(row, justify, widths, strict=True)).rstrip()
                 for row in parts for n in range(max(map(len, row)))]
        head = max(map(len, parts[0]))
        lines += [*shown[:head], "─" * len(GAP.join("─" * width for width in widths)), *shown[head:], ""]
    return lines


def _needs(cells: Sequence[str]) -> tuple[int, int, int]:
    """How wide a column must be, how wide it is to be read with ease, and how wide it would like to be."""
    least = max((len(word) for cell in cells for word in cell.split()), default=0)
    wide = [len(line) for cell in cells for line in cell.split("\n")]
    return least, max(least, min(max(wide[1:], default=0), READABLE)), max(wide)


def _blocks(needs: Mapping[int, tuple[int, int, int]], within: int) -> list[list[int]]:
    """The columns of each table: as many as can be read with ease, the first one always among them."""
    (first, *others), blocks, taken = needs, [[0]], needs[0][1]
    for k in others:
        if taken + len(GAP) + needs[k][1] > within and len(blocks[-1]) > 1:
            blocks.append([first])
            taken = needs[first][1]
        blocks[-1].append(k)
        taken += len(GAP) + needs[k][1]
    return blocks


def _widths(needs: Sequence[tuple[int, int, int]], within: int) -> list[int]:
    """The remaining width is shared by the columns that need more."""
    widths = [least for least, _, _ in needs]
    left = within - sum(widths) - len(GAP) * (len(widths) - 1)
    while left > 0 and (wanting := [k for k, (_, _, wide) in enumerate(needs) if widths[k] < wide]):
        for k in wanting[:left]:
            widths[k] += 1
        left -= len(wanting)
    return widths
