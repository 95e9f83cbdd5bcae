"""What io needs of its boards: rows of their newest sample and their next commands, a read and a write a cycle, and
single registers. Buses are in bus_port.py, the boards of KINEMATIC robots in procs/io/kinematic.py.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence

import numpy as np

from trocar.procs.fpga import blocks, registers
from trocar.procs.io.bus.exchange import Exchange, ExchangeSettings
from trocar.procs.io.bus.link import Counters, Quads
from trocar.procs.native.io_fields import MISSED, SENT


class Port(ABC):
    """Boards, and how a cycle reads and writes them. `board_ids` may come in any order; array rows are the boards in
    ascending id.
    """

    exchange: Exchange | None = None
    """The native calls of a cycle; None: this bus or this machine has none."""
    _settings: ExchangeSettings | None = None

    def __init__(self, board_ids: Sequence[int]) -> None:
        self.board_ids = tuple(sorted(board_ids))
        self.make_rows(registers.AXES)
        self.away = np.zeros(len(self.board_ids), np.bool_)
        """(n_boards,): boards that have left the bus. Their rows keep their values; samples of the other boards are
        valid.
        """
        self.recv_ns = 0
        """When the last datagram of the last read arrived."""
        self.send_ns = 0
        """When the last write was sent."""
        self.counters = Counters(len(self.board_ids))

    def make_rows(self, width: int) -> None:
        """Make the arrays, with room for `width` motors a board."""
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

    @abstractmethod
    def ask_all(self) -> None:
        """Have every board sample, where there is a step for it; the boards sample while the caller works."""

    @abstractmethod
    def read_all(self) -> bool:
        """Sample every board that is not `away` into `blocks`; False if one fails, then `blocks` is unchanged."""

    @abstractmethod
    def write_all(self) -> bool:
        """Send `out` to every board, also after a bad read, then zero its control words."""

    @abstractmethod
    def write_quadlet(self, board: int, address: int, value: int) -> None:
        """Write one register of one board."""

    @abstractmethod
    def peek(self, board: int, address: int, quads: int = 1) -> Quads | None:
        """Quadlets of one board, read once between two cycles; None without an answer within a cycle."""

    def set_exchange(self, settings: ExchangeSettings) -> None:
        """Have `exchange` do io's halves with these settings from now on, where the native library can."""
        self._settings = settings

    def receive_and_check(self, good_ns: int, wake_ns: int, over_ns: int, gap_ns: float) -> int:
        """`read_all` and the checks behind it, by `exchange`: bits of `Halves.receive_and_check`.

        Without a bit, for samples before `wake_ns`, `control_and_send` follows in the same call. `good_ns`: when the
        previous sample arrived; `gap_ns`: mean interval of the samples so far; `over_ns`: see `control_and_send`.
        """
        exchange, counters = self.exchange, self.counters
        assert exchange is not None
        bits = exchange.receive_and_check(good_ns, wake_ns, over_ns, gap_ns)
        self.recv_ns = exchange.link.recv_ns
        counters.reads += 1
        if bits & MISSED:
            counters.bad_reads += 1
        self._note(bits, exchange)
        return bits

    def control_and_send(self, share: float, has_sample: bool, over_ns: int) -> int:
        """The efforts and `write_all`, by `exchange`; without SENT in the result, `write_all` is still to be called.

        After `over_ns`, on CLOCK_BOOTTIME, nothing is sent.
        """
        exchange = self.exchange
        assert exchange is not None
        bits = exchange.control_and_send(share, has_sample, over_ns)
        self._note(bits, exchange)
        return bits

    def _note(self, bits: int, exchange: Exchange) -> None:
        if bits & SENT:
            self.send_ns = exchange.link.send_ns
            self.counters.writes += 1
