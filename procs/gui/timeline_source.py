"""The times to which a page may go back: faults, errors and warnings, with the recordings of faults."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from concurrent.futures import Future
from typing import Any, Final

from trocar.procs.crtk.reported import FIELDS, message_of
from trocar.procs.document.system import SystemConfig
from trocar.procs.gui.past import Past
from trocar.procs.gui.rings import Readable, event_rings, present
from trocar.procs.tables import codes
from trocar.shm.system.events import WARNING

LOOK_NS: Final = 200_000_000
FILES_NS: Final = 2_000_000_000
A_LOOK: Final = 32
MARKS: Final = 60
NEAR_MS: Final = 1000
"""Largest time between an error and the FAULT that it caused."""
RECORDED_MS: Final = 2600
"""Largest time from a fault to that in the name of its recording; faults in quick succession share one."""
SEEN_MS: Final = 400
"""Usual time between a fault and that in the name of its recording."""
IN_FAULT: Final = b"FAULT"
EVENT_FIELDS: Final = (*FIELDS, "component", "event", "state", "stamp_ns")


class TimelineSource:
    """`marks`, oldest first, and `begin`, the time back to which everything is recorded."""

    def __init__(self, document: SystemConfig, past: Past) -> None:
        self._past, self._readers = past, event_rings(document, present)
        self._robots = {(arm.io, arm.robot): arm.name for arm in document.arms}
        self._marks: deque[dict[str, Any]] = deque(maxlen=MARKS)
        self._faults: deque[dict[str, Any]] = deque(maxlen=MARKS)
        self._states: dict[str, bytes] = {}
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
        if now_ns >= self._files_ns and (self._looked is None or self._looked.done()):
            self._files_ns = now_ns + FILES_NS
            self._looked = self._past.look()
        key = self._past.begin_ns, tuple(self._past.faults), len(self._marks), *(
            rows[-1]["at"] for rows in (self._marks, self._faults) if rows)
        if key != self._key:
            self._key = key
            self._shown = {"age": 0.0, "begin": self._past.begin_ns // 1_000_000, "marks": self._with_files()}
        return self._shown

    def _take(self, events: Sequence[tuple[str, Any]]) -> None:
        for name, event in sorted(events, key=lambda row: int(row[1]["monotonic_ns"])):
            at, t = int(event["local_ns"]) // 1_000_000, round(int(event["stamp_ns"]) * 1e-9, 4)
            if bytes(event["event"]) == b"operating_state":
                state, before = bytes(event["state"]), self._states.get(name)
                self._states[name] = state
                if state == IN_FAULT != before:
                    self._faults.append({"at": at, "t": t, "kind": "fault", "from": name,
                                         "text": f"{name} is in FAULT"})
            elif int(event["severity"]) >= WARNING and bytes(event["code"]) != codes.FAULT_RECORDED.code.encode():
                row = message_of(name, event)
                component = bytes(event["component"]).rstrip(b"\0").decode(errors="replace")
                self._marks.append({"at": at, "t": t, "kind": row["severity"], "text": row["text"],
                                    "from": self._robots.get((name, component), name)})

    def _with_files(self) -> list[dict[str, Any]]:
        """All marks: a fault with the error that caused it, and with its recording."""
        marks = list(self._marks)
        faults = []
        for fault in self._faults:
            near = [mark for mark in marks if mark["kind"] == "error" and mark["from"] == fault["from"]
                    and abs(mark["at"] - fault["at"]) <= NEAR_MS]
            faults.append(fault | {"text": near[-1]["text"]} if near else fault)
            marks = [mark for mark in marks if mark not in near]
        for file in self._past.faults:
            recorded = {"file": file.name, "size": file.size}
            at = file.at_ns // 1_000_000
            mine = [fault for fault in faults if 0 <= at - fault["at"] <= RECORDED_MS]
            for fault in mine:
                fault.update(recorded)
            if not mine:
                faults.append({"at": at - SEEN_MS, "kind": "fault", "from": file.instance, "text": file.reason}
                              | recorded)
        return sorted(marks + faults, key=lambda mark: int(mark["at"]))[-MARKS:]

    def close(self) -> None:
        """Unmap."""
        for _, reader in self._readers:
            reader.close()


def _new(reader: Readable) -> list[Any]:
    found: list[Any] = []
    while len(found) < A_LOOK and reader.next():
        found.append({name: reader.field(name)[()] for name in EVENT_FIELDS})
    return found
