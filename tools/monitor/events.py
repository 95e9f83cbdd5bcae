"""The page of events: what the processes report, the newest last, chosen by severity, process and words."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

from trocar.procs.crtk.plain import plain
from trocar.procs.crtk.reported import event_rings, message_of
from trocar.shm.ring.ring import RingReader
from trocar.shm.system.events import SEVERITIES, STATUS
from trocar.tools.inspect.messages import kind_of, text_of, time_of_day

KEPT = 2000
A_LOOK = 500
"""Events of one process that one look takes in."""


@dataclass(frozen=True, slots=True)
class EventRow:
    """One event; `severity` is "" where it is no message."""

    order: int
    at: str
    who: str
    severity: str
    what: str
    text: str
    hint: str
    data: dict[str, Any]


class EventsData:
    """The events of all processes, those from before too."""

    def __init__(self, system: str) -> None:
        self._rings = list(event_rings(system))
        self._rows: deque[EventRow] = deque(maxlen=KEPT)
        self.lost = 0
        """Overwritten before they were read."""
        for _, reader in self._rings:
            reader.rewind(KEPT)
        self._take(KEPT)

    @property
    def names(self) -> list[str]:
        """The processes that can report something."""
        return sorted(name for name, _ in self._rings)

    def rows(self) -> list[EventRow]:
        """All that are known, the oldest first."""
        self._take(A_LOOK)
        return list(self._rows)

    def _take(self, most: int) -> None:
        found = [_row(name, row) for name, reader in self._rings for row in rows_next(reader, most)]
        self.lost = sum(reader.lost for _, reader in self._rings)
        self._rows.extend(sorted(found, key=lambda row: row.order))

    def close(self) -> None:
        """Unmap."""
        for _, reader in self._rings:
            reader.close()


def rows_next(reader: RingReader, most: int) -> Iterator[dict[str, Any]]:
    """So many of the next records of a ring at most, in order."""
    for _ in range(most):
        if not reader.next():
            return
        yield {key: reader.field(key)[()] for key in reader.dtype.names or ()}


def _row(name: str, event: dict[str, Any]) -> EventRow:
    data = {key: plain(value) for key, value in event.items()}
    message = message_of(name, event)
    return EventRow(message["order"], time_of_day(int(data["local_ns"])), name, str(message["severity"]), kind_of(data),
                    text_of({**data, "hint": ""}), str(message["hint"]), data)


def chosen(rows: Iterable[EventRow], severity: str = "", who: str = "", words: str = "") -> list[EventRow]:
    """Those of this severity or a worse one ("": all, also what is no message), of one process, with these words."""
    least = SEVERITIES.index(severity) if severity in SEVERITIES else 0
    sought = words.casefold()
    return [row for row in rows
            if (not least or (row.severity in SEVERITIES and SEVERITIES.index(row.severity) >= max(STATUS, least)))
            and who in ("", row.who)
            and sought in f"{row.who} {row.what} {row.text} {row.hint}".casefold()]
