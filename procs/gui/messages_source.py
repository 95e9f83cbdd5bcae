"""What processes have to say: their newest status, warnings and errors."""

from __future__ import annotations

from collections import deque
from typing import Any, Final

from procs.crtk.reported import FIELDS, event_rings, message_of
from procs.document.system import SystemConfig
from shm.events import STATUS

KEPT: Final = 80
OLDER: Final = 40
"""Of each process, from before somebody looked."""
LOOK_NS: Final = 200_000_000
A_LOOK: Final = 32


class MessagesSource:
    """The newest messages of all processes, oldest first."""

    def __init__(self, document: SystemConfig) -> None:
        named = {row.name for row in document.processes}
        self._readers = []
        for name, reader in event_rings(document.name):
            if name in named:
                self._readers.append((name, reader))
            else:
                reader.close()
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
                found += [message_of(name, row) for row in reader.last(OLDER) if row["severity"] >= STATUS]
                while reader.next():
                    pass
            else:
                for _ in range(A_LOOK):
                    if not reader.next():
                        break
                    if int(reader.field("severity")) >= STATUS:
                        found.append(message_of(name, {key: reader.field(key)[()] for key in FIELDS}))
        self._is_first = False
        if found:
            self._rows.extend(sorted(found, key=lambda row: row["order"]))
            self._shown = {"age": 0.0, "rows": list(self._rows)}
        return self._shown

    def close(self) -> None:
        """Unmap."""
        for _, reader in self._readers:
            reader.close()
