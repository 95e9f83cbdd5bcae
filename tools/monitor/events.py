"""The pages of events and commands: reports of the processes, and commands to them, from their rings."""

from __future__ import annotations

import contextlib
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from trocar.procs.crtk.plain import plain
from trocar.procs.crtk.reported import event_rings, message_of
from trocar.shm.commands import COMMANDS
from trocar.shm.memory.segment import SegmentError
from trocar.shm.ring.ring import RingReader
from trocar.shm.system import directory
from trocar.shm.system.events import SEVERITIES, STATUS
from trocar.tools.inspect.messages import AUDIT, kind_of, text_of, time_of_day
from trocar.tools.inspect.processes import ProcessStatus

STREAMS = frozenset(row.name for rows in COMMANDS.values() for row in rows if row.stream)
ACCEPTED, UNDER_WAY = "accepted", "under way"


R = TypeVar("R", bound="EventRow | AskedRow")


class RingRows(Generic[R]):
    """Rows from the records of a ring of all processes, earlier ones included."""

    def __init__(self, rings: Iterable[tuple[str, RingReader]], made: Callable[[str, dict[str, Any]], R], kept: int,
                 a_look: int) -> None:
        """`made`: the row of a record of one process; `a_look`: records of one process that one look takes in."""
        self._rings, self._made, self._a_look = list(rings), made, a_look
        self._rows: deque[R] = deque(maxlen=kept)
        for _, reader in self._rings:
            reader.rewind(kept)
        self._take(kept)

    @property
    def names(self) -> list[str]:
        """The processes with such a ring."""
        return sorted(name for name, _ in self._rings)

    @property
    def lost(self) -> int:
        """Records that were overwritten before they were read."""
        return sum(reader.lost for _, reader in self._rings)

    def rows(self) -> list[R]:
        """All that are known, the oldest first."""
        self._take(self._a_look)
        return list(self._rows)

    def _take(self, most: int) -> None:
        found = []
        for name, reader in self._rings:
            for _ in range(most):
                if not reader.next():
                    break
                found.append(self._made(name, {key: reader.field(key)[()] for key in reader.dtype.names or ()}))
        self._rows.extend(sorted(found, key=lambda row: row.order))

    def close(self) -> None:
        """Unmap."""
        for _, reader in self._rings:
            reader.close()


@dataclass(frozen=True, slots=True)
class EventRow:
    """One event; `severity` is "" if it is not a message."""

    order: int
    at: str
    who: str
    severity: str
    what: str
    text: str
    hint: str
    data: dict[str, Any]


def events_of(system: str) -> RingRows[EventRow]:
    """The events of all processes."""
    return RingRows(event_rings(system), _event_row, kept=2000, a_look=500)


def _event_row(name: str, event: dict[str, Any]) -> EventRow:
    data = {key: plain(value) for key, value in event.items()}
    message = message_of(name, event)
    return EventRow(message["order"], time_of_day(int(data["local_ns"])), name, str(message["severity"]), kind_of(data),
                    text_of({**data, "hint": ""}), str(message["hint"]), data)


def chosen(rows: Iterable[EventRow], severity: str, who: str = "") -> list[EventRow]:
    """Those of at least this severity ("": all, including events without one), of one process ("": of all)."""
    least = SEVERITIES.index(severity) if severity in SEVERITIES else 0
    return [row for row in rows
            if (not least or (row.severity in SEVERITIES and SEVERITIES.index(row.severity) >= max(STATUS, least)))
            and who in ("", row.who)]


@dataclass(frozen=True, slots=True)
class AskedRow:
    """One command and its last known outcome. `key`: its process, place and number."""

    key: tuple[str, int, int]
    stamp_ns: int
    order: int
    at: str
    who: str
    command: str
    outcome: str
    reason: str
    whose: str
    is_stream: bool

    @property
    def cells(self) -> list[str]:
        """In the order of the page's columns."""
        return [self.at, self.who, self.command, self.outcome, self.whose, self.reason]


def commands_of(system: str) -> RingRows[AskedRow]:
    """Commands to all processes, from their audit rings."""
    return RingRows(_audit_rings(system), _asked_row, kept=1000, a_look=1000)


def _audit_rings(system: str) -> Iterator[tuple[str, RingReader]]:
    for name, topic in directory.rings(system):
        if topic == AUDIT:
            with contextlib.suppress(SegmentError):
                yield name, directory.reader(system, name, AUDIT, often=False)


def _asked_row(name: str, record: dict[str, Any]) -> AskedRow:
    row = {key: plain(value) for key, value in record.items()}
    whose = str(row["program"]) or "a program" if row["origin"] else "no operator"
    through = f", pid {row['pid']}" if row["pid"] else ""
    return AskedRow((name, int(row["place"]), int(row["id"])), int(row["stamp_ns"]), int(row["monotonic_ns"]),
                    time_of_day(int(row["local_ns"])), name, f"{row['command']} {row['text']}".rstrip(),
                    str(row["outcome"]), str(row["reason"]), f"{whose}{through}", row["command"] in STREAMS)


def under_way(rows: Sequence[AskedRow], processes: Iterable[ProcessStatus]) -> list[AskedRow]:
    """Accepted commands that are not done, refused or failed yet, in a process that is alive and has not restarted.

    Of a stream of goals only the first is recorded: it counts until the process gets another command.
    """
    since = {one.name: max((past.stamp_ns for past in one.endings), default=0) for one in processes
             if one.problem != "dead" and one.state == "RUNNING"}
    last = {row.key: row for row in rows}
    newest = {row.who: row.key for row in rows}
    return [row for row in last.values()
            if row.outcome == ACCEPTED and row.stamp_ns > since.get(row.who, row.stamp_ns)
            and (not row.is_stream or newest[row.who] == row.key)]
