"""The page of commands: what is being carried out, for whom, and what was asked for before."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from trocar.procs.crtk.plain import plain
from trocar.shm.commands import COMMANDS
from trocar.shm.memory.segment import SegmentError
from trocar.shm.ring.ring import RingReader
from trocar.shm.system import directory
from trocar.tools.inspect.asked import AUDIT
from trocar.tools.inspect.messages import time_of_day
from trocar.tools.inspect.processes import ProcessStatus
from trocar.tools.monitor.events import rows_next

KEPT = 1000
STREAMS = frozenset(row.name for rows in COMMANDS.values() for row in rows if row.stream)
ACCEPTED = "accepted"


@dataclass(frozen=True, slots=True)
class AskedRow:
    """One command and what became of it, as it was last heard. `key`: its process, place and number."""

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


class CommandsData:
    """What all processes were asked for, from their audit rings."""

    def __init__(self, system: str) -> None:
        self._rings: list[tuple[str, RingReader]] = []
        self._rows: deque[AskedRow] = deque(maxlen=KEPT)
        for name, topic in directory.rings(system):
            if topic == AUDIT:
                try:
                    self._rings.append((name, directory.reader(system, name, AUDIT, often=False)))
                except SegmentError:
                    continue
        for _, reader in self._rings:
            reader.rewind(KEPT)

    def rows(self) -> list[AskedRow]:
        """All that is known, the oldest first."""
        found = [_row(name, row) for name, reader in self._rings for row in rows_next(reader, KEPT)]
        self._rows.extend(sorted(found, key=lambda row: row.order))
        return list(self._rows)

    def close(self) -> None:
        """Unmap."""
        for _, reader in self._rings:
            reader.close()


def _row(name: str, record: Mapping[str, object]) -> AskedRow:
    row = {key: plain(value) for key, value in record.items()}
    whose = str(row["program"]) or "a program" if row["origin"] else "nobody"
    through = f", pid {row['pid']}" if row["pid"] else ""
    return AskedRow((name, int(row["place"]), int(row["id"])), int(row["stamp_ns"]), int(row["monotonic_ns"]),
                    time_of_day(int(row["local_ns"])), name, f"{row['command']} {row['text']}".rstrip(),
                    str(row["outcome"]), str(row["reason"]), f"{whose}{through}", row["command"] in STREAMS)


def under_way(rows: Sequence[AskedRow], processes: Iterable[ProcessStatus]) -> list[AskedRow]:
    """What was accepted and is neither done, refused nor failed, by a process that lives and is still the same one.

    Of a stream of goals only the first is recorded: it counts until the process is asked for something else.
    """
    since = {one.name: max((past.stamp_ns for past in one.endings), default=0) for one in processes
             if one.problem != "dead" and one.state == "RUNNING"}
    last = {row.key: row for row in rows}
    newest = {row.who: row.key for row in rows}
    return [row for row in last.values()
            if row.outcome == ACCEPTED and row.stamp_ns > since.get(row.who, row.stamp_ns)
            and (not row.is_stream or newest[row.who] == row.key)]


def sought(rows: Iterable[AskedRow], words: str) -> list[AskedRow]:
    """Those with these words."""
    return [row for row in rows if words.casefold() in " ".join(row.cells).casefold()]
