"""What an owner was asked for and what became of it: a ring of its own, so that a motion can be traced to a person.

Of a stream (servo_…) only the first goal is written, and then what changes: another sender, another outcome, a reason.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

from shm.clock import local_ns, monotonic_ns
from shm.layout import shorten

if TYPE_CHECKING:
    from collections.abc import Callable

    from shm.commands import CommandRow
    from shm.origins import Origin
    from shm.ring import RingWriter

NAMES = ("command", "text", "outcome", "reason", "origin", "generation", "program", "pid", "place", "id",
         "monotonic_ns", "local_ns")
REASON = 400  # bytes


class AuditedCommand(Protocol):
    """A command, however it came."""

    command: CommandRow
    place: int
    id: int

    @property
    def text(self) -> str:
        """Its text argument."""

    @property
    def pid(self) -> int:
        """The process that sent it; 0: not known."""

    @property
    def origin(self) -> Origin:
        """The person's command it comes from."""


class Audit:
    """The writing end."""

    def __init__(self, ring: RingWriter, now_ns: Callable[[], int]) -> None:
        """`now_ns` is the process's clock."""
        self._ring, self._now_ns = ring, now_ns
        self._fields = [ring.field(name) for name in NAMES]
        self._stream: tuple[str, int, str, str] | None = None

    def write(self, received: AuditedCommand, outcome: str, reason: str) -> None:
        """One command has got an answer."""
        command = received.command
        if command.streams:
            stream = command.name, received.place, outcome, reason
            if stream == self._stream:
                return
            self._stream = stream
        elif self._stream is not None:
            self._stream = None
        origin = received.origin
        values = (command.name.encode(), received.text.encode(), outcome.encode(), shorten(reason, REASON), origin.id,
                  origin.generation, origin.program.encode(), received.pid, received.place, received.id,
                  monotonic_ns(), local_ns())
        for field, value in zip(self._fields, values, strict=True):
            field[...] = value
        self._ring.publish(max(self._now_ns(), self._ring.stamp_ns + 1))
