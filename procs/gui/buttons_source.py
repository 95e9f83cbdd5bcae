"""When each button was last pressed, released or clicked: from the events of ios and of third-party programs."""

from __future__ import annotations

import contextlib
from typing import Any, Final

from trocar.procs.document.system import SystemConfig
from trocar.procs.gui.rings import Readable, Rings, present
from trocar.shm.memory.segment import SegmentError

A_LOOK: Final = 64
"""Events of a process that are read in a tick."""


class ButtonsSource:
    """`last` of each input by owner, in the order of its record: its last event and time; empty: no event yet."""

    def __init__(self, document: SystemConfig, rings: Rings = present) -> None:
        self._readers: list[tuple[str, Readable]] = []
        self._places: dict[tuple[str, str], dict[str, Any]] = {}
        self._last: dict[str, list[dict[str, Any]]] = {}
        for owner in (*(io.name for io in document.ios), *(row.name for row in document.third_parties)):
            names = document.inputs(owner)
            self._last[owner] = [{} for _ in names]
            self._places |= {(owner, name): row for name, row in zip(names, self._last[owner], strict=True)}
            if names:
                with contextlib.suppress(SegmentError):
                    self._readers.append((owner, rings(document.name, owner, "events", None)))
        for owner, reader in self._readers:
            for event in reader.last(reader.depth):
                self._take(owner, event)

    def read(self, now_ns: int) -> dict[str, Any]:
        """The last events."""
        for owner, reader in self._readers:
            for _ in range(A_LOOK):
                if not reader.next():
                    break
                self._take(owner, {name: reader.field(name)[()] for name in ("event", "code", "component", "local_ns")})
        return {"age": 0.0, "last": self._last}

    def _take(self, owner: str, event: Any) -> None:
        if bytes(event["event"]) == b"button":
            place = self._places.get((owner, bytes(event["component"]).decode(errors="replace")))
            if place is not None:
                place["what"], place["at_ms"] = bytes(event["code"]).decode(), int(event["local_ns"]) // 1_000_000

    def close(self) -> None:
        """Unmap."""
        for _, reader in self._readers:
            reader.close()
