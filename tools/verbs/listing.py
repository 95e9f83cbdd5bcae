"""`trocar list` and `trocar hz`: which topics there are, and how often they really come."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Sequence
from typing import Annotated, Any

import numpy as np
import typer
from numpy.typing import NDArray

from trocar.procs.crtk.field_paths import BadPath, FieldPath, cells_of
from trocar.procs.crtk.topics import RECORD, TopicEntry, catalogue, find, writer_gone
from trocar.shm.memory.segment import SegmentError
from trocar.shm.ring.ring import RingReader
from trocar.shm.system import directory
from trocar.shm.time.clock import pause
from trocar.tools.output.columns import columns_file, path_of
from trocar.tools.output.errors import Misuse
from trocar.tools.output.printing import emit, number, table, tell
from trocar.tools.systems.find import chosen_system, is_reduced
from trocar.tools.verbs.options import JsonOption, SystemOption

WINDOW_S = 1.0


def list_topics(
    verbose: Annotated[bool, typer.Option("--verbose", "-v", help="Every field with its unit and meaning.")] = False,
    as_json: JsonOption = False,
    system: SystemOption = None,
) -> int:
    """List the topics of a running system: topics with records, CRTK views of them, and events.

    Exit code 1: another program removed shared memory of the system.

    Example: trocar list --verbose
    """
    name = chosen_system(system)
    entries = catalogue(name)
    if as_json:
        emit(*map(_described, entries))
    elif verbose:
        for entry in entries:
            rate = f", nominal {entry.rate_hz:g} Hz" if entry.rate_hz else ""
            rate += f", {entry.simulation}" if entry.simulation else ""
            title = f"{entry.name}  ({entry.kind}{rate})" + (f"  {entry.problem}" if entry.problem else "")
            if entry.kind == "event":
                tell(f"{title}\n")
            else:
                table(title, ("field", "type", "unit", "meaning"),
                      [(f.name, f.dtype, f.unit, f.text) for f in entry.fields])
    else:
        rows = [(e.name, f"{e.kind} {e.simulation}".rstrip(), number(e.rate_hz or None, "g"), _names(e), e.problem)
                for e in entries]
        table("", ("topic", "kind", "nominal Hz", "fields", "problem"), rows, right=("nominal Hz",))
    return int(is_reduced(name))


def _names(entry: TopicEntry) -> str:
    if entry.view is not None:
        return " ".join(part for part, _ in entry.view.fields)
    if entry.kind == RECORD:
        return f"{len(entry.fields)} fields"
    return ""


def _described(entry: TopicEntry) -> dict[str, Any]:
    fields = [] if entry.kind == "event" else [dataclasses.asdict(f) for f in entry.fields]
    return {"topic": entry.name, "kind": entry.kind, "rate_hz": entry.rate_hz or None, "fields": fields,
            "simulation": entry.simulation, "problem": entry.problem}


def hz(
    topics: Annotated[list[str] | None, typer.Argument(
        metavar="[TOPICS]...", help="Topics, or fields of topics; default: every topic that has records.")] = None,
    window: Annotated[float, typer.Option("--window", min=0.05, help="Measure for this many seconds.")] = WINDOW_S,
    csv: Annotated[str, typer.Option("--csv", metavar="FILE", help="Write CSV; -: standard output.")] = "",
    as_json: JsonOption = False,
    system: SystemOption = None,
) -> int:
    """Measure the rates of topics by their sequence numbers, and the spacing of their stamps.

    For a field, also measure how often its value changed.

    Example: trocar hz PSM1/state IO1/state

    Example: trocar hz 'PSM1/measured_js.position[0]' --json
    """
    if csv and as_json:
        raise Misuse("cannot combine --csv and --json")
    paths = [path_of(text) for text in topics or []]
    name = chosen_system(system)
    entries = [find(name, path.topic) for path in paths] if paths else [e for e in catalogue(name) if e.kind == RECORD]
    rows = measured(name, entries, window, paths)
    if as_json:
        emit(*rows)
    elif csv:
        with columns_file(csv, list(rows[0]) if rows else []) as file:
            for row in rows:
                file.row(list(row.values()))
    else:
        of_fields = any(path.field for path in paths)
        figures = ["hz", "nominal_hz", "period_ms", "std_ms", "max_ms"] + ["changes_hz"] * of_fields
        titles = ["Hz", "nominal", "period ms", "std ms", "max ms"] + ["changes Hz"] * of_fields
        cells = [(row["topic"], *(number(row[key], ".2f") for key in figures), row["problem"]) for row in rows]
        table("", ("topic", *titles, "problem"), cells, right=titles)
    silent = [r for r in rows if r["nominal_hz"] and not r["records"]]
    return 1 if topics and silent else 0


def measured(system: str, entries: list[TopicEntry], window_s: float, paths: Sequence[FieldPath] = ()
             ) -> list[dict[str, Any]]:
    """Rates of topics over a window; the spacing is that of the stamps, None where fewer than two records came.

    Misuse where one of the `paths`, those of the entries, has no such field.
    """
    watched = [_Rate(system, entry, path) for entry, path in itertools.zip_longest(entries, paths)]
    try:
        pause(window_s)
        return [rate.row(window_s) for rate in watched]
    finally:
        for rate in watched:
            rate.close()


class _Rate:
    """One topic over a window; what cannot be read is a row too, with its problem."""

    def __init__(self, system: str, entry: TopicEntry, path: FieldPath | None = None) -> None:
        self._entry, self._path, self._before, self._problem = entry, path, 0, entry.problem
        self._reader: RingReader | None = None
        try:
            self._reader = directory.reader(system, entry.instance, entry.ring, often=False)
            self._before = self._reader.head
        except SegmentError as error:
            self._problem = str(error)

    def row(self, window_s: float) -> dict[str, Any]:
        count, gaps, changes_hz = 0, np.zeros(0), None
        reader = self._reader
        if reader is not None:
            count = reader.head - self._before
            if count > 0:
                rows = reader.last(count)
                gaps = np.diff(rows["stamp_ns"]) * 1e-6
                changes_hz = self._changes_hz(rows, window_s if len(rows) == count else float(gaps.sum()) * 1e-3)
            reader.newest()
            reported = [writer_gone(reader.gone), "the head went backwards" if count < 0 else "", reader.problem]
            self._problem = "; ".join(part for part in reported if part)
        some, steady = len(gaps) > 0, len(gaps) > 0 and gaps.mean() > 0
        return {
            "topic": self._path.text if self._path else self._entry.name, "records": max(0, count),
            "nominal_hz": self._entry.rate_hz or None,
            "hz": float(1e3 / gaps.mean()) if steady else max(0, count) / window_s,
            "period_ms": float(gaps.mean()) if some else None, "std_ms": float(gaps.std()) if some else None,
            "max_ms": float(gaps.max()) if some else None,
            "changes_hz": changes_hz, "problem": self._problem,
        }

    def _changes_hz(self, rows: NDArray[Any], seconds: float) -> float | None:
        """How often in so many seconds the value of the field was another than in the record before; None: no field.

        What is not known does not change. Rings keep less than a long window: then it is the time that they keep.
        """
        if self._path is None or not self._path.field or not len(rows) or seconds <= 0.0:
            return None
        try:
            values = cells_of(self._entry, self._path, rows[-1:]).raw(rows)
        except BadPath as error:
            raise Misuse(str(error)) from None
        others = values[1:] != values[:-1]
        if values.dtype.kind == "f":
            others &= ~(np.isnan(values[1:]) & np.isnan(values[:-1]))
        return float(np.any(others, axis=1).sum() / seconds)

    def close(self) -> None:
        if self._reader is not None:
            self._reader.close()
