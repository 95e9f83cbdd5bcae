"""Real-time blocks of firmware Rev 7, 8 and 9: the quadlets of read blocks, hub memory and write groups.

What Rev 10 changes is not public. Its blocks are assumed to be those of Rev 9, which `BusPort` checks by reading them.

`io` and `boards` use the tables (`LAYOUTS`, `AXES_OF`, columns) on whole arrays, a row a board. Columns are the same in
every revision, but Rev 7 lacks the last kind.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Final

from trocar.procs.fpga import registers
from trocar.procs.fpga.wire import MAX_DATA, WireError

AXES_OF: Final = {"QLA1": (4, 4), "DQLA": (8, 8), "dRA1": (10, 7)}  # hardware: motors (with brakes), encoders
MAX_HUB_QUADS: Final = MAX_DATA // 4  # of a hub read: hub memory has 512, a block on the wire a few less

# Columns of a real-time read block; then come the kinds below, a column an axis, axis 1 first.
TIMESTAMP: Final = 0  # ticks since the previous sample of this board, minus 1
STATUS: Final = 1
DIGITAL_INPUT: Final = 2
TEMPERATURE: Final = 3  # two bytes; in 31:16 data-buffer status, or two more bytes of a DQLA
SCALARS: Final = 4
KINDS: Final = 7  # ADC, position, period, quarter 1, quarter 5, running, motor status
_OF_MOTORS: Final = (0, 6)  # kinds with a column for each motor; the others have one for each encoder


class Columns:
    """Columns of a row with room for `width` axes: slices of `width` columns, and `count` of all."""

    def __init__(self, width: int) -> None:
        self.width, self.count = width, SCALARS + KINDS * width
        (self.adc, self.position, self.period, self.quarter_1, self.quarter_5, self.running, self.motor_status) = (
            slice(SCALARS + kind * width, SCALARS + (kind + 1) * width) for kind in range(KINDS))


_PLAIN: Final = Columns(registers.AXES)  # a QLA1's columns, by name
ADC: Final = _PLAIN.adc
POSITION: Final = _PLAIN.position
PERIOD: Final = _PLAIN.period
QUARTER_1: Final = _PLAIN.quarter_1
QUARTER_5: Final = _PLAIN.quarter_5
RUNNING: Final = _PLAIN.running
MOTOR_STATUS: Final = _PLAIN.motor_status  # Rev 8 on; zero in the arrays of Rev 7


@dataclass(frozen=True, slots=True)
class Layout:
    """Hub header fields of one firmware revision and sizes (quadlets) of a controller's blocks with it."""

    firmware: int
    sequence_shift: int
    sequence_mask: int  # after the shift: the returned part of the sequence number
    has_size: bool  # the header names the block's size in 31:24
    mismatch: int  # bit the board sets for a wrong sequence; 0: none
    time_mask: int  # update time, ticks since the query
    motors: int = registers.AXES
    encoders: int = registers.AXES
    is_assumed: bool = False  # no capture of this revision exists; the layout is that of the one before

    @property
    def read_quads(self) -> int:
        """Quadlets of a real-time read block."""
        if self.firmware == 7:
            return SCALARS + 6 * self.encoders
        return SCALARS + 2 * self.motors + 5 * self.encoders

    @property
    def write_quads(self) -> int:
        """Quadlets of a board's part of a real-time write."""
        return self.motors + (1 if self.firmware == 7 else 2)

    def columns(self, width: int) -> list[int]:
        """The columns filled by the quadlets of a read block, in a row with room for `width` axes."""
        filled = list(range(SCALARS))
        for kind in range(KINDS - 1 if self.firmware == 7 else KINDS):
            first = SCALARS + kind * width
            filled += range(first, first + (self.motors if kind in _OF_MOTORS else self.encoders))
        return filled

    @property
    def hub_quads(self) -> int:
        """Quadlets of one board in hub memory: header and read block."""
        return self.read_quads + 1

    @property
    def check_mask(self) -> int:
        """Bits of a hub header with known values."""
        return (self.sequence_mask << self.sequence_shift | self.mismatch | (0xFF00_0000 if self.has_size else 0))

    def header(self, sequence: int) -> int:
        """Hub header of a good block, update time 0."""
        size = self.hub_quads << 24 if self.has_size else 0
        return size | (sequence & self.sequence_mask) << self.sequence_shift


LAYOUTS: Final = {
    7: Layout(7, 16, 0xFFFF, False, 0, 0x3FFF),
    8: Layout(8, 16, 0xFF, True, 1 << 15, 0x3FFF),
    9: Layout(9, 16, 0xFF, True, 1 << 15, 0x7FFF),
    10: Layout(10, 16, 0xFF, True, 1 << 15, 0x7FFF, is_assumed=True),
}
REVISIONS: Final = f"Rev {', '.join(map(str, LAYOUTS))}"
"""Layouts for reading, by firmware revision."""


def layout_of(firmware: int, motors: int = registers.AXES, encoders: int = registers.AXES) -> Layout:
    """Layout of a controller with this many motors and encoders; WireError for an unknown firmware."""
    layout = LAYOUTS.get(firmware)
    if layout is None:
        raise WireError(f"firmware Rev {firmware}; allowed: {REVISIONS}", "real-time block")
    return replace(layout, motors=motors, encoders=encoders)


def read_quads(firmware: int, motors: int = registers.AXES, encoders: int = registers.AXES) -> int:
    """Quadlets of a real-time read block of a board with this many motors and encoders."""
    return layout_of(firmware, motors, encoders).read_quads


def hub_read_quads(boards: Iterable[tuple[int, str]]) -> int:
    """Quadlets of a hub read: a header and a block for every board, given as firmware and hardware, then the timing
    quadlet.
    """
    return sum(read_quads(firmware, *AXES_OF[hardware]) + 1 for firmware, hardware in boards) + 1
