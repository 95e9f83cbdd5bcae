"""Recordings for other programs: a table a topic as CSV or Parquet, or the whole as a folder that rosbag2 opens."""

from __future__ import annotations

import csv
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from trocar.procs.machine.extras import missing
from trocar.procs.recordings.reading import RecordedTopic, RecordingReader, Records
from trocar.procs.recordings.records import joined
from trocar.shm.memory.header import readable
from trocar.tools.analysis.choosing import Stretch
from trocar.tools.output.errors import Problem
from trocar.tools.output.printing import Say

CSV, PARQUET, ROSBAG2 = "csv", "parquet", "rosbag2"
STDOUT: Final = "-"
AT_ONCE: Final = 10_000  # rows


@dataclass(frozen=True, slots=True)
class TableColumn:
    """One column of a table: its name, and the values (n,): numbers, flags or texts."""

    name: str
    values: NDArray[Any]


TableParts = Iterator[list[TableColumn]]
"""A table in successive blocks of rows: the same columns each time."""


def columns(topic: RecordedTopic, records: Records, last: NDArray[Any]) -> list[TableColumn]:
    """A topic's records as columns: an array has one for each element, named after joints if it has any.

    `last`: the last row of all, with the names. The first columns are `sequence`, `stamp_ns` (system time), `local_ns`
    (time of day) and `epoch` (which process wrote).
    """
    rows = records.rows
    found = [TableColumn("sequence", rows["sequence"]), TableColumn("stamp_ns", rows["stamp_ns"]),
             TableColumn("local_ns", records.local_ns), TableColumn("epoch", records.epoch)]
    labels = element_names(topic, last)
    for field in (rows.dtype.names or ())[2:]:
        name = f"{field}_of_record" if field in ("local_ns", "epoch") else field
        values = rows[field]
        if values.ndim == 1:
            found.append(TableColumn(name, _plain(values)))
            continue
        for place in np.ndindex(values.shape[1:]):
            named = labels.get(values.shape[1], ()) if values.ndim == 2 else ()
            label = named[place[0]] if named else "][".join(map(str, place))
            found.append(TableColumn(f"{name}[{label}]", _plain(values[(slice(None), *place)])))
    return found


def _plain(values: NDArray[Any]) -> NDArray[Any]:
    """Texts as such; numbers stay."""
    if values.dtype.kind != "S":
        return values
    return np.array([readable(bytes(text)) for text in values.tolist()], dtype=object)


def element_names(topic: RecordedTopic, rows: NDArray[Any]) -> dict[int, tuple[str, ...]]:
    """Names of array elements, by their number: joints of an arm, axes of the robots of an io.

    An arm's arrays have more elements than it has joints: the extra ones are named by their index.
    """
    found: dict[int, tuple[str, ...]] = {}
    if "names" in (rows.dtype.names or ()) and len(rows) and rows["names"].ndim == 2:
        names = [readable(bytes(text)) for text in rows["names"][-1].tolist()]
        found[len(names)] = tuple(name or str(k) for k, name in enumerate(names))
    robots, dims = topic.info.get("robots"), topic.info.get("dims")
    axes = dims.get("axes") if isinstance(dims, dict) else None
    if isinstance(robots, dict) and isinstance(axes, int) and 0 < axes < 1000:
        called = [str(k) for k in range(axes)]
        for name, cut in robots.items():
            joints = cut.get("names") if isinstance(cut, dict) else None
            first = cut.get("first") if isinstance(cut, dict) else None
            if isinstance(joints, list) and isinstance(first, int) and first >= 0:
                for k, joint in enumerate(joints[: max(0, axes - first)]):
                    called[first + k] = f"{name}.{joint}"
        found[axes] = tuple(called)
    return {size: _unique(names) for size, names in found.items()}


def _unique(names: Sequence[str]) -> tuple[str, ...]:
    return tuple(name if names.index(name) == k else f"{name}_{k}" for k, name in enumerate(names))


