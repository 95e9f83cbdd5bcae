"""Boards as io sees them: rows of their newest sample and of their next commands, and single registers.

This class keeps them in memory: every read and write succeeds at once, and registers keep what is written to them.
KINEMATIC robots need no more (procs/io/kinematic.py). `BusPort` does the same for boards on a bus.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from trocar.procs.fpga import blocks, registers
from trocar.procs.io.bus.exchange import Exchange, ExchangeSettings
from trocar.procs.io.bus.link import Counters, Quads


class Port:
    """Boards, all of which are read and written once a cycle.

    `board_ids` may come in any order; array rows are the boards in ascending id.
    """

    exchange: Exchange | None = None
    """The native calls of a cycle; None: this bus or this machine has none."""
    settings: ExchangeSettings | None = None
    read_only = ""
    """Why nothing is written to the boards; empty: it is."""
    assumed: tuple[int, ...] = ()
    """Boards with an unknown firmware."""

    def __init__(self, board_ids: Sequence[int], now_ns: Callable[[], int], width: int = registers.AXES) -> None:
        """`width`: motors of a board, at most."""
        self.board_ids, self._now_ns = tuple(sorted(board_ids)), now_ns
        self._registers: dict[tuple[int, int], int] = {}
        self._make_rows(width)
        self.away = np.zeros(len(self.board_ids), np.bool_)
        """(n_boards,): boards that have left the bus. Their rows keep their values; samples of the other boards are
        valid.
        """
        self.recv_ns = 0
        """When the last datagram of the last read arrived."""
        self.send_ns = 0
        """When the last write was sent."""
        self.counters = Counters(len(self.board_ids))

    def _make_rows(self, width: int) -> None:
        count = len(self.board_ids)
        self.hardware = ("QLA1",) * count
        """Hardware of every board: QLA1, DQLA or dRA1; known, like all arrays, after discovery."""
        self.columns = blocks.Columns(width)
        self.blocks: Quads = np.zeros((count, self.columns.count), np.uint32)
        """(n_boards, columns.count): the last good real-time block of every board; a bad read does not change it."""
        self.out: Quads = np.zeros((count, width + 1), np.uint32)
        """(n_boards, columns.width + 1): a command for every motor, and the control word, for the next write, as Rev 8
        words.
        """

    @property
    def stranger(self) -> str:
        """ADDRESS:PORT of the unknown sender of the newest ignored datagram; empty: there was none."""
        return ""

    def set_exchange(self, settings: ExchangeSettings) -> None:
        """Have `exchange` do io's halves with these settings from now on, where the native library can."""
        self.settings = settings

    def ask_all(self) -> None:
        """Have every board sample, where there is a step for it."""

    def read_all(self) -> bool:
        """Sample every board into `blocks`; whether that succeeds."""
        self.recv_ns = self._now_ns()
        return True

    def write_all(self) -> bool:
        """Send `out` to every board; whether that succeeds."""
        self.send_ns = self._now_ns()
        return True

    def write_quadlet(self, board: int, address: int, value: int) -> None:
        """Write one register of one board."""
        self._registers[board, address] = value

    def peek(self, board: int, address: int, quads: int = 1) -> Quads | None:
        """Quadlets of one board, read once between two cycles; None without an answer within a cycle."""
        return np.array([self._registers.get((board, address + n), 0) for n in range(quads)], np.uint32)
