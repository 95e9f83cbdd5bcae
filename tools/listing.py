"""`trocar list` and `trocar hz`: which topics there are, and how often they really come."""

from __future__ import annotations

import dataclasses
from typing import Annotated, Any

import numpy as np
import typer

from shm import directory
from shm.clock import pause
from tools.options import JsonOption, SystemOption
from tools.printing import emit, number, table
from tools.systems import chosen_system
from tools.topics import RECORD, Entry, catalogue, find

WINDOW_S = 1.0


def list_topics(
    verbose: Annotated[bool, typer.Option("--verbose", "-v", help="Every field with its unit and meaning.")] = False,
    as_json: JsonOption = False,
    system: SystemOption = None,
) -> None:
    """List the topics of a running system: records, CRTK views on them, events.

    Example: trocar list --verbose
    """
    entries = catalogue(chosen_system(system))
    if as_json:
        for entry in entries:
            emit(_described(entry))
    elif verbose:
        for entry in entries:
            rate = f", nominal {entry.rate_hz:g} Hz" if entry.rate_hz else ""
            print(f"{entry.name}  ({entry.kind}{rate})")
            if entry.kind != "event":
                for f in entry.fields:
                    print(f"    {f.name:<22} {f.dtype:<10} {f.unit:<12} {f.text}")
    else:
        rows = [(e.name, e.kind, number(e.rate_hz or None, "g"), _names(e)) for e in entries]
        table("", ("topic", "kind", "Hz", "fields"), rows, right=("Hz",))


def _names(entry: Entry) -> str:
    if entry.view is not None:
        return " ".join(part for part, _ in entry.view.fields)
    if entry.kind == RECORD:
        return f"{len(entry.fields)} fields"
    return ""


def _described(entry: Entry) -> dict[str, Any]:
    fields = [] if entry.kind == "event" else [dataclasses.asdict(f) for f in entry.fields]
    return {"topic": entry.name, "kind": entry.kind, "rate_hz": entry.rate_hz or None, "fields": fields}


def hz(
    topics: Annotated[list[str] | None, typer.Argument(help="Topics; none: every record.")] = None,
    window: Annotated[float, typer.Option("--window", min=0.05, help="Seconds to count.")] = WINDOW_S,
    as_json: JsonOption = False,
    system: SystemOption = None,
) -> int:
    """Measure the rates of topics by their sequence numbers, and the spacing of their stamps.

    Example: trocar hz PSM1/state IO1/state
    """
    name = chosen_system(system)
    entries = [find(name, t) for t in topics] if topics else [e for e in catalogue(name) if e.kind == RECORD]
    rows = measured(name, entries, window)
    if as_json:
        for row in rows:
            emit(row)
    else:
        figures = ("hz", "nominal_hz", "period_ms", "std_ms", "max_ms")
        cells = [(str(row["topic"]), *(number(row[key], ".2f") for key in figures)) for row in rows]
        table("", ("topic", "Hz", "nominal", "period ms", "std ms", "max ms"), cells,
              right=("Hz", "nominal", "period ms", "std ms", "max ms"))
    silent = [r for r in rows if r["nominal_hz"] and not r["records"]]
    return 1 if topics and silent else 0


def measured(system: str, entries: list[Entry], window_s: float) -> list[dict[str, Any]]:
    """Rates of topics over a window; the spacing is that of the stamps, None where fewer than two records came."""
    readers = [directory.reader(system, e.instance, e.ring) for e in entries]
    try:
        before = [reader.head for reader in readers]
        pause(window_s)
        after = [reader.head for reader in readers]
        kept = [reader.last(n - b) if n > b else None for reader, n, b in zip(readers, after, before, strict=True)]
    finally:
        for reader in readers:
            reader.close()
    rows = []
    for entry, n, b, records in zip(entries, after, before, kept, strict=True):
        gaps = np.diff(records["stamp_ns"]) * 1e-6 if records is not None else np.zeros(0)
        some = len(gaps) > 0
        rows.append({
            "topic": entry.name, "records": n - b, "nominal_hz": entry.rate_hz or None,
            "hz": float(1e3 / gaps.mean()) if some and gaps.mean() > 0 else (n - b) / window_s,
            "period_ms": float(gaps.mean()) if some else None, "std_ms": float(gaps.std()) if some else None,
            "max_ms": float(gaps.max()) if some else None,
        })
    return rows