@dataclass(frozen=True, slots=True)
class RecordingTables:
    """The data to write: these topics of a recording, this stretch of it."""

    recording: RecordingReader
    topics: Sequence[str]
    part: Stretch
    all_of_them: bool = True
    """Also those without a record there: a recording names every topic of its system."""

    def tables(self, say: Say) -> Iterator[tuple[str, TableParts]]:
        """Each topic with its columns, in successive blocks of rows: the first block may be empty."""
        for done, name in enumerate(self.topics):
            say(name, done / len(self.topics))
            in_order, last = self._look(name, self.part)
            if self.all_of_them or len(last):
                topic, parts = self.recording.topics[name], self._parts(name, in_order)
                named = last if len(last) else self._look(name, Stretch())[1]
                yield name, (columns(topic, records, named) for records in parts)

    def _look(self, name: str, part: Stretch) -> tuple[bool, NDArray[Any]]:
        """Whether records are in the order of their numbers, and the last row, if there is one."""
        before, in_order, last = -1, True, joined([], self.recording.dtype(name)).rows
        for _, piece in self.recording.pieces([name], stamps=part.stamps):
            numbers = piece.rows["sequence"]
            in_order = in_order and int(numbers[0]) > before and bool((numbers[1:] > numbers[:-1]).all())
            last, before = piece.rows[-1:], int(numbers[-1])
        return in_order, last

    def _parts(self, name: str, in_order: bool) -> Iterator[Records]:
        """All records in their order; a topic recorded out of order, e.g. after a fault, is sorted as a whole."""
        if not in_order:
            yield self.recording.records(name, stamps=self.part.stamps)
            return
        found, dtype = list[Records](), self.recording.dtype(name)
        for _, piece in self.recording.pieces([name], stamps=self.part.stamps):
            found.append(piece)
            if sum(len(each.rows) for each in found) >= AT_ONCE:
                yield joined(found, dtype)
                found = []
        yield joined(found, dtype)

    def to_csv(self, folder: Path, say: Say) -> list[Path]:
        """A file a topic; those that were written."""
        written = []
        for name, parts in self.tables(say):
            path = folder / f"{file_stem(name)}.csv"
            with path.open("w", encoding="utf-8", newline="") as stream:
                write_csv(stream, parts)
            written.append(path)
        return written

    def to_stdout(self, say: Say) -> None:
        """The only topic as CSV."""
        for _, parts in self.tables(say):
            write_csv(sys.stdout, parts)

    def to_parquet(self, folder: Path, say: Say) -> list[Path]:
        """A file a topic; Problem without pyarrow."""
        parquet, table = arrow()
        written = []
        for name, parts in self.tables(say):
            path = folder / f"{file_stem(name)}.parquet"
            tables = (table({column.name: _as_list(column) for column in part}) for part in parts)
            first = next(tables)
            with parquet.ParquetWriter(str(path), first.schema) as writer:
                for each in chain([first], tables):
                    writer.write_table(each.cast(first.schema))
            written.append(path)
        return written


def arrow() -> tuple[Any, Any]:
    """The Parquet writer, and the table maker; Problem if they are not installed."""
    if lacks := missing("pyarrow"):
        raise Problem(f"{lacks}; or take --format csv")
    from pyarrow import parquet, table

    return parquet, table


def _as_list(column: TableColumn) -> Any:
    return column.values.tolist() if column.values.dtype.kind == "O" else np.ascontiguousarray(column.values)


def file_stem(topic: str) -> str:
    """PSM1/state: PSM1-state."""
    return "".join(letter if letter.isalnum() or letter in "-_." else "-" for letter in topic).lstrip(".") or "topic"


def write_csv(stream: Any, parts: TableParts) -> None:
    """A row of names, then a row a record; NaN is empty, flags are 0 and 1, numbers have all their digits."""
    writer = csv.writer(stream, lineterminator="\n")
    for number, table in enumerate(parts):
        if not number:
            writer.writerow([column.name for column in table])
        for begin in range(0, len(table[0].values), AT_ONCE):
            cells = [_cells(column.values[begin : begin + AT_ONCE]) for column in table]
            writer.writerows(zip(*cells, strict=True))


def _cells(values: NDArray[Any]) -> list[Any]:
    cells: list[Any] = (values.astype(np.uint8) if values.dtype.kind == "b" else values).tolist()
    return ["" if value != value else value for value in cells] if values.dtype.kind == "f" else cells
