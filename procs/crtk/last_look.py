"""What a bridge knew when it last looked for messages: what it finds now may have been sent at any time since then.

A message that waited while the bridge was stalled, or starting, counts as sent at that earlier look. So it does not
overtake a stop, an operator's power-off or a fault of the time in between, and is refused when it is late.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Final

from trocar.shm.mailbox.client import Client
from trocar.shm.time.clock import boottime_ns, monotonic_ns

FIRST_NS: Final = 300_000_000
"""In this time after its start, a bridge accepts the connections that were made before."""


class LastLook:
    """Time and fault generation of the look before the present one."""

    def __init__(self, generation: Callable[[], int], begun_ns: int = 0) -> None:
        """`generation` returns the number of faults so far. `begun_ns`: since when messages may have waited for the
        first look, on CLOCK_MONOTONIC; 0: since now.
        """
        self._generation = generation
        self._sent_ns, self._seen = self._next = begun_ns or monotonic_ns(), generation()

    def look(self) -> None:
        """Call it right before each look for messages."""
        self._sent_ns, self._seen = self._next
        self._next = monotonic_ns(), self._generation()

    def mark(self, client: Client) -> None:
        """The next commands of this handle come from messages of the present look."""
        client.sent_ns, client.seen = self._sent_ns, self._seen


class FirstMessages:
    """For a bridge whose first client starts it: what this client sends at once waits until the bridge runs."""

    def __init__(self, generation: Callable[[], int]) -> None:
        self._start, self._until_ns = LastLook(generation, started_ns()), monotonic_ns() + FIRST_NS

    @property
    def may_have_waited(self) -> bool:
        """Whether a connection that is accepted now may have been made before we ran."""
        return monotonic_ns() < self._until_ns

    def mark(self, client: Client) -> None:
        """The next command of this handle came with the first bytes of such a connection."""
        self._start.mark(client)


def started_ns() -> int:
    """When this process began, on CLOCK_MONOTONIC; see starttime in proc(5)."""
    ticks = int(Path("/proc/self/stat").read_text(errors="replace").rpartition(")")[2].split()[19])
    return monotonic_ns() - (boottime_ns() - ticks * 1_000_000_000 // os.sysconf("SC_CLK_TCK"))
