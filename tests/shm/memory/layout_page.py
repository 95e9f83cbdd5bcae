"""The tables of docs/shared-memory.md, read."""

from __future__ import annotations

import importlib
import itertools
import re
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]
TEXT = (ROOT / "docs" / "shared-memory.md").read_text(encoding="utf-8")
Row = dict[str, str]


@dataclass(frozen=True)
class Table:
    """One table of the page: the heading it stands under, and its rows by column."""

    heading: str
    columns: tuple[str, ...]
    rows: tuple[Row, ...]


def cells(line: str) -> tuple[str, ...]:
    return tuple(cell.strip().strip("`") for cell in line.strip().strip("|").split("|"))


def tables() -> Iterator[Table]:
    heading, lines = "", [*TEXT.splitlines(), ""]
    for i, line in enumerate(lines):
        if line.startswith("#"):
            heading = line.strip("# ")
        if line.startswith("|") and not lines[i - 1].startswith("|"):
            block = list(itertools.takewhile(lambda text: text.startswith("|"), lines[i:]))
            assert set(block[1]) <= set("|-"), "the second line of a table"
            rows = tuple(dict(zip(cells(block[0]), cells(row), strict=True)) for row in block[2:])
            yield Table(heading, cells(block[0]), rows)


def table(heading: str, *columns: str) -> tuple[Row, ...]:
    """The rows of the one table under a heading that begins with these columns."""
    (found,) = [t for t in tables() if t.heading == heading and t.columns[: len(columns)] == columns]
    return found.rows


def records(number: int) -> dict[str, Row]:
    """The tables that lay out a record: 0 control, 1 command, 2 reply, 3 clock."""
    found = [t for t in tables() if t.columns[:4] == ("offset", "size", "dtype", "field")]
    assert [t.heading for t in found] == ["Control page", "Mailbox", "Mailbox", "Clock page"]
    return {row["field"]: row for row in found[number].rows}


def places(form: str) -> list[tuple[int, int]]:
    """(offset, size) of every member of a struct format without gaps."""
    sizes = [struct.calcsize(f"<{part}") for part in re.findall(r"\d*[a-zA-Z]", re.sub(
        r"(\d+)I", lambda m: "I" * int(m[1]), form.strip("<")))]
    return list(zip(itertools.accumulate(sizes, initial=0), sizes, strict=False))


def code(path: str) -> int:
    module, name = path.rsplit(".", 1)
    return int(getattr(importlib.import_module(module), name))


def number(text: str) -> int:
    """57, 2^59, or 2^59 − 2."""
    base, power, minus = re.fullmatch(r"(\d+)(?:\^(\d+))?(?: − (\d+))?", text).groups("0")  # type: ignore[union-attr]
    return int(base) ** int(power or 1) - int(minus) if "^" in text else int(base)
