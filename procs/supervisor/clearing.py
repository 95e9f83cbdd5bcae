"""What clients that have died wanted is wanted no more; several times a second."""

from __future__ import annotations

from trocar.procs.document.system import SystemConfig
from trocar.shm.system.subscriptions import Clearing
from trocar.shm.time.control_page import ControlPage

CLEAR_NS = 200_000_000


class Clearings:
    """All control pages of a system, looked through now and then."""

    def __init__(self, system: SystemConfig) -> None:
        """The pages must be there."""
        names = ("supervisor", *(row.name for row in system.processes))
        self._clearings = [Clearing(ControlPage(system.name, name, write=True)) for name in names]
        self._due_ns = 0

    def beat(self, now_ns: int) -> None:
        """Clear what is to be cleared, when it is time."""
        if now_ns >= self._due_ns:
            self._due_ns = now_ns + CLEAR_NS
            for clearing in self._clearings:
                clearing.clear()
