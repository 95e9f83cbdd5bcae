"""What programs of this process see of a host: a system that is up, on a clock of its own."""

from __future__ import annotations

import os

from trocar.procs.document.system import SystemConfig
from trocar.procs.host.node import SteppedClock
from trocar.procs.supervisor.memory import simulated
from trocar.shm.time.clock import monotonic_ns
from trocar.shm.time.control_page import ControlPage
from trocar.shm.time.lockstep import SCHEMA, clock_page, create_clock


class HostPages:
    """The clock's page, and that of a supervisor which has nothing to do."""

    def __init__(self, document: SystemConfig, clock: SteppedClock) -> None:
        """The other segments of the system are there."""
        create_clock(document.name, simulated(document))
        self._segment, self._clock = clock_page(document.name, write=True), clock
        self._words, self._now = self._segment.words(), (self._segment.header.first + SCHEMA.offset("now_ns")) // 8
        self._page = ControlPage(document.name, "supervisor", write=True)
        self._page.segment.claim("supervisor")
        self._page.field("pid")[...] = os.getpid()
        self._page.show("RUNNING")
        self.show()

    def show(self) -> None:
        """What time it is."""
        self._words[self._now] = self._clock.time_ns
        self._page.field("heartbeat_ns")[...] = monotonic_ns()

    def close(self) -> None:
        """Unmap."""
        self._page.close()
        self._segment.close()
