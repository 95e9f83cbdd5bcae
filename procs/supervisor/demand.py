"""Processes on demand: the first who wants something of one starts it, after the last one left it stops. Pure.

What a person has asked for by hand stands: one that was stopped while somebody wants it is started again when somebody
wants it anew, one that was started while nobody does runs until somebody has wanted it, or it is stopped. One that ends
by itself while nobody wants it may do so.
"""

from __future__ import annotations

from collections.abc import Callable

from procs.supervisor.children import Child


class Demand:
    """What clients want of one instance."""

    def __init__(self, child: Child, is_wanted: Callable[[bool], bool], is_possible: Callable[[], bool]) -> None:
        """`is_wanted` is told whether it is refused to all who want it; `is_possible`: all that it needs is there."""
        self._child, self._is_wanted, self._is_possible = child, is_wanted, is_possible
        self._is_served, self._left_ns = False, 0

    def beat(self) -> None:
        """Start it, or stop it, as is wanted now."""
        if self._child.is_done:
            self._is_served = False
        self._child.is_wanted = self._is_wanted(self._is_served and self._child.is_down)
        if self._child.is_wanted:
            self._left_ns = 0
            if not self._is_served and self._is_possible():
                self._is_served = True
                self._child.start()
        elif self._is_served:
            now = self._child.now_ns()
            self._left_ns = self._left_ns or now
            if now - self._left_ns >= self._child.row.linger_s * 1e9:
                self._is_served = False
                self._child.stop()
