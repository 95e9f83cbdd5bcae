"""Real-time blocks of firmware Rev 7, 8 and 9: what is in which quadlet, of read blocks, hub memory and write groups.

`io` and `boards` use the tables (`LAYOUTS`, `AXES_OF`, columns) on whole arrays, a row a board; the dataclasses serve
everything that looks at one block of a QLA1. Columns are the same in every revision: Rev 7 only lacks the last kind.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Final

from procs.lib import registers
from procs.lib.wire import MAX_DATA, Buffer, WireError

AXES_OF: Final = {"QLA1": (4, 4), "DQLA": (8, 8), "dRA1": (10, 7)}  # hardware: motors (with brakes), encoders
MOST_HUB_QUADS: Final = MAX_DATA // 4  # of a hub read: hub memory has 512, a block on the wire a few less

# Columns of a real-time read block; then come the kinds below, a column an axis, axis 1 first.
TIMESTAMP: Final = 0  # ticks since the previous sample of this board, minus 1
STATUS: Final = 1
DIGITAL_INPUT: Final = 2
TEMPERATURE: Final = 3  # two bytes; in 31:16 data-buffer status, or two more bytes of a DQLA
SCALARS: Final = 4
KINDS: Final = 7  # ADC, position, period, quarter 1, quarter 5, running, motor status
_OF_MOTORS: Final = (0, 6)  # kinds there are of every motor; the others are of every encoder


class Columns:
    """Where what lies in a row with room for `width` axes: slices of `width` columns, and `count` of all."""

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
READ_COLUMNS: Final = _PLAIN.count
WRITE_COLUMNS: Final = registers.AXES + 1  # DAC 1-4, control


@dataclass(frozen=True, slots=True)
class Layout:
    """Hub header fields of one firmware revision and sizes (quadlets) of a controller's blocks with it."""

    firmware: int
    sequence_shift: int
    sequence_mask: int  # after the shift: how much of the sequence number comes back
    has_size: bool  # the header names the block's size in 31:24
    mismatch: int  # bit the board sets for a wrong sequence; 0 where there is none
    time_mask: int  # update time, ticks since the query
    motors: int = registers.AXES
    encoders: int = registers.AXES

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
        """The columns that the quadlets of a read block fill in a row with room for `width` axes."""
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
        """Bits of a hub header that are known beforehand."""
        return (self.sequence_mask << self.sequence_shift | self.mismatch
                | (0xFF00_0000 if self.has_size else 0))

    def header(self, sequence: int) -> int:
        """Hub header of a good block, update time 0."""
        size = self.hub_quads << 24 if self.has_size else 0
        return size | (sequence & self.sequence_mask) << self.sequence_shift


LAYOUTS: Final = {
    7: Layout(7, 16, 0xFFFF, False, 0, 0x3FFF),
    8: Layout(8, 16, 0xFF, True, 1 << 15, 0x3FFF),
    9: Layout(9, 16, 0xFF, True, 1 << 15, 0x7FFF),
}


def layout_of(firmware: int, motors: int = registers.AXES, encoders: int = registers.AXES) -> Layout:
    """Layout of a controller with so many motors and encoders; WireError for a firmware nobody knows."""
    layout = LAYOUTS.get(firmware)
    if layout is None:
        raise WireError(f"firmware Rev {firmware}; allowed: 7, 8, 9", "real-time block")
    return replace(layout, motors=motors, encoders=encoders)


def read_quads(firmware: int, motors: int = registers.AXES, encoders: int = registers.AXES) -> int:
    """Quadlets of a real-time read block of a board with so many motors and encoders."""
    return layout_of(firmware, motors, encoders).read_quads


def hub_read_quads(firmware: int, boards: int) -> int:
    """Quadlets of a hub read of QLA1: a header and a block for every board, then the timing quadlet."""
    return layout_of(firmware).hub_quads * boards + 1


def hub_read_quads_of(boards: Iterable[tuple[int, str]]) -> int:
    """The same for any boards: firmware and hardware of each."""
    return sum(read_quads(firmware, *AXES_OF[hardware]) + 1 for firmware, hardware in boards) + 1


