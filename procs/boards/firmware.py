"""The controllers of one bus behind one UDP endpoint: datagrams in, datagrams out, on a tick clock.

Firmware Rev 8 on FPGA V2 with QLA1 in bridge mode: the board with node 0 is plugged into the network (the hub), the
others are reached through it. Node numbers are places in the list of controllers. State lies in arrays over boards
(rows by ascending board id) and axes, so that a broadcast query is answered for all boards at once.

Nothing here reads a clock: every datagram comes with the tick at which it arrived, and everything that happens by
itself before that tick (see `power`) happens first.
"""

from __future__ import annotations

import struct

import numpy as np
import numpy.typing as npt

from procs.boards.board import Board
from procs.boards.encoder import Encoders
from procs.boards.lines import Lines
from procs.boards.power import Power
from procs.lib import blocks, wire
from procs.lib import registers as reg
from procs.lib.document import Controller

FIRMWARES = (8,)  # more to come; blocks.LAYOUTS has the tables of the others
BUS_BOARDS = 16
TEMPERATURES = 0x3C3E  # 30 and 31 °C
FIRST_UPDATE, NEXT_UPDATE = 150, 500  # ticks after a query until the lowest board, and each next one, has reported
HUB_TIME_MASK = 0x3FFF
HUB_READ_TICKS = 24  # a hub read takes so long a board
RECEIVE_TICKS, ANSWER_TICKS = 0x00C8, 0x0D54

_HEAD = struct.Struct(">BBIII")
_QUAD = struct.Struct(">I")
_BIG_QUAD = np.dtype(">u4")
_REPLY = struct.Struct(">IIIII")
_END = struct.Struct(">IIBBBBHH")  # timing quadlet, data CRC, trailer
_DATA_AT = 22  # payload of a block write
_HUB_AT = 20  # payload of a block response
_READS = (wire.QUADLET_READ, wire.BLOCK_READ)


