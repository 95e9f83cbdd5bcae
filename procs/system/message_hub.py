"""The message hub: repeats errors, warnings and status of all processes in one place, and beeps for errors."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

from trocar.shm.ring.ring import RingReader
from trocar.shm.system.events import ERROR, STATUS, WARNING, Events

BEEP_NS: Final = 2_000_000_000
AT_MOST: Final = 32  # events of one process a cycle; the rest in the next
KINDS: Final = {STATUS: "status", WARNING: "warning", ERROR: "error"}


class MessageSource:
    """One process as a source of messages."""

    def __init__(self, name: str, ring: RingReader) -> None:
        """Repeat its messages from the next event on."""
        self.name, self.ring = name, ring
        names = ("severity", "code", "axis", "board", "value", "limit", "text", "hint")
        self._fields = {key: ring.field(key) for key in names}

    def repeat(self, events: Events) -> int:
        """Write the present event again as one of the system; returns its severity."""
        severity = int(self._fields["severity"])
        if severity in KINDS:
            code, text, hint = (self._fields[key].item().decode(errors="replace") for key in ("code", "text", "hint"))
            events.emit(KINDS[severity], text, severity=severity, code=code, component=self.name,
                        axis=int(self._fields["axis"]), value=float(self._fields["value"]),
                        limit=float(self._fields["limit"]), board=int(self._fields["board"]), hint=hint,
                        repeated=True)
        return severity


class MessageHub:
    """Repeats the messages of all sources."""

    def __init__(self, sources: Sequence[MessageSource], events: Events, beep: Callable[[], None]) -> None:
        """`beep` is called for errors, at most every two seconds."""
        self._sources, self._events, self._beep = sources, events, beep
        self._quiet_until_ns = 0
        self.errors = self.warnings = 0

    def step(self, now_ns: int) -> None:
        """Repeat new messages."""
        before = self.errors
        for source in self._sources:
            for _ in range(AT_MOST):
                if not source.ring.next():
                    break
                severity = source.repeat(self._events)
                self.errors += severity == ERROR
                self.warnings += severity == WARNING
        if self.errors > before and now_ns >= self._quiet_until_ns:
            self._quiet_until_ns = now_ns + BEEP_NS
            self._beep()
