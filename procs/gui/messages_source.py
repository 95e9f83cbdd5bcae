"""What processes have to say: their newest status, warnings and errors."""

from __future__ import annotations

import contextlib
from collections import deque
from typing import Any, Final

from procs.document.system import SystemConfig
from shm import directory
from shm.events import SEVERITIES, STATUS
from shm.ring import RingReader
from shm.segment import SegmentError

KEPT: Final = 80
OLDER: Final = 40
"""Of each process, from before somebody looked."""
LOOK_NS: Final = 200_000_000
A_LOOK: Final = 32


class MessagesSource:
    """The newest messages of all processes, oldest first."""

    def __init__(self, document: SystemConfig) -> None:
        self._readers: list[tuple[str, RingReader]] = []
        for row in document.processes:
            if row.kind != "system":  # it repeats those of the others
                with contextlib.suppress(SegmentError):
                    self._readers.append((row.name, directory.reader(document.name, row.name, "events", often=False)))
        self._rows: deque[dict[str, Any]] = deque(maxlen=KEPT)
        self._look_ns = 0
        self._shown: dict[str, Any] = {"age": 0.0, "rows": []}
        self._is_first = True

    def read(self, now_ns: int) -> dict[str, Any]:
        """`rows`, looked for five times a second."""
        if now_ns < self._look_ns:
            return self._shown
        self._look_ns = now_ns + LOOK_NS
        found: list[dict[str, Any]] = []
        for name, reader in self._readers:
            if self._is_first:
                found += [_row(name, row) for row in reader.last(OLDER) if row["severity"] >= STATUS]
                while reader.next():
                    pass
            else:
                for _ in range(A_LOOK):
                    if not reader.next():
                        break
                    if int(reader.field("severity")) >= STATUS:
                        found.append(_row(name, {key: reader.field(key)[()] for key in FIELDS}))
        self._is_first = False
        if found:
            self._rows.extend(sorted(found, key=lambda row: row["order"]))
            self._shown = {"age": 0.0, "rows": list(self._rows)}
        return self._shown

    def close(self) -> None:
        """Unmap."""
        for _, reader in self._readers:
            reader.close()


FIELDS: Final = ("severity", "code", "text", "hint", "monotonic_ns", "local_ns")


def _row(name: str, event: Any) -> dict[str, Any]:
    severity = int(event["severity"])
    words = {key: bytes(event[key]).decode(errors="replace") for key in ("code", "text", "hint")}
    return {"from": name, "severity": SEVERITIES[severity] if severity < len(SEVERITIES) else "error", **words,
            "order": int(event["monotonic_ns"]), "at_ms": int(event["local_ns"]) // 1_000_000}
