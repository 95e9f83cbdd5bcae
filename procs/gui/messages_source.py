"""Messages of processes: their newest status, warnings and errors, and the remedy of each arm's last error."""

from __future__ import annotations

from collections import deque
from typing import Any, Final

from trocar.procs.crtk.reported import FIELDS, message_of
from trocar.procs.document.system import SystemConfig
from trocar.procs.gui.rings import Readable, Rings, event_rings, present
from trocar.shm.system.events import ERROR, STATUS

KEPT: Final = 80
OLDER: Final = 40
"""Per process, from before the page was opened."""
LOOK_NS: Final = 200_000_000
A_LOOK: Final = 32


class MessagesSource:
    """The newest messages of all processes, oldest first."""

    def __init__(self, document: SystemConfig, rings: Rings = present, least: int = STATUS) -> None:
        """`least`: severity from which on they are kept; with ERROR, the alarms."""
        self._least = least
        self._readers = event_rings(document, rings)
        self._rows: deque[dict[str, Any]] = deque(maxlen=KEPT)
        self._robots = {(arm.io, arm.robot): arm.name for arm in document.arms}
        self._arms = {arm.name for arm in document.arms}
        self._last: dict[str, dict[str, Any]] = {}
        self._look_ns = 0
        self._shown: dict[str, Any] = {"age": 0.0, "rows": [], "remedies": {}}
        self._is_first = True

    def read(self, now_ns: int) -> dict[str, Any]:
        """`rows`, read five times a second; `remedies` by arm, however many messages followed its error."""
        if now_ns < self._look_ns:
            return self._shown
        self._look_ns = now_ns + LOOK_NS
        found: list[dict[str, Any]] = []
        for name, reader in self._readers:
            events = self._before(reader) if self._is_first else self._new(reader)
            found += [self._message(name, event) for event in events]
        self._is_first = False
        if found:
            self._rows.extend(sorted(found, key=lambda row: row["order"]))
            remedies = {arm: row["hint"] for arm, row in self._last.items()}
            self._shown = {"age": 0.0, "rows": list(self._rows), "remedies": remedies}
        return self._shown

    def _before(self, reader: Readable) -> list[Any]:
        """From before the page was opened: the newest messages, and all errors still kept."""
        kept = reader.last(reader.depth)
        while reader.next():
            pass
        newest = len(kept) - OLDER
        return [row for i, row in enumerate(kept) if row["severity"] >= (self._least if i >= newest else ERROR)]

    def _new(self, reader: Readable) -> list[Any]:
        found = []
        for _ in range(A_LOOK):
            if not reader.next():
                break
            if int(reader.field("severity")) >= self._least:
                found.append({key: reader.field(key)[()] for key in (*FIELDS, "component")})
        return found

    def _message(self, name: str, event: Any) -> dict[str, Any]:
        """An event as a message; an error of an arm, or of its robot in its io, is that arm's last one."""
        row = message_of(name, event)
        component = bytes(event["component"]).rstrip(b"\0").decode(errors="replace")
        arm = name if name in self._arms else self._robots.get((name, component))
        is_error = row["severity"] == "error" and row["hint"]
        if arm is not None and is_error and row["order"] >= self._last.get(arm, row)["order"]:
            self._last[arm] = row
        return row

    def close(self) -> None:
        """Unmap."""
        for _, reader in self._readers:
            reader.close()