def _words(data: Buffer, where: str) -> tuple[int, ...]:
    if len(data) % 4:
        raise WireError(f"{len(data)} bytes; allowed: whole quadlets", where)
    return struct.unpack(f">{len(data) // 4}I", data)


def _bytes(words: tuple[int, ...], where: str) -> bytes:
    try:
        return struct.pack(f">{len(words)}I", *words)
    except struct.error as error:
        raise WireError("a word does not fit 32 bits", where) from error


@dataclass(frozen=True, slots=True)
class ReadBlock:
    """One board's real-time sample; the tuples hold axis 1 first."""

    timestamp: int
    status: int
    digital_input: int
    temperature: int
    adc: tuple[int, ...]
    position: tuple[int, ...]
    period: tuple[int, ...]
    quarter_1: tuple[int, ...]
    quarter_5: tuple[int, ...]
    running: tuple[int, ...]
    motor_status: tuple[int, ...] = ()

    @property
    def board(self) -> int:
        """Board id in the status quadlet."""
        return registers.board_of(self.status)


def decode_read_block(data: Buffer, firmware: int) -> ReadBlock:
    """The real-time block of a QLA1 of that firmware."""
    words = _words(data, "real-time block")
    expected = layout_of(firmware).read_quads
    if len(words) != expected:
        raise WireError(f"{len(words)} quadlets; allowed for Rev {firmware}: {expected}", "real-time block")
    return ReadBlock(words[TIMESTAMP], words[STATUS], words[DIGITAL_INPUT], words[TEMPERATURE], words[ADC],
                     words[POSITION], words[PERIOD], words[QUARTER_1], words[QUARTER_5], words[RUNNING],
                     words[MOTOR_STATUS])


def encode_read_block(block: ReadBlock, firmware: int) -> bytes:
    """The bytes of a real-time block."""
    words = (block.timestamp, block.status, block.digital_input, block.temperature, *block.adc, *block.position,
             *block.period, *block.quarter_1, *block.quarter_5, *block.running, *block.motor_status)
    expected = layout_of(firmware).read_quads
    if len(words) != expected:
        raise WireError(f"{len(words)} quadlets; allowed for Rev {firmware}: {expected}", "real-time block")
    return _bytes(words, "real-time block")


@dataclass(frozen=True, slots=True)
class HubBlock:
    """One board's block in hub memory; `sequence` has 16 bits in Rev 7, 8 after it; `size` is 0 in Rev 7."""

    sequence: int
    update_ticks: int
    block: ReadBlock
    mismatch: bool = False
    size: int = 0


@dataclass(frozen=True, slots=True)
class HubRead:
    """What a hub read returns: blocks in wire order, and start and end of the read in ticks since the query."""

    blocks: tuple[HubBlock, ...]
    start_ticks: int
    finish_ticks: int


def decode_hub_header(word: int, firmware: int) -> tuple[int, int, bool, int]:
    """(sequence, update ticks, mismatch, size) of a hub header; WireError where a bit that must be 0 is set."""
    layout = layout_of(firmware)
    if word & ~(layout.check_mask | layout.time_mask):
        raise WireError(f"0x{word:08X} has bits set that Rev {firmware} leaves 0", "hub header")
    sequence = word >> layout.sequence_shift & layout.sequence_mask
    return sequence, word & layout.time_mask, bool(word & layout.mismatch), word >> 24 if layout.has_size else 0


def encode_hub_header(block: HubBlock, firmware: int) -> int:
    """The header quadlet of a hub block."""
    layout = layout_of(firmware)
    fields = (("sequence", block.sequence, layout.sequence_mask), ("update time", block.update_ticks, layout.time_mask),
              ("size", block.size, 0xFF if layout.has_size else 0), ("mismatch", block.mismatch, bool(layout.mismatch)))
    for name, value, largest in fields:
        if not 0 <= value <= largest:
            raise WireError(f"{name} {value}; allowed for Rev {firmware}: 0 to {largest}", "hub header")
    return (block.size << 24 | block.sequence << layout.sequence_shift | (layout.mismatch if block.mismatch else 0)
            | block.update_ticks)


