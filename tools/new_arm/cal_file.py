"""A `.cal` file of the manufacturer: one assignment a line, `motor.pot_input_gain(1:SLV_MOT_DOFS) = [ 0.0018 … ]`.

Lines that begin with % are comments. Lists may be numbered rows of a table: `joint.signal_range(UPPER_LIMIT,1:7)`.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from trocar.tools.output.errors import Problem

SYMBOLS: Final[Mapping[str, int]] = {
    "UPPER_LIMIT": 1, "LOWER_LIMIT": 2, "MST_JNT_POS_GR_DOFS": 8, "MST_MOT_DOFS": 8, "MST_JNT_POS_DOFS": 7,
    "SLV_JNT_POS_GR_DOFS": 7, "SLV_MOT_DOFS": 7, "ECM_JNT_POS_GR_DOFS": 4, "ECM_MOT_DOFS": 4,
    **{f"INDEX{k}": k for k in range(1, 8)}}
UPPER, LOWER = SYMBOLS["UPPER_LIMIT"], SYMBOLS["LOWER_LIMIT"]
MAX_BYTES: Final = 1 << 20
_LEFT: Final = re.compile(r"(?P<name>[A-Za-z]\w*(?:(?:\(\w+\))?\.\w+)*)\s*(?:\((?P<index>[^()]*)\))?$")
_TOKEN: Final = re.compile(r"""'[^']*'|"[^"]*"|[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?(?![\w.])""")
_BETWEEN: Final = re.compile(r"[\s,;]*")

Row = tuple[float | str, ...]


@dataclass(frozen=True, slots=True)
class CalFile:
    """The lists of a file by name and row; row 0: the list has no number."""

    path: Path
    lists: Mapping[tuple[str, int], Row]

    def numbers(self, name: str, count: int, row: int = 0) -> tuple[float, ...]:
        """A list of this many numbers; Problem if it is missing, or is another one."""
        found = self.lists.get((name, row))
        if found is None:
            raise Problem(f"{self.path}: {name} is missing")
        numbers = tuple(value for value in found if isinstance(value, float))
        if len(numbers) != len(found) or len(found) != count:
            raise Problem(f"{self.path}: {name} has {len(found)} values; needed are {count} numbers")
        return numbers

    def one(self, name: str) -> float | str | None:
        """A single value; None if it is missing."""
        found = self.lists.get((name, 0), ())
        return found[0] if len(found) == 1 else None


def read_cal(path: Path) -> CalFile:
    """Read a file; Problem names the line and the column of what cannot be read."""
    try:
        with path.open("rb") as file:
            data = file.read(MAX_BYTES + 1)
    except OSError as error:
        raise Problem(f"{path} cannot be read: {error.strerror or error}") from None
    if len(data) > MAX_BYTES:
        raise Problem(f"{path} has more than {MAX_BYTES} bytes: it is no .cal file")
    lists: dict[tuple[str, int], Row] = {}
    for number, line in enumerate(data.decode("utf-8", "replace").splitlines(), 1):
        if line.strip() and not line.lstrip().startswith("%"):
            name, row, values = _Line(path, number, line).parsed()
            if (name, row) in lists:
                raise Problem(f"{path} line {number}: {name} is assigned twice")
            lists[name, row] = values
    return CalFile(path, lists)


@dataclass(frozen=True, slots=True)
class _Line:
    path: Path
    number: int
    line: str

    def wrong(self, column: int, what: str) -> Problem:
        return Problem(f"{self.path} line {self.number}, column {column + 1}: {what}")

    def parsed(self) -> tuple[str, int, Row]:
        """Name, row, values."""
        left, equals, _ = self.line.partition("=")
        found = _LEFT.fullmatch(left.strip())
        if not equals or found is None:
            raise self.wrong(0, f"expected NAME = [ VALUES ], found {self.line.strip()[:40]!r}")
        values = self._values(len(left) + 1)
        row, count = self._place(found["index"], left.find("(") + 1)
        if count not in (0, len(values)):
            raise self.wrong(len(left) + 1, f"{found['name']} has {len(values)} values, its range has {count}")
        return found["name"], row, values

    def _place(self, index: str | None, column: int) -> tuple[int, int]:
        """Row and number of values of an index; 0: none is given."""
        parts = [] if index is None else [part.strip() for part in index.split(",")]
        rows = [self._integer(part, column) for part in parts if ":" not in part]
        ranges = [part.partition(":")[::2] for part in parts if ":" in part]
        if len(rows) > 1 or len(ranges) > 1 or any(begin.strip() not in ("", "1") for begin, _ in ranges):
            raise self.wrong(column, f"({index}) is no index; allowed are (N), (1:N), (ROW,1:N) and (ROW,:)")
        ends = [self._integer(end.strip(), column) for _, end in ranges if end.strip()]
        return (rows or [0])[0], (ends or [0])[0]

    def _integer(self, text: str, column: int) -> int:
        value = SYMBOLS.get(text) or (int(text) if text.isascii() and text.isdigit() else 0)
        if not 0 < value <= MAX_BYTES:
            raise self.wrong(column, f"{text!r} is no index; allowed are whole numbers from 1 and {', '.join(SYMBOLS)}")
        return value

    def _values(self, at: int) -> Row:
        """The values behind the equals sign, in brackets; a single one may have none."""
        line, values = self.line.rstrip(), list[float | str]()
        at += len(line[at:]) - len(line[at:].lstrip())
        is_list = line[at : at + 1] == "["
        at += is_list
        while True:
            between = _BETWEEN.match(line, at)
            at = between.end() if between else at
            if line[at : at + 1] == "]" if is_list else at == len(line):
                break
            token = _TOKEN.match(line, at)
            if token is None:
                found = f"found {line[at : at + 20]!r}" if line[at:] else "the line ends without ]"
                raise self.wrong(at, f"expected a number, or a text in quotes; {found}")
            values.append(token[0][1:-1] if token[0][0] in "'\"" else float(token[0]))
            at = token.end()
        if not is_list and len(values) != 1:
            raise self.wrong(at, f"{len(values)} values without [ and ]; allowed is one")
        return tuple(values)