class Firmware:
    """All boards of one bus."""

    def __init__(self, controllers: tuple[Controller, ...], lines: Lines | None = None) -> None:
        """Boards as after power-up at tick 0; `lines` (rows by ascending board id) connect them to the world."""
        if bad := [c for c in controllers if c.firmware not in FIRMWARES or c.hardware != "QLA1"]:
            raise ValueError(f"board {bad[0].board_id}: {bad[0].hardware} with firmware {bad[0].firmware} is not "
                             "emulated; emulated: QLA1 with firmware 8")
        order = sorted(range(len(controllers)), key=lambda node: controllers[node].board_id)
        self.ids = tuple(controllers[node].board_id for node in order)
        if not 0 < len(order) == len(set(self.ids)) or not set(self.ids) <= set(range(BUS_BOARDS)):
            raise ValueError(f"boards {list(self.ids)}; allowed: at least one, each with its own id from 0 to 15")
        self.count = len(order)
        self.layout = blocks.layout_of(8)
        self.lines = lines or Lines.of(self.count)
        self.power = Power(self.ids, self.lines.on)
        self.encoders = Encoders(self.count)
        self.boards = tuple(Board(node, controllers[node].firmware, controllers[node].serial) for node in order)
        self.generation = 1
        self.now = 0  # tick of the newest datagram or step
        self.packets = 0
        self.errors = 0
        self._row_of = {node: row for row, node in enumerate(order)}
        self._node_of = order
        self._every = range(self.count)
        self._mask = sum(1 << board for board in self.ids)
        self._set_up_arrays()

    def _set_up_arrays(self) -> None:
        n = self.count
        self._sample: npt.NDArray[np.uint32] = np.zeros((n, self.layout.hub_quads), dtype=np.uint32)
        self._rt = rt = self._sample[:, 1:]
        rt[:, blocks.TEMPERATURE] = TEMPERATURES
        self._status, self._inputs = rt[:, blocks.STATUS], rt[:, blocks.DIGITAL_INPUT]
        self._stamp, self._adc, self._motor = rt[:, blocks.TIMESTAMP], rt[:, blocks.ADC], rt[:, blocks.MOTOR_STATUS]
        self._positions = rt[:, blocks.POSITION]
        self._velocities = rt[:, blocks.PERIOD.start : blocks.RUNNING.stop].reshape(n, 4, 4)
        assert np.shares_memory(self._velocities, rt)
        self._outputs = np.zeros(n, dtype=np.uint32)
        self._sampled = [-1] * n  # tick of every board's last sample
        self.config = np.full((n, 4), reg.MOTOR_CONFIG_POWER_UP, dtype=np.uint32)
        self.unchecked = np.zeros((n, 4), dtype=np.bool_)
        self._seen_changes = -1
        # The hub's memory lies where the reply to a hub read has it.
        self._reply = bytearray(_HUB_AT + (BUS_BOARDS * self.layout.hub_quads) * 4 + _END.size)
        self._hub = np.frombuffer(self._reply, dtype=">u4", offset=_HUB_AT)
        self._hub_blocks = self._hub[: n * self.layout.hub_quads].reshape(n, self.layout.hub_quads)
        self._hub_quads = 0  # quadlets of the blocks of the last query
        self._complete = False
        self._queried = 0
        headers = (self.layout.hub_quads << 24) + FIRST_UPDATE + NEXT_UPDATE * np.arange(n, dtype=np.uint32)
        self._headers = headers + (np.arange(256, dtype=np.uint32)[:, None] << 16)  # by sequence number
        self._head = self._sample[:, 0]
        self._groups = np.zeros((n, self.layout.write_quads), dtype=np.uint32)
        self._words, self._control = self._groups[:, 1:5], self._groups[:, 5]
        self._group_heads = (np.array(self.ids, dtype=np.uint32) << 8 | np.uint32(self.layout.write_quads)).tobytes()
        self._top = np.zeros((n, 4), dtype=np.uint32)  # top byte of the last command words
        self._last_top = b""
        self._top_shift, self._dac_mask = (np.full((n, 4), k, dtype=np.uint32) for k in (24, reg.DAC_VALUE_MASK))
        self._accept = np.zeros((n, 4), dtype=np.bool_)
        self._settled = -1
        self._values = np.zeros((n, 4), dtype=np.uint32)

    # -- datagrams -----------------------------------------------------------------------------------------------------

    def answer(self, data: wire.Buffer, tick: int) -> wire.Buffer | None:
        """Do what a datagram that arrived at `tick` asks; the reply, or None. A reply is good until the next call."""
        size = len(data)
        if size < 18:
            self.errors += 1
            return None
        flags, generation, q0, _, address = _HEAD.unpack_from(data)
        if q0 >> 22 != wire.BUS:
            self.errors += 1
            return None
        self.packets += 1
        self.now = tick = max(self.now, tick)
        node, tcode, address = q0 >> 16 & 0x3F, q0 >> 4 & 0xF, address & 0xFFFF
        if node != wire.BROADCAST and generation != self.generation:
            return self._trailer(wire.DROPPED) if tcode in _READS else None
        self.power.until(tick)
        if tcode in _READS:
            row = self._reader(node, flags)
            if row is None:
                return None
            if tcode == wire.QUADLET_READ:
                return self._answer_quadlet(row, q0, self.read(row, address, tick))
            length = _QUAD.unpack_from(data, 14)[0] >> 16 if size >= 22 else 0
            return self._answer_block(row, q0, address, length, tick)
        rows = self._writers(node, flags)
        if tcode == wire.BLOCK_WRITE and size >= _DATA_AT + 4:
            self._write_block(rows, address, data, _QUAD.unpack_from(data, 14)[0] >> 16, tick)
        elif tcode == wire.QUADLET_WRITE and size >= 22:
            self._write_quadlet(rows, address, _QUAD.unpack_from(data, 14)[0], tick)
        else:
            self.errors += 1
        return None

    def _reader(self, node: int, flags: int) -> int | None:
        """Row of the board that answers a read; None: nobody does."""
        if node == wire.BROADCAST or node == 0:
            return self._row_of[0]
        return None if flags & wire.NO_FORWARD else self._row_of.get(node)

    def _writers(self, node: int, flags: int) -> range:
        """Rows a write is for."""
        if node == wire.BROADCAST and not flags & wire.NO_FORWARD:
            return self._every
        row = self._reader(node, flags)
        return range(0) if row is None else range(row, row + 1)

    def _trailer(self, flags: int = 0) -> bytes:
        return wire.Trailer(flags, self.generation, self.errors & 0xFF, RECEIVE_TICKS, ANSWER_TICKS).encode()

    def _answer_quadlet(self, row: int, q0: int, value: int) -> bytes:
        return _REPLY.pack(wire.HOST_ID << 16 | q0 & 0xFC00 | wire.QUADLET_RESPONSE << 4,
                           (0xFFC0 | self._node_of[row]) << 16, 0, value, 0) + self._trailer()

    def _answer_block(self, row: int, q0: int, address: int, length: int, tick: int) -> wire.Buffer | None:
        length &= ~3
        if not 0 < length <= wire.MAX_DATA:
            return None
        head = (wire.HOST_ID << 16 | q0 & 0xFC00 | wire.BLOCK_RESPONSE << 4, (0xFFC0 | self._node_of[row]) << 16, 0,
                length << 16, 0)
        if address == reg.HUB and length == (self._hub_quads + 1) * 4:
            return self._answer_hub(head, tick)
        return b"".join((_REPLY.pack(*head), self._block(row, address, length, tick), bytes(4), self._trailer()))

    def _answer_hub(self, head: tuple[int, ...], tick: int) -> memoryview:
        _REPLY.pack_into(self._reply, 0, *head)
        at = _HUB_AT + self._hub_quads * 4
        _END.pack_into(self._reply, at, self._timing(tick), 0, 0, self.generation, 0, self.errors & 0xFF,
                       RECEIVE_TICKS, ANSWER_TICKS)
        return memoryview(self._reply)[: at + _END.size]

    def _timing(self, tick: int) -> int:
        """When this hub read began and ended, counted from the query; 0 while a board is missing."""
        if not self._complete:
            return 0
        start = tick - self._queried
        return (start & HUB_TIME_MASK) << 16 | start + HUB_READ_TICKS * self.count & HUB_TIME_MASK

    def _block(self, row: int, address: int, length: int, tick: int) -> bytes:
        """Data of a block read that is not the regular hub read."""
        if address == reg.REAL_TIME:
            self.sample(tick)
            self._restamp(row, row + 1, tick)
            block = bytes(self._rt[row].astype(">u4"))
            return block[:length].ljust(length, b"\0")
        if reg.HUB <= address < reg.QUERY:
            quads = self._hub[: self._hub_quads].tobytes() + _QUAD.pack(self._timing(tick))
            return quads[(address - reg.HUB) * 4 :][:length].ljust(length, b"\0")
        return self.boards[row].read_block(address, length)

    # -- samples -------------------------------------------------------------------------------------------------------

    def sample(self, tick: int) -> None:
        """Bring the real-time blocks of all boards up to `tick`; time stamps are left alone."""
        self.encoders.observe(tick)
        self.encoders.words(tick, self._positions, self._velocities)
        if self._seen_changes != self.power.changes:
            self._seen_changes = self.power.changes
            self._status[...] = self.power.status
        np.bitwise_or(self.encoders.pins, self.lines.inputs, self._inputs)
        np.bitwise_or(self._inputs, self._outputs, self._inputs)
        self._adc[...] = self.lines.adc
        np.bitwise_or(self.power.motor_flags, self.lines.dac, self._motor)

    def _restamp(self, first: int, end: int, tick: int) -> None:
        sampled = self._sampled
        if end - first == self.count == sampled.count(sampled[0]):
            self._stamp.fill(max(tick - 1 - sampled[0], 0) & 0xFFFF_FFFF)  # the counter wraps
        else:
            self._stamp[first:end] = [max(tick - 1 - last, 0) & 0xFFFF_FFFF for last in sampled[first:end]]
        sampled[first:end] = [tick] * (end - first)

    def _query(self, value: int, tick: int) -> None:
        """Broadcast query: every board of the mask samples and reports to the hub memories of all."""
        self.power.refresh_all(tick)
        self.sample(tick)
        sequence, mask = value >> 16, value & 0xFFFF
        self._queried = tick
        if mask == self._mask:
            self._restamp(0, self.count, tick)
            self._head[...] = self._headers[sequence & 0xFF]
            self._hub_blocks[...] = self._sample
            self._hub_quads, self._complete = self._hub_blocks.size, True
            return
        wanted = [board for board in range(BUS_BOARDS) if mask >> board & 1]
        quads = self.layout.hub_quads
        self._hub_quads, self._complete = len(wanted) * quads, mask & ~self._mask == 0
        for place, board in enumerate(wanted):
            block = self._hub[place * quads : (place + 1) * quads]
            block[...] = 0
            if board in self.ids:
                row = self.ids.index(board)
                self._restamp(row, row + 1, tick)
                self._sample[row, 0] = self._headers[sequence & 0xFF, place % self.count]
                block[...] = self._sample[row]

    # -- writes --------------------------------------------------------------------------------------------------------

    def _write_block(self, rows: range, address: int, data: wire.Buffer, length: int, tick: int) -> None:
        length = min(length, len(data) - _DATA_AT) & ~3
        if address != reg.REAL_TIME:
            for row in rows:
                self.power.refresh(row, tick)
                self.boards[row].write_block(address, bytes(data[_DATA_AT : _DATA_AT + length]))
            return
        quads = np.frombuffer(data, _BIG_QUAD, length // 4, _DATA_AT)
        groups = self._groups
        if rows is self._every and quads.size == groups.size:
            groups[...] = quads.reshape(groups.shape)
            if groups[:, 0].tobytes() == self._group_heads:
                self.power.refresh_all(tick)
                self._execute(self._words, self._control, tick)
                return
        self._write_groups(rows, quads.tolist(), tick)

    def _write_groups(self, rows: range, quads: list[int], tick: int) -> None:
        """Step through groups by the length in their heads; each board takes its own only."""
        groups, size = self._groups, self.layout.write_quads
        groups[...] = 0
        at = 0
        while at < len(quads) and quads[at] & 0xFF:
            board, length = quads[at] >> 8 & 0xF, quads[at] & 0xFF
            if board in self.ids and self.ids.index(board) in rows and size <= length and at + size <= len(quads):
                row = self.ids.index(board)
                groups[row] = quads[at : at + size]
                self.power.refresh(row, tick)
            at += length
        self._execute(self._words, self._control, tick)

    def _execute(self, words: npt.NDArray[np.uint32], control: npt.NDArray[np.uint32], tick: int) -> None:
        """Motor command words (boards, 4), then control words (boards,); all 0 for boards not addressed.

        A word of zeros changes nothing: without a mask bit an enable stays, and it is never left on where power or a
        latch forbids it.
        """
        top, busy = np.right_shift(words, self._top_shift, self._top), self.power.heeds(control)
        enables = top.tobytes()
        if busy or self._settled != self.power.changes or enables != self._last_top:
            # The same enables on the same state change nothing; this is what a running host sends every cycle.
            self.power.enable((top & 0x20) != 0, (top & 0x10) != 0, tick)
            self._settled = self.power.changes
            if busy:  # counts as a change: the same enables may mean something else with power on
                self.power.control(control & np.uint32(reg.CONTROL_REAL_TIME_BITS), tick)
            self._last_top = enables
            self._accept = (top & 0x8F) == 0x80  # valid, current mode; there is no expander for voltage mode
        np.bitwise_and(words, self._dac_mask, self._values)
        np.copyto(self.lines.dac, self._values, where=self._accept)

    def _write_quadlet(self, rows: range, address: int, value: int, tick: int) -> None:
        if address == reg.QUERY:
            if rows is self._every or self.count == 1:
                self._query(value, tick)
            return
        for row in rows:
            self.power.refresh(row, tick)
        for row in rows:
            self.write(row, address, value, tick)

    # -- registers -----------------------------------------------------------------------------------------------------

    def read(self, row: int, address: int, tick: int) -> int:
        """Value of a register of the board in `row`; 0 for what is not there."""
        axis = (address >> 4) - 1
        if reg.HUB <= address < reg.QUERY:
            return int.from_bytes(self._block(row, address, 4, tick), "big")
        if 0 <= axis < 4:
            return self._read_axis(row, axis, address & 0xF, tick)
        if address == reg.WATCHDOG:
            return int(self.power.watchdog_counts[row]) | self.boards[row].show_watchdog
        column = {reg.STATUS: blocks.STATUS, reg.DIGITAL_INPUT: blocks.DIGITAL_INPUT,
                  reg.TEMPERATURE: blocks.TEMPERATURE}.get(address)
        if column is None:
            return self.boards[row].read(address)
        self.sample(tick)
        return int(self._rt[row, column])

    def _read_axis(self, row: int, axis: int, offset: int, tick: int) -> int:
        if offset == reg.DAC:
            return int(self.lines.dac[row, axis])
        if offset == reg.ENCODER_PRELOAD:
            return int(self.encoders.preload[4 * row + axis])
        if offset == reg.MOTOR_CONFIG:
            return int(self.config[row, axis])
        columns = {reg.ADC: blocks.ADC, reg.ENCODER: blocks.POSITION, reg.PERIOD: blocks.PERIOD,
                   reg.QUARTER_1: blocks.QUARTER_1, reg.QUARTER_5: blocks.QUARTER_5, reg.RUNNING: blocks.RUNNING,
                   reg.MOTOR_STATUS: blocks.MOTOR_STATUS}.get(offset)
        if columns is None:
            return 0
        self.sample(tick)
        return int(self._rt[row, columns.start + axis])

    def write(self, row: int, address: int, value: int, tick: int) -> None:
        """Write a register of the board in `row`; its watchdog has been refreshed."""
        axis = (address >> 4) - 1
        if 0 <= axis < 4:
            self._write_axis(row, axis, address & 0xF, value, tick)
        elif address == reg.STATUS:
            if value & reg.CONTROL_REBOOT == reg.CONTROL_REBOOT:
                self._reboot(row, tick)
                return
            control = np.zeros(self.count, dtype=np.uint32)
            control[row] = value & reg.CONTROL_REAL_TIME_BITS
            self.power.control(control, tick)
        elif address == reg.WATCHDOG:
            self.boards[row].show_watchdog = value & 1 << 31
            self.power.set_watchdog(row, value, tick)
        else:
            self.boards[row].write(address, value)
            self._outputs[row] = self.boards[row].outputs << reg.INPUT_DOUT_SHIFT

    def _write_axis(self, row: int, axis: int, offset: int, value: int, tick: int) -> None:
        if offset == reg.DAC:
            words = np.zeros((self.count, 4), dtype=np.uint32)
            words[row, axis] = value
            self._execute(words, np.zeros(self.count, dtype=np.uint32), tick)
        elif offset == reg.ENCODER_PRELOAD:
            self.encoders.observe(tick)
            self.encoders.load(np.array([4 * row + axis]), np.array([value & reg.ENCODER_MASK]))
        elif offset == reg.MOTOR_CONFIG:
            self._configure(row, axis, value)

    def _configure(self, row: int, axis: int, value: int) -> None:
        """Motor configuration: bits 31 and 30 always, delay and current limit where their set bit is 1."""
        old = int(self.config[row, axis])
        delay = value if value & 1 << 25 else old
        limit = value if value & 1 << 24 else old
        self.config[row, axis] = value & 0xC000_0000 | 1 << 24 | delay & 0x00FF_0000 | limit & 0x7FFF
        self.unchecked[row, axis] = bool(value & reg.MOTOR_CONFIG_NO_SAFETY_CHECK)

    def _reboot(self, row: int, tick: int) -> None:
        """The FPGA is configured anew: the board is as after power-up, the bus gets a new generation."""
        self.power.power_up(row, tick)
        self.encoders.observe(tick)
        axes = np.arange(4 * row, 4 * row + 4)
        self.encoders.load(axes, np.full(4, reg.ENCODER_ZERO))
        self.lines.dac[row] = reg.CURRENT_ZERO
        self.config[row] = reg.MOTOR_CONFIG_POWER_UP
        self.unchecked[row] = False
        self.generation = (self.generation + 1) & 0xFF

    # -- time and the world --------------------------------------------------------------------------------------------

    def step(self, tick: int) -> None:
        """A physics step ends at `tick`: edges up to there, and what has happened by itself."""
        self.now = max(self.now, tick)
        self.encoders.observe(tick)
        self.power.until(tick)

    def check_currents(self, tick: int) -> None:
        """Currents and commands as they are hold from `tick` on: compare them."""
        measured = self.lines.adc.astype(np.int64) & 0xFFFF
        self.power.check_currents(tick, self.lines.dac.astype(np.int64), measured, self.unchecked)
