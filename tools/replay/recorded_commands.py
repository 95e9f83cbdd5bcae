"""Commands of people in a recording: the audit rings, without commands between processes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from trocar.procs.recordings.reading import RecordingReader
from trocar.shm.commands import COMMANDS
from trocar.shm.mailbox.origins import is_direct
from trocar.tools.analysis.choosing import TIMED
from trocar.tools.output.errors import Problem

AUDIT: Final = "audit"
STATES: Final = "supervisor/state"
BURST_NS: Final = 16
"""Stamps of answers in one cycle are at most this far apart: a ring uses no stamp twice."""


@dataclass(frozen=True, slots=True)
class RecordedCommand:
    """One command of a person: time of receipt by its owner (system time), place, and the owner's answer."""

    instance: str
    kind: str
    instant_ns: int
    name: str
    values: tuple[float, ...]
    text: str
    origin: int
    generation: int
    program: str
    place: int
    id: int
    pid: int
    outcome: str
    peer: int = 0

    @property
    def streams(self) -> bool:
        """Whether the command is a goal of a stream."""
        return any(row.name == self.name and row.stream for row in COMMANDS.get(self.kind, ()))


def commands_of(recording: RecordingReader) -> list[RecordedCommand]:
    """All commands of persons, in the order of their instants. Problem if the recording has no numbers of commands."""
    ours, found = _processes(recording), []
    for topic in recording.record_topics:
        row = recording.topics[topic]
        if row.ring == AUDIT:
            rows = recording.records(topic).rows
            if "values" not in (rows.dtype.names or ()):
                raise Problem(f"{topic} has no numbers of commands: it was recorded by an older version")
            found += [each for each in _taken(row.instance, row.kind, rows) if _is_from_outside(each, ours)]
    return sorted(found, key=lambda each: each.instant_ns)


def _taken(instance: str, kind: str, rows: NDArray[Any]) -> Iterator[RecordedCommand]:
    """Commands of one ring as they were taken: the first of the records that each has."""
    seen: set[tuple[int, int]] = set()
    before = instant = -BURST_NS
    for row in rows:
        stamp = int(row["stamp_ns"])
        instant, before = (instant if stamp - before <= BURST_NS else stamp), stamp
        key = int(row["place"]), int(row["id"])
        if key in seen and int(row["pid"]):
            continue
        seen.add(key)
        count = min(int(row["count"]), len(row["values"]))
        yield RecordedCommand(
            instance, kind, instant, _text(row["command"]), tuple(row["values"][:count].tolist()), _text(row["text"]),
            int(row["origin"]), int(row["generation"]), _text(row["program"]), *key, int(row["pid"]),
            _text(row["outcome"]), int(row["peer"]) if "peer" in (rows.dtype.names or ()) else 0)


def _text(value: np.bytes_) -> str:
    return bytes(value).decode(errors="replace")


def _processes(recording: RecordingReader) -> set[int] | None:
    """The processes of the system that simulated time waits for; None if the recording does not contain them."""
    if STATES not in recording.record_topics:
        return None
    rows = recording.records(STATES).rows
    if not {"kind", "pid"} <= set(rows.dtype.names or ()) or not len(rows):
        return None
    known = np.isin(rows["kind"], [kind.encode() for kind in sorted(TIMED)])
    return {int(pid) for pid in rows["pid"][known] if pid}


def _is_from_outside(command: RecordedCommand, ours: set[int] | None) -> bool:
    """Whether no process of the system sent the command: otherwise that process will send it again by itself."""
    if not command.pid:
        return False
    return is_direct(command.origin, command.pid) if ours is None else command.pid not in ours
