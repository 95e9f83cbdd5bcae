"""The hub memories of all boards of a bus, which all hold the same result of a broadcast query.

A query names boards by a mask and gives a sequence number. Each board samples and sends its block to all others, so
that one read of any board's hub memory covers all. Over FireWire the boards report in the order of their ids, each
after all lower ones; over Ethernet each board reports as soon as it can, and the addressed board has its own block
first. Rev 8 and 9 store the blocks in the order of their arrival. Rev 7 has a place for every board; a board that does
not report keeps its old block there.
"""

from __future__ import annotations

import struct

import numpy as np
import numpy.typing as npt

from trocar.procs.boards.controllers.firmware import Firmware
from trocar.procs.fpga import blocks
from trocar.procs.fpga import registers as reg
from trocar.procs.native import library
from trocar.procs.native.boards_fields import HUB_MEMORY

BUS_BOARDS = 16
FIRST_UPDATE, NEXT_UPDATE = 150, 500  # FireWire: ticks after a query until the first board, and each next one, reported
FIRST_UPDATE_ETHERNET, NEXT_UPDATE_ETHERNET = 400, 4000  # ticks of 125 MHz
READ_TICKS = 24  # duration of a hub read, per board
HUB_AT = 20  # payload of a block response
_QUAD = struct.Struct(">I")
_HEAD = struct.Struct(">IIIII")
_END = struct.Struct(">IIBBBBHH")  # timing quadlet, data CRC, trailer


