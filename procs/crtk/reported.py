"""Reports of processes as data for all user interfaces: severity, code, sentence and remedy."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final

from trocar.procs.crtk.plain import plain
from trocar.shm.memory.segment import SegmentError
from trocar.shm.ring.ring import RingReader
from trocar.shm.system import directory
from trocar.shm.system.events import SEVERITIES

FIELDS: Final = ("severity", "code", "text", "hint", "monotonic_ns", "local_ns")


def message_of(name: str, event: Any) -> dict[str, Any]:
    """An event (a record, or its fields by name) of a process as a message."""
    severity = int(event["severity"])
    words = {key: bytes(event[key]).rstrip(b"\0").decode(errors="replace") for key in ("code", "text", "hint")}
    return {"from": name, "severity": SEVERITIES[severity] if severity < len(SEVERITIES) else "error", **words,
            "order": int(event["monotonic_ns"]), "at_ms": int(event["local_ns"]) // 1_000_000}


def event_rings(system: str) -> Iterator[tuple[str, RingReader]]:
    """Open readers for the events of all processes, except of `system`, which repeats those of the others."""
    for name, ring in directory.rings(system):
        if ring != "events":
            continue
        try:
            reader = directory.reader(system, name, ring, often=False)
        except SegmentError:
            continue
        if reader.info.get("kind") == "system":
            reader.close()
        else:
            yield name, reader


def supervised(reader: RingReader, *columns: str) -> dict[str, dict[str, Any]]:
    """These columns of the supervisor's newest record, by instance; empty before the first record."""
    if not reader.newest():
        return {}
    names, *values = (plain(reader.field(column)) for column in ("instance", *columns))
    return {name: dict(zip(columns, row, strict=True)) for name, *row in zip(names, *values, strict=True) if name}
