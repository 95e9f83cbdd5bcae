"""The times to which a page may go back: faults, errors and warnings, with the recordings of faults."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from concurrent.futures import Future
from contextlib import suppress
from typing import Any, Final

from trocar.procs.crtk.reported import FIELDS, message_of
from trocar.procs.document.system import SystemConfig
from trocar.procs.gui.past import Past
from trocar.procs.gui.rings import Readable, event_rings, present
from trocar.procs.tables import codes
from trocar.shm.memory.segment import SegmentError
from trocar.shm.ring.ring import RingReader
from trocar.shm.system.events import WARNING

LOOK_NS: Final = 200_000_000
FILES_NS: Final = 2_000_000_000
A_LOOK: Final = 32
MARKS: Final = 60
"""Of faults; as many of errors, and of warnings."""
NEAR_MS: Final = 1000
"""Largest time between an error and the FAULT that it caused."""
RECORDED_MS: Final = 2600
"""Largest time from a fault to that in the name of its recording; faults in quick succession share one."""
SEEN_MS: Final = 400
"""Usual time between a fault and that in the name of its recording."""
IN_FAULT: Final = b"FAULT"
OPERATED: Final = frozenset({"arm", "suj", "third_party"})
"""Kinds whose state has an operating state."""
EVENT_FIELDS: Final = (*FIELDS, "component", "event", "state", "stamp_ns")


class TimelineSource:
    """`marks`, oldest first; `begin`, the time back to which everything is recorded; `now`, what is in FAULT."""

    def __init__(self, document: SystemConfig, past: Past) -> None:
        self._past, self._readers = past, event_rings(document, present)
        self._robots = {(arm.io, arm.robot): arm.name for arm in document.arms}
        self._marks: dict[str, deque[dict[str, Any]]] = {kind: deque(maxlen=MARKS)
                                                         for kind in ("fault", "error", "warning")}
        self._states: dict[str, bytes] = {}
        self._present: list[tuple[str, RingReader]] = []
        for row in document.processes:
            if row.kind in OPERATED:
                with suppress(SegmentError):
                    self._present.append((row.name, present(document.name, row.name, "state", row.kind)))
        self._now: list[str] = []
        self._events = 0
        self._look_ns = self._files_ns = 0
        self._looked: Future[None] | None = None
        self._key: object = None
        self._shown: dict[str, Any] = {}
        self._take([(name, event) for name, reader in self._readers for event in reader.last(reader.depth)])

    def read(self, now_ns: int) -> dict[str, Any]:
        """Times are times of day in ms; `t`: the system's time, s, in this run."""
        if now_ns >= self._look_ns:
            self._look_ns = now_ns + LOOK_NS
            self._take([(name, event) for name, reader in self._readers for event in _new(reader)])
            self._now = [name for name, reader in self._present
                         if reader.newest() and not reader.gone and reader.field("state").item() == IN_FAULT]
        if now_ns >= self._files_ns and (self._looked is None or self._looked.done()):
            self._files_ns = now_ns + FILES_NS
            self._looked = self._past.look()
        key = self._past.begin_ns, tuple(self._past.faults), self._events, tuple(self._now)
        if key != self._key:
            self._key = key
            self._shown = {"age": 0.0, "begin": self._past.begin_ns // 1_000_000, "marks": self._with_files(),
                           "now": self._now}
        return self._shown

    def _take(self, events: Sequence[tuple[str, Any]]) -> None:
        for name, event in sorted(events, key=lambda row: int(row[1]["monotonic_ns"])):
            self._events += 1
            at, t = int(event["local_ns"]) // 1_000_000, round(int(event["stamp_ns"]) * 1e-9, 4)
            if bytes(event["event"]) == b"operating_state":
                state, before = bytes(event["state"]), self._states.get(name)
                self._states[name] = state
                if state == IN_FAULT != before:
                    self._marks["fault"].append({"at": at, "t": t, "kind": "fault", "from": name,
                                                 "text": f"{name} is in FAULT"})
            elif int(event["severity"]) >= WARNING and bytes(event["code"]) != codes.FAULT_RECORDED.code.encode():
                row = message_of(name, event)
                component = bytes(event["component"]).rstrip(b"\0").decode(errors="replace")
                self._marks[row["severity"]].append({"at": at, "t": t, "kind": row["severity"], "text": row["text"],
                                                     "from": self._robots.get((name, component), name)})

    def _with_files(self) -> list[dict[str, Any]]:
        """All marks: a fault with the error that caused it, and with its recording."""
        errors, faults = list(self._marks["error"]), list[dict[str, Any]]()
        for fault in self._marks["fault"]:
            near = [mark for mark in errors if mark["from"] == fault["from"]
                    and abs(mark["at"] - fault["at"]) <= NEAR_MS]
            faults.append(fault | ({"text": near[-1]["text"]} if near else {}))
            errors = [mark for mark in errors if mark not in near]
        for file in self._past.faults:
            recorded = {"file": file.name, "size": file.size}
            at = file.at_ns // 1_000_000
            mine = [fault for fault in faults if 0 <= at - fault["at"] <= RECORDED_MS]
            for fault in mine:
                fault.update(recorded)
            if not mine:
                faults.append({"at": at - SEEN_MS, "kind": "fault", "from": file.instance, "text": file.reason}
                              | recorded)
        return sorted([*self._marks["warning"], *errors, *_newest(faults)], key=_at)

    def close(self) -> None:
        """Unmap."""
        for _, reader in (*self._readers, *self._present):
            reader.close()


def _at(mark: dict[str, Any]) -> int:
    return int(mark["at"])


def _newest(marks: list[dict[str, Any]]) -> list[dict[str, Any]]:
    return sorted(marks, key=_at)[-MARKS:]


def _new(reader: Readable) -> list[Any]:
    found: list[Any] = []
    while len(found) < A_LOOK and reader.next():
        found.append({name: reader.field(name)[()] for name in EVENT_FIELDS})
    return found