class HubMemory:
    """Hub memory, laid out as in the reply to a hub read."""

    def __init__(self, firmware: Firmware, over_ethernet: bool) -> None:
        """The memory is empty."""
        self._firmware, self._over_ethernet, self.samples = firmware, over_ethernet, firmware.samples
        self.boards, self.columns = self.samples.rows.shape
        models = firmware.models
        self.most = most = sum(model.layout.read_quads + 1 for model in models)
        self.room = room = max(most, BUS_BOARDS * blocks.layout_of(7).hub_quads)
        self.reply = bytearray(HUB_AT + 4 * room + _END.size)
        self._memory = np.frombuffer(self.reply, dtype=">u4", count=room, offset=HUB_AT)
        self.memory = self._memory.view(np.uint32)  # in storage order
        self.native = np.zeros(most, dtype=np.uint32)
        self.quads = 0  # of the blocks of the last query
        self._complete = False
        self._queried = self.sequence = self.mask = 0
        self.withheld = [0] * firmware.count  # number of blocks of a board that will be missing
        self.absent: frozenset[int] = frozenset()  # rows of boards that are away
        self.spoiled = [0] * firmware.count  # replies that will carry a wrong sequence number, by board
        self._bits = {1 << board: row for row, board in enumerate(firmware.ids)}
        self._whole = sum(self._bits)
        self._time_mask = min(model.layout.time_mask for model in models)
        self._timing_mask: int = 0xFFFF if all(model.firmware > 8 for model in models) else 0x3FFF
        self._sizes = np.array([model.layout.read_quads + 1 << 24 if model.firmware > 7 else 0 for model in models],
                               dtype=np.uint32)
        self.long = np.array([0xFF00_0000 if model.firmware == 7 else 0 for model in models], dtype=np.uint32)
        self._has_places = all(model.firmware == 7 for model in models)
        self._places = np.zeros((BUS_BOARDS, blocks.layout_of(7).hub_quads), dtype=np.uint32)
        self.headers = np.zeros((256, self.boards), dtype=np.uint32)  # by the lower half of the sequence number
        self.selection = np.zeros(most, dtype=np.int64)  # positions of the sent data in the samples
        self.reporting = np.zeros(self.boards, dtype=np.int64)  # rows of the boards that do, in their order
        self._plan_for(self._whole, 0)
        (self._collect,) = library.chosen(HUB_MEMORY, self)

    def _plan_for(self, mask: int, first: int) -> None:
        """Prepare queries with this mask; `first` is the row addressed over Ethernet."""
        rows = [row for bit, row in self._bits.items() if mask & bit]
        lost = [board for board in range(BUS_BOARDS) if mask >> board & 1 and 1 << board not in self._bits]
        whole = not lost
        if self._over_ethernet:
            rows.sort(key=lambda row: row != first)
        elif lost:  # all boards after it wait indefinitely
            rows = [row for row in rows if self._firmware.ids[row] < lost[0]]
        self._set_plan(mask, first, rows, whole)

    def _set_plan(self, mask: int, first: int, rows: list[int], whole: bool) -> None:
        self._plan, self._rows, self._can_complete = (mask, first), tuple(rows), whole
        start, step = ((FIRST_UPDATE_ETHERNET, NEXT_UPDATE_ETHERNET) if self._over_ethernet
                       else (FIRST_UPDATE, NEXT_UPDATE))
        times = self._sizes.copy()
        for place, row in enumerate(rows):
            times[row] |= start + step * place & self._time_mask
        # Short sequence numbers are looked up; the long ones of Rev 7 need their upper half added.
        sequence = np.arange(256, dtype=np.uint32)[:, None] << 16
        self.headers[...] = times + sequence
        selection = self.samples.selection(self._rows) if rows else ()
        self._sent = self._length = len(selection)
        self.selection[: self._sent], self.reporting[: len(rows)] = selection, rows
        self._reporting_ids = [self._firmware.ids[row] for row in rows]
        self._asked = [board for board in range(BUS_BOARDS) if mask >> board & 1]
        if self._has_places:
            self._length = len(self._asked) * self._places.shape[1]

    def query(self, value: int, first: int, tick: int) -> bool:
        """Register 0x1800 is written: sample all boards of the mask. Returns whether all of them reported."""
        firmware, (sequence, mask) = self._firmware, (value >> 16, value & 0xFFFF)
        if (mask, first) != self._plan:
            self._plan_for(mask, first)
        if any(self.withheld) or not self.absent.isdisjoint(self._rows):
            return self._query_with_gaps(value, first, tick)
        self.sequence, self.mask, self._queried = sequence, mask, tick
        self.quads, self._complete = self._length, self._can_complete
        if not self._sent:
            self._show_places()
            return self._complete
        firmware.sample(tick)
        self._collect(sequence, tick, len(self._rows), self._sent)
        firmware.sampled(self._rows, tick)
        if any(self.spoiled):
            self._spoil(self.samples.head)
            self._take(self._sent)
        if self._has_places:
            self._places[self._reporting_ids] = self.native[: self._sent].reshape(-1, self._places.shape[1])
            self._show_places()
        return self._complete

    def collect(self, sequence: int, tick: int, boards: int, quads: int) -> int:
        """Copy the blocks of the first `boards` reporting boards, `quads` quadlets in all, from the latest sample."""
        samples = self.samples
        samples.stamp(self._rows[:boards], tick)
        samples.head[...] = self.headers[sequence & 0xFF]
        if sequence > 0xFF:
            np.bitwise_or(samples.head, np.uint32(sequence >> 8 << 24) & self.long, samples.head)
        self._take(quads)
        return 0

    def _take(self, quads: int) -> None:
        self.samples.take(self.selection[:quads], self.native[:quads])
        self._memory[:quads] = self.native[:quads]

    def _show_places(self) -> None:
        if self._has_places:
            self._memory[: self._length] = self._places[self._asked].ravel()

    def _query_with_gaps(self, value: int, first: int, tick: int) -> bool:
        """A query in which some boards send no block, as if they were absent. Always False."""
        silent = [row for row, count in enumerate(self.withheld) if count or row in self.absent]
        kept, self.withheld = self.withheld, [0] * self._firmware.count
        absent, self.absent = self.absent, frozenset()
        rows = [row for row in self._rows if row not in silent]
        if not self._over_ethernet and rows != list(self._rows):
            rows = [row for row in rows if row < min(silent)]
        self._set_plan(value & 0xFFFF, first, rows, False)
        self.query(value, first, tick)
        self._plan = (-1, -1)
        self.withheld, self.absent = [max(count - 1, 0) for count in kept], absent
        return False

    def _spoil(self, head: npt.NDArray[np.uint32]) -> None:
        for row, count in enumerate(self.spoiled):
            if count and row in self._rows:
                layout = self._firmware.models[row].layout
                head[row] ^= layout.mismatch or 1 << layout.sequence_shift
                self.spoiled[row] = count - 1

    # -- reads ---------------------------------------------------------------------------------------------------------

    def answer(self, head: tuple[int, ...], trailer: tuple[int, ...], tick: int) -> memoryview:
        """The reply to a read of all blocks and the timing quadlet; valid until the next query or read."""
        _HEAD.pack_into(self.reply, 0, *head)
        at = HUB_AT + 4 * self.quads
        _END.pack_into(self.reply, at, self.timing(tick), 0, *trailer)
        return memoryview(self.reply)[: at + _END.size]

    def timing(self, tick: int) -> int:
        """The timing quadlet: start and end of a read begun at `tick`, from the query on; 0 if a board is missing."""
        if not self._complete and not self._has_places:
            return 0
        start, span = tick - self._queried, READ_TICKS * self._firmware.count
        if self._over_ethernet:
            start = start * 125_000_000 // reg.CLOCK_HZ
        return (start & self._timing_mask) << 16 | start + span & self._timing_mask

    def read(self, offset: int, count: int, tick: int) -> bytes:
        """`count` quadlets of the memory, from `offset` on."""
        memory = self.reply[HUB_AT : HUB_AT + 4 * self.quads] + _QUAD.pack(self.timing(tick))
        return bytes(memory[4 * offset : 4 * (offset + count)].ljust(4 * count, b"\0"))

    def read_register(self, row: int, place: int) -> int:
        """Registers 0x1800 to 0x1803, for debugging: the query, how memory is filled, which boards one waits for."""
        board = self._firmware.ids[row]
        if place == 0:
            return self.sequence << 16 | self.mask
        if place == 3:
            return board << 16 | self.mask & (1 << board) - 1
        if self._firmware.models[row].firmware == 7:  # the queried boards, repeated, eight a register
            asked = [board for board in range(BUS_BOARDS) if self.mask >> board & 1] or [0]
            return sum(asked[k % len(asked)] << 4 * (8 * place - 1 - k) for k in range(8 * place - 8, 8 * place))
        if place == 2 or not self.quads:
            return self.quads
        last = self._firmware.models[self._rows[-1]].layout.read_quads  # the block that was written last, and where
        return last << 16 | self.quads - last - 1
