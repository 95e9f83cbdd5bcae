"""The boards' watchdogs: a board gets power only after it has shown the watchdog period written to it.

A returning board may have been without power, and then has its own period. The period is written every 0.1 s until the
board shows it.
"""

from __future__ import annotations

import contextlib
from typing import Final

import numpy as np

from trocar.procs.fpga import registers
from trocar.procs.io.bus.transport import PortError
from trocar.procs.io.record import Flags
from trocar.procs.io.robots import IoData
from trocar.procs.node import fault_report as faults
from trocar.procs.tables import codes

TRIES: Final = 3  # at once: a datagram may be lost
RETRY_NS: Final = 100_000_000
PERIOD_BITS: Final = 0xFFFF


class Watchdogs:
    """Watchdogs of all boards of a bus. `unconfirmed` (boards,): the board has not shown the period yet; `busy`: `step`
    has something to do, now or later.
    """

    def __init__(self, data: IoData, now_ns: int) -> None:
        """Write all periods."""
        robots = data.robots
        self._robots, self._port, self._reports = robots, data.port, data.reports
        self._counts = registers.watchdog_counts(robots.io.watchdog_s)
        self.unconfirmed: Flags = np.zeros(len(robots.board_ids), dtype=bool)
        self._next_ns, self._tried, self.busy = now_ns, -1, False
        self.write(np.ones(len(robots.board_ids), dtype=bool), now_ns)

    def write(self, rows: Flags, now_ns: int) -> None:
        """Write the period to these boards, and check whether they show it. Each try takes up to a cycle's time."""
        if self._port.read_only:  # `objection` refuses power
            return
        self.unconfirmed |= rows
        for row in np.flatnonzero(rows).tolist():
            any(self._try(row) for _ in range(TRIES))
        missing = np.flatnonzero(rows & self.unconfirmed).tolist()
        if missing:
            boards = tuple(self._robots.board_ids[row] for row in missing)
            self._reports.warn(codes.WATCHDOG_UNCONFIRMED, self._robots.io.name, boards=boards)
            self._next_ns, self.busy = now_ns + RETRY_NS, True

    def step(self, now_ns: int) -> None:
        """Try the next unconfirmed board, in turn: one per call, as a try takes up to a cycle's time."""
        if not self.busy or now_ns < self._next_ns:
            return
        self._next_ns = now_ns + RETRY_NS
        answering = np.flatnonzero(self.unconfirmed & ~self._port.away)
        if len(answering):
            self._tried = int(next((row for row in answering if row > self._tried), answering[0]))
            self._try(self._tried)
        if not self.unconfirmed.any():
            self.busy = False
            self._reports.status("all boards have confirmed their watchdog period", self._robots.io.name)

    def objection(self, robot: int) -> str:
        """Why a robot gets no power; empty: no reason."""
        if self._port.read_only:
            return self._port.read_only
        rows = np.flatnonzero(self.unconfirmed & self._robots.on_board[robot]).tolist()
        boards = [self._robots.board_ids[row] for row in rows]
        return f"watchdog period not confirmed by {faults.place('', boards=boards)}" if boards else ""

    def _try(self, row: int) -> bool:
        """True: the board has shown the period, or is away."""
        board = self._robots.board_ids[row]
        with contextlib.suppress(PortError):  # it is away again, and will return
            self._port.write_quadlet(board, registers.WATCHDOG, self._counts)
            shown = self._port.peek(board, registers.WATCHDOG)
            self.unconfirmed[row] = shown is None or int(shown[0]) & PERIOD_BITS != self._counts
            return not self.unconfirmed[row]
        return True
