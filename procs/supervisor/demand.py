"""Processes on demand: the first who wants something of one starts it, after the last one left it stops. Pure.

What a person has asked for by hand stands: one that was stopped while somebody wants it is started again when somebody
wants it anew, one that was started while nobody does runs until somebody has wanted it, or it is stopped. One that ends
by itself while nobody wants it may do so.
"""

from __future__ import annotations

from collections.abc import Callable

from trocar.procs.supervisor.children import Child
from trocar.procs.tables import lifecycle


class Demand:
    """What clients want of one instance."""

    def __init__(self, child: Child, is_wanted: Callable[[bool, bool], bool], is_possible: Callable[[], bool]) -> None:
        """`is_possible`: all that it needs is there.

        `is_wanted` is told whether it is refused to all who want it, and whether it would stop now for want of them:
        then the answer is of this moment.
        """
        self._child, self._is_wanted, self._is_possible = child, is_wanted, is_possible
        self._is_served, self._left_ns = False, 0
        self._is_lingering = False  # it was up when the last one left

    def beat(self) -> None:
        """Start it, or stop it, as is wanted now."""
        child = self._child
        is_ending = child.is_down or child.state == lifecycle.STOPPING
        if child.is_done or (self._is_lingering and is_ending):  # it ended, or was stopped, while nobody wanted it
            self._is_served = False
        child.is_wanted = self._is_wanted(self._is_served and child.is_down, False)
        if child.is_wanted:
            self._left_ns, self._is_lingering = 0, False
            if not self._is_served and self._is_possible():
                self._is_served = True
                child.start()
        elif self._is_served:
            now = child.now_ns()
            if not self._left_ns:
                self._left_ns, self._is_lingering = now, not is_ending
            if now - self._left_ns >= child.row.linger_s * 1e9 and not self._is_wanted(False, True):
                self._is_served = self._is_lingering = False
                child.stop()
