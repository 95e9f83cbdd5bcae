"""The host's side of a bus of controllers: what every port offers, whatever carries the bytes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from trocar.procs.fpga.blocks import Columns
from trocar.procs.native.bound import BoundStruct
from trocar.procs.node.setup_error import SetupError

Quads: TypeAlias = NDArray[np.uint32]

ALL_BOARDS: Final = 0x3F  # in place of a board id: every board of the bus
SEQUENTIAL: Final = "sequential-read-write"
SEQUENTIAL_BROADCAST: Final = "sequential-read-broadcast-write"
BROADCAST_QUERY: Final = "broadcast-query-read-write"
PROTOCOLS: Final = (SEQUENTIAL, SEQUENTIAL_BROADCAST, BROADCAST_QUERY)


class PortError(SetupError):
    """A bus that cannot be used: what is wrong, where, and what would be right."""

    def __init__(self, what: str, where: str, allowed: str) -> None:
        super().__init__(f"{where}: {what}; {allowed}")
        self.what = what
        self.where = where
        self.allowed = allowed


@dataclass(frozen=True, slots=True)
class BoardInfo:
    """One controller as discovery found it; `node` is its FireWire node, which a bus reset may change."""

    board: int
    node: int
    hardware: str
    firmware: int
    fpga: int
    description: int  # register 0x0F: git description (Rev 8 on), 0 where unreadable
    is_hub: bool


@dataclass(slots=True)
class Counters:
    """What happened on a port since its boards were discovered; the arrays have one place a board, in row order."""

    boards: int
    reads: int = 0
    writes: int = 0
    bad_reads: int = 0  # cycles without a complete fresh sample
    bad_writes: int = 0
    timeouts: int = 0
    sequence_errors: int = 0  # cycles in which a block answered another query
    dropped: int = 0  # reads that the hub dropped: bus in reset, other generation
    stray: int = 0  # datagrams thrown away: late, doubled or broken
    bus_resets: int = 0
    waited_ns: int = 0  # for replies that did not come
    board_bad_reads: NDArray[np.int64] = field(init=False)
    board_timeouts: NDArray[np.int64] = field(init=False)
    board_sequence_errors: NDArray[np.int64] = field(init=False)

    def __post_init__(self) -> None:
        self.board_bad_reads = np.zeros(self.boards, np.int64)
        self.board_timeouts = np.zeros(self.boards, np.int64)
        self.board_sequence_errors = np.zeros(self.boards, np.int64)

    def clear(self) -> None:
        """All counts back to 0, arrays in place."""
        self.reads = self.writes = self.bad_reads = self.bad_writes = self.timeouts = 0
        self.sequence_errors = self.dropped = self.stray = self.bus_resets = self.waited_ns = 0
        for counts in (self.board_bad_reads, self.board_timeouts, self.board_sequence_errors):
            counts.fill(0)


@dataclass(frozen=True, slots=True)
class ExchangeSettings:
    """What io does with a sample in the call that has received it, for as long as a `Port` lives."""

    stages: BoundStruct
    """What the kernel does io's stages on."""
    oldest_ns: int
    """A sample counts as no older than this; see procs/io/cycle.py for all three."""
    stable_ns: float
    gaps: float


class Port(Protocol):
    """A bus with its boards; rows of all arrays are the boards in ascending board id."""

    board_ids: tuple[int, ...]
    hardware: tuple[str, ...]
    """Of every board: QLA1, DQLA or dRA1; known, like all arrays, when the boards are discovered."""
    columns: Columns
    """Where what lies in a row of `blocks`."""
    blocks: Quads
    """(n_boards, columns.count): the last good real-time block of every board; untouched by a bad read."""
    out: Quads
    """(n_boards, columns.width + 1): a command for every motor, and control, for the next write, as Rev 8 words.

    Control is zeroed once it is sent."""
    away: NDArray[np.bool_]
    """(n_boards,): boards that have left the bus: their rows stay as they were, samples of the others count."""
    recv_ns: int
    """When the last datagram of the last read arrived."""
    send_ns: int
    """When the last write left."""
    counters: Counters

    @property
    def stranger(self) -> str:
        """ADDRESS:PORT of whoever else than the boards sent the newest datagram that was ignored; empty: nobody has."""

    def open(self) -> None:
        """Take the means of transport; PortError when that fails."""

    def close(self) -> None:
        """Give it back; may be called at any time, and twice."""

    def discover(self) -> tuple[BoardInfo, ...]:
        """Find the hub and all boards and check them against `board_ids`; PortError names what is wrong."""

    def read_quadlet(self, board: int, address: int) -> int:
        """One register of one board; PortError when it does not answer."""

    def write_quadlet(self, board: int, address: int, value: int) -> None:
        """Write one register of one board, or of `ALL_BOARDS`. The boards do not acknowledge writes."""

    def read_block(self, board: int, address: int, quads: int) -> Quads:
        """So many consecutive quadlets of one board."""

    def write_block(self, board: int, address: int, values: Sequence[int]) -> None:
        """Write consecutive quadlets of one board."""

    def ask_all(self) -> None:
        """Have every board sample, where the protocol has a step for it: the boards need time, until `read_all`."""

    def peek(self, board: int, address: int, quads: int = 1) -> Quads | None:
        """Quadlets of one board, asked for once between two cycles; None without an answer in a cycle's time."""

    def read_all(self) -> bool:
        """Sample every board that is not `away` into `blocks`; False, and `blocks` as it was, where one fails.

        Asks first where nobody has."""

    def set_exchange(self, settings: ExchangeSettings) -> None:
        """From now on `answer` does this with a sample, where it can."""

    def answer(self, good_ns: int, wake_ns: int, over_ns: int, gap_ns: float) -> int:
        """`read_all`, then io's stages and `write_all`: how far that got, see procs/native/progress.py.

        `good_ns`: when the sample before arrived; `gap_ns`: what lay between samples so far. Nothing is done with a
        sample from `wake_ns` on, and nothing sent from `over_ns` on, which is of CLOCK_BOOTTIME.
        """

    def write_all(self) -> bool:
        """Send `out` to every board; False when it could not be sent."""
