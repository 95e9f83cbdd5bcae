"""The commands an owner received and their outcomes, in a ring of their own: every motion can be traced to a person.

For a stream (servo_…) only the first goal is written, then each change: another sender, another outcome, a reason. A
sender is a mailbox place plus a person's command (shm/mailbox/origins.py): one process may stream for several. The jaw
has its own stream beside the arm's. In lock-step all goals from a person's program are written, so that a recording
contains everything needed to repeat a run.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from trocar.shm.mailbox.origins import is_direct
from trocar.shm.memory.layout import shorten
from trocar.shm.time.clock import local_ns, monotonic_ns

if TYPE_CHECKING:
    from collections.abc import Callable

    from trocar.shm.mailbox.received import Request
    from trocar.shm.ring.ring import RingWriter

NAMES = ("command", "text", "outcome", "reason", "origin", "generation", "program", "sender", "pid", "place", "peer",
         "id", "monotonic_ns", "local_ns")
REASON = 400  # bytes
JAW = "jaw"


class Audit:
    """The writing end."""

    def __init__(self, ring: RingWriter, now_ns: Callable[[], int], every: bool = False) -> None:
        """`now_ns` is the process's clock; `every`: each goal of a person's stream is written."""
        self._ring, self._now_ns, self._every = ring, now_ns, every
        self._count, self._values = ring.field("count"), ring.field("values")
        self._fields = [ring.field(name) for name in NAMES]
        self._streams: dict[bool, tuple[str, int, int, str, str]] = {}  # of the jaw, and of all else

    def write(self, received: Request, outcome: str, reason: str) -> None:
        """One command has got an answer."""
        command = received.command
        if command.stream and not (self._every and is_direct(received.origin.id, received.holder.pid)):
            part = command.stream == JAW
            stream = command.name, received.place, received.origin.id, outcome, reason
            if stream == self._streams.get(part):
                return
            self._streams[part] = stream
        elif self._streams:
            self._streams.clear()
        origin, holder = received.origin, received.holder
        values = (command.name.encode(), received.text.encode(), outcome.encode(), shorten(reason, REASON), origin.id,
                  origin.generation, origin.program.encode(), holder.program.encode(), holder.pid, received.place,
                  received.sender.peer, received.id, monotonic_ns(), local_ns())
        for field, value in zip(self._fields, values, strict=True):
            field[...] = value
        used = received.values[: len(self._values)]
        self._count[...] = len(used)
        self._values[: len(used)], self._values[len(used) :] = used, 0.0
        self._ring.publish(max(self._now_ns(), self._ring.stamp_ns + 1))
