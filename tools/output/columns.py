"""Fields given by name, and their values as CSV: a column for each cell, named by its path."""

from __future__ import annotations

import contextlib
import csv
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trocar.procs.crtk.field_paths import BadPath, FieldCells, FieldPath, parse_path
from trocar.procs.crtk.plain import plain
from trocar.tools.output.errors import Misuse, Problem
from trocar.tools.output.printing import printable

STDOUT = "-"


def path_of(text: str) -> FieldPath:
    """The given topic, or field of one; Misuse."""
    if not set(text) & {".", "["}:
        return FieldPath(text, text)  # any text: the user of the path names similar ones
    try:
        return parse_path(text)
    except BadPath as error:
        raise Misuse(str(error)) from None


class ColumnsFile:
    """A CSV file being written: a row of names, then a row a record; non-finite or invalid values are empty."""

    def __init__(self, stream: Any, names: Sequence[str]) -> None:
        self._stream, self._writer = stream, csv.writer(stream, lineterminator="\n")
        self._is_terminal = stream.isatty()
        self._writer.writerow(names)

    def row(self, values: Sequence[Any]) -> None:
        """One row, flushed at once."""
        if self._is_terminal:
            values = [printable(value) if isinstance(value, str) else value for value in values]
        self._writer.writerow(["" if value is None else value for value in values])
        self._stream.flush()


@contextlib.contextmanager
def columns_file(file: str, names: Sequence[str]) -> Iterator[ColumnsFile]:
    """CSV in `file`, `-`: on our output; Problem if it cannot be written."""
    if file == STDOUT:
        yield ColumnsFile(sys.stdout, names)
        return
    try:
        stream = Path(file).open("w", encoding="utf-8", newline="")  # noqa: SIM115  # closed below
    except OSError as error:
        raise Problem(f"{file}: cannot be written: {error.strerror}") from None
    with stream:
        yield ColumnsFile(stream, names)


def values_of(cells: Sequence[FieldCells], record: NDArray[Any]) -> list[Any]:
    """The values of one record (1,), in JSON types; None for invalid ones."""
    found: list[Any] = []
    for each in cells:
        good = bool(each.valid(record)[0])
        found += plain(each.raw(record)[0]) if good else [None] * len(each.labels)
    return found


def shaped(cells: FieldCells, values: Sequence[Any]) -> Any:
    """Values of `values_of` for one field, as lists of its shape; a single one alone."""
    made = np.empty(len(values), dtype=object)
    made[:] = values
    return made.reshape(cells.shape).tolist() if cells.shape else values[0]