def decode_hub(data: Buffer, firmware: int) -> HubRead:
    """Hub memory as a hub read returns it."""
    words = _words(data, "hub read")
    stride = layout_of(firmware).hub_quads
    if len(words) % stride != 1:
        raise WireError(f"{len(words)} quadlets; allowed for Rev {firmware}: {stride} a board and 1", "hub read")
    blocks = []
    for at in range(0, len(words) - 1, stride):
        sequence, ticks, mismatch, size = decode_hub_header(words[at], firmware)
        block = decode_read_block(data[4 * at + 4 : 4 * (at + stride)], firmware)
        blocks.append(HubBlock(sequence, ticks, block, mismatch, size))
    return HubRead(tuple(blocks), words[-1] >> 16, words[-1] & 0xFFFF)


def encode_hub(hub: HubRead, firmware: int) -> bytes:
    """The bytes of a hub read."""
    if not (0 <= hub.start_ticks <= 0xFFFF and 0 <= hub.finish_ticks <= 0xFFFF):
        raise WireError(f"{hub.start_ticks}, {hub.finish_ticks}; allowed: 16 bits each", "hub timing")
    parts = []
    for item in hub.blocks:
        parts.append(_bytes((encode_hub_header(item, firmware),), "hub header"))
        parts.append(encode_read_block(item.block, firmware))
    return b"".join(parts) + _bytes((hub.start_ticks << 16 | hub.finish_ticks,), "hub timing")


@dataclass(frozen=True, slots=True)
class WriteGroup:
    """One board's part of a real-time write: its id, the DAC words (axis 1 first, as they are on the wire), control."""

    board: int
    dac: tuple[int, ...]
    control: int


def decode_write(data: Buffer, firmware: int) -> tuple[WriteGroup, ...]:
    """The groups of a real-time block write, in wire order."""
    words = _words(data, "real-time write")
    if layout_of(firmware).firmware != 7:
        return _decode_sized_groups(words)
    if len(words) % WRITE_COLUMNS:
        raise WireError(f"{len(words)} quadlets; allowed for Rev 7: 5 a board", "real-time write")
    groups = []
    for at in range(0, len(words), WRITE_COLUMNS):
        dac = words[at : at + registers.AXES]
        boards = {word >> registers.DAC_BOARD_SHIFT & 0xF for word in dac}
        if len(boards) != 1:
            raise WireError(f"DAC words of boards {sorted(boards)} in one group", f"real-time write, quadlet {at}")
        groups.append(WriteGroup(boards.pop(), dac, words[at + registers.AXES]))
    return tuple(groups)


def _decode_sized_groups(words: tuple[int, ...]) -> tuple[WriteGroup, ...]:
    groups = []
    at = 0
    while at < len(words):
        length = words[at] & 0xFF
        if words[at] >> 12 or not 2 <= length <= len(words) - at:
            raise WireError(f"header 0x{words[at]:08X}", f"real-time write, quadlet {at}")
        groups.append(WriteGroup(words[at] >> 8, words[at + 1 : at + length - 1], words[at + length - 1]))
        at += length
    return tuple(groups)


def encode_write(groups: tuple[WriteGroup, ...], firmware: int) -> bytes:
    """The bytes of a real-time block write (Rev 7 DAC words must carry the board id already)."""
    rev_7 = layout_of(firmware).firmware == 7
    words: list[int] = []
    for group in groups:
        if not 0 <= group.board <= 0xF or len(group.dac) > 0xFD:
            raise WireError(f"board {group.board} with {len(group.dac)} DAC words", "real-time write")
        if not rev_7:
            words.append(group.board << 8 | len(group.dac) + 2)
        elif [word >> registers.DAC_BOARD_SHIFT & 0xF for word in group.dac] != [group.board] * registers.AXES:
            raise WireError(f"DAC words without the id of board {group.board}", "real-time write")
        words += (*group.dac, group.control)
    return _bytes(tuple(words), "real-time write")
