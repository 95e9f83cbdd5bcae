"""The three ways to sample all boards and to command them, once a cycle.

A protocol is a reader and a writer. Broadcast-query-read-write takes the same number of datagrams, array operations
and Python instructions whatever the number of boards; the sequential protocols go from board to board.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray

from procs.io.discovery import Rescan
from procs.io.link import Link
from procs.io.port import BROADCAST_QUERY, SEQUENTIAL_BROADCAST, Quads
from procs.lib import blocks, registers, wire

BOARD_MASK: Final = 0xFF00_0000  # of a status quadlet: number of axes and board id
QUERY_WAIT_NS: Final = 10_000  # for the first board, and for each further one, to reach the hub's memory
DATA_AT: Final = wire.RESPONSE_HEADER_BYTES // 4

_QUERY = struct.Struct(">IIII")
_REPLY = struct.Struct(">xxHIxxxxH")  # label and tcode; source; length
_TCODE_BITS: Final = 0xF0


@dataclass(slots=True)
class Rows:
    """The arrays of a port, row by row the boards in ascending id, and where the boards are on the bus."""

    board_ids: tuple[int, ...]
    layout: blocks.Layout
    blocks: Quads  # (n, 32)
    out: Quads  # (n, 5)
    bad: NDArray[np.bool_]  # (n,) boards to blame for the last bad read
    nodes: dict[int, int]  # board id to node; the hub is always in it
    hub: int  # board id
    query_wait_ns: int | None = None  # None: what the boards need


class Reader(Protocol):
    """Samples all boards."""

    def read(self) -> bool:
        """True: `rows.blocks` holds a complete fresh sample."""


class Writer(Protocol):
    """Commands all boards."""

    def write(self) -> bool:
        """True: `rows.out` was sent."""


def _swapped(quad: int) -> int:
    return int.from_bytes(quad.to_bytes(4, "big"), "little")


def _statuses(board_ids: tuple[int, ...]) -> Quads:
    """What the top byte of every status quadlet must be."""
    ids = np.array(board_ids, np.uint32)
    return (registers.AXES << registers.STATUS_AXES_SHIFT | ids << registers.STATUS_BOARD_SHIFT).astype(np.uint32)


class Bus:
    """What every reader does first: find the nodes again when the bus generation changed."""

    def __init__(self, link: Link, rows: Rows) -> None:
        self._link = link
        self._rescan = Rescan(link, rows.nodes)

    def settled(self) -> bool:
        """True when the map of nodes is up to date."""
        link = self._link
        if link.seen_generation != link.generation and not self._rescan.active:
            self._rescan.start()
        return not self._rescan.active or self._rescan.advance()


class QueryRead:
    """One query to all boards, then one read of everything from the hub."""

    def __init__(self, link: Link, rows: Rows) -> None:
        self._link, self._rows, self._bus = link, rows, Bus(link, rows)
        count, layout = len(rows.board_ids), rows.layout
        self._mask_of_boards = sum(1 << board for board in rows.board_ids)
        self._sequence = 0
        self._length = 4 * blocks.hub_read_quads(layout.firmware, count)
        self._size = self._length + wire.BLOCK_OVERHEAD_BYTES
        stride = layout.hub_quads
        shape = (count, stride)
        raw = link.rx_quads[DATA_AT : DATA_AT + count * stride].reshape(shape)
        self._source = raw[:, 1:].view(np.dtype(">u4"))
        self._target = rows.blocks[:, : layout.read_quads]
        # Header and status are compared as they lie in the buffer, so that only good blocks are swapped and copied.
        status = 1 + blocks.STATUS
        self._raw_heads = raw[:, : status + 1 : status]
        self._check = np.array([_swapped(layout.check_mask), _swapped(BOARD_MASK)], np.uint32)
        self._masked = np.zeros((count, 2), np.uint32)
        self._expected = np.zeros((count, 2), np.uint32)
        self._expected[:, 1] = _statuses(rows.board_ids).byteswap()
        self._last_header_at = 4 * (DATA_AT + (count - 1) * stride)
        self._least_wait_ns = QUERY_WAIT_NS * count
        self._wait_ns = self._least_wait_ns if rows.query_wait_ns is None else rows.query_wait_ns
        self._made_for = (-1, -1)
        self._reads: list[bytes] = []

    def read(self) -> bool:
        """Sample every board; a fixed number of datagrams and array operations."""
        link, now_ns = self._link, self._link.now_ns
        if not self._bus.settled():
            return self._blame_all()
        if link.suspect:
            link.drain()
        hub_node = self._rows.nodes[self._rows.hub]
        if (link.generation, hub_node) != self._made_for:
            self._prepare(hub_node)
        self._sequence = sequence = self._sequence % 0xFFFF + 1
        query = _QUERY.pack(0xFFFF0000 | link.next_tl() << 10, wire.HOST_ID << 16, registers.QUERY,
                            sequence << 16 | self._mask_of_boards)
        tl = link.next_tl()
        if not link.send(self._control + query + wire.crc_bytes(query)):
            return self._blame_all()
        self._expected[:, 0] = _swapped(self._rows.layout.header(sequence))
        if link.real_time:
            ready_ns = link.send_ns + self._wait_ns
            while now_ns() < ready_ns:
                pass
        if not link.send(self._reads[tl]):
            return self._blame_all()
        size = link.receive(tl, link.cycle_timeout_ms)
        if size != self._size:
            return self._blame_all(silent=size == 0)
        label, source, length = _REPLY.unpack_from(link.rx)
        if label & _TCODE_BITS != wire.BLOCK_RESPONSE << 4 or source >> 16 & 0x3F != hub_node or length != self._length:
            link.counters.stray += 1
            return self._blame_all()
        np.bitwise_and(self._raw_heads, self._check, out=self._masked)
        if self._masked.tobytes() != self._expected.tobytes():
            return self._blame_some()
        self._target[...] = self._source
        if self._rows.query_wait_ns is None:
            self._adapt_wait()
        return True

    def _prepare(self, hub_node: int) -> None:
        """Read requests with every label, for this generation and hub."""
        generation = self._link.generation
        self._control = bytes((0, generation))
        self._reads = [wire.block_read(hub_node, registers.HUB, self._length, tl, generation)
                       for tl in range(wire.TL_COUNT)]
        self._made_for = (generation, hub_node)

    def _adapt_wait(self) -> None:
        """Next time, wait as long as the last board took this time, when that is longer than the rule."""
        at = self._last_header_at
        ticks = int.from_bytes(self._link.rx[at : at + 4], "big") & self._rows.layout.time_mask
        self._wait_ns = max(self._least_wait_ns, ticks * 1_000_000_000 // registers.CLOCK_HZ)

    def _blame_all(self, *, silent: bool = False) -> bool:
        rows, counters = self._rows, self._link.counters
        rows.bad[...] = True
        counters.board_bad_reads += 1
        if silent and rows.hub in rows.board_ids:
            counters.board_timeouts[rows.board_ids.index(rows.hub)] += 1
        return False

    def _blame_some(self) -> bool:
        """Note which blocks were not the wanted ones: wrong board, or the answer to another query."""
        counters, wrong = self._link.counters, self._masked != self._expected
        np.any(wrong, axis=1, out=self._rows.bad)
        counters.board_bad_reads += self._rows.bad
        counters.board_sequence_errors += wrong[:, 0]
        if wrong[:, 0].any():
            counters.sequence_errors += 1
        return False


class SequentialRead:
    """A block read of every board, one after the other; gives up at the first that fails."""

    def __init__(self, link: Link, rows: Rows) -> None:
        self._link, self._rows, self._bus = link, rows, Bus(link, rows)
        quads = rows.layout.read_quads
        self._length = 4 * quads
        self._size = self._length + wire.BLOCK_OVERHEAD_BYTES
        self._source = link.rx_quads[DATA_AT : DATA_AT + quads].view(np.dtype(">u4"))
        self._sample = np.zeros((len(rows.board_ids), quads), np.uint32)
        self._statuses = _statuses(rows.board_ids).tolist()

    def read(self) -> bool:
        """Sample board after board."""
        rows = self._rows
        if not self._bus.settled():
            rows.bad[...] = True
            self._link.counters.board_bad_reads += 1
            return False
        for row, board in enumerate(rows.board_ids):
            if not self._read_board(row, rows.nodes[board]):
                rows.bad[...] = False
                rows.bad[row] = True
                self._link.counters.board_bad_reads[row] += 1
                return False
        rows.blocks[:, : rows.layout.read_quads] = self._sample
        return True

    def _read_board(self, row: int, node: int) -> bool:
        link = self._link
        if link.suspect:
            link.drain()
        tl = link.next_tl()
        if not link.send(wire.block_read(node, registers.REAL_TIME, self._length, tl, link.generation)):
            return False
        size = link.receive(tl, link.cycle_timeout_ms)
        if size != self._size:
            link.counters.board_timeouts[row] += size == 0
            return False
        label, source, length = _REPLY.unpack_from(link.rx)
        if label & _TCODE_BITS != wire.BLOCK_RESPONSE << 4 or source >> 16 & 0x3F != node or length != self._length:
            link.counters.stray += 1
            return False
        self._sample[row] = self._source
        return bool(int(self._sample[row, blocks.STATUS]) & BOARD_MASK == self._statuses[row])


class Groups:
    """The write groups of all boards in one datagram buffer; `encode` fills it from `rows.out`."""

    def __init__(self, rows: Rows) -> None:
        self._rows, layout, count = rows, rows.layout, len(rows.board_ids)
        # The datagram starts 2 bytes into the buffer: then its quadlets are aligned for numpy.
        self.length = 4 * layout.write_quads * count
        buffer = memoryview(bytearray(2 + 22 + self.length + 4))
        self.datagram = buffer[2:]
        self.data = buffer[24 : 24 + self.length]
        quads = np.frombuffer(buffer, np.dtype(">u4"), layout.write_quads * count, 24).reshape(count, -1)
        self._boards = np.array(rows.board_ids, np.uint32)[:, np.newaxis]
        self._payload = quads[:, -blocks.WRITE_COLUMNS :]
        self._rev_7 = layout.firmware == 7
        if not self._rev_7:
            quads[:, 0] = (self._boards << 8 | layout.write_quads)[:, 0]
        self._axis_bits = np.uint32(1) << np.arange(registers.AXES, dtype=np.uint32)

    def encode(self) -> None:
        """Put `rows.out` into the datagram."""
        if self._rev_7:
            self._encode_rev_7()
        else:
            self._payload[...] = self._rows.out

    def _encode_rev_7(self) -> None:
        """Rev 7 has the board id where later ones have the mode, and amplifier enables in the control word."""
        dac, control = self._rows.out[:, : registers.AXES], self._rows.out[:, registers.AXES]
        kept = registers.DAC_VALID | registers.DAC_COLLECT | registers.DAC_VALUE_MASK
        self._payload[:, : registers.AXES] = dac & np.uint32(kept) | self._boards << registers.DAC_BOARD_SHIFT
        enable = (dac >> 28 & 1) @ self._axis_bits
        mask = (dac >> 29 & 1) @ self._axis_bits
        self._payload[:, registers.AXES] = (control | enable << registers.CONTROL_AMP_SHIFT
                                            | mask << registers.CONTROL_AMP_MASK_SHIFT)

    def sent(self) -> None:
        """Control words act once: a power-on repeated every cycle would clear faults as they are latched."""
        self._rows.out[:, registers.AXES] = 0


class BroadcastWrite:
    """One datagram with the groups of all boards."""

    def __init__(self, link: Link, rows: Rows) -> None:
        self._link, self._groups = link, Groups(rows)
        self._made_for = -1
        self._heads: list[bytes] = []

    def write(self) -> bool:
        """Encode and send the groups of all boards."""
        link, groups = self._link, self._groups
        if link.generation != self._made_for:
            self._prepare()
        groups.encode()
        datagram = groups.datagram
        datagram[:22] = self._heads[link.next_tl()]
        datagram[-4:] = wire.crc_bytes(groups.data)
        if not link.send(datagram):
            return False
        groups.sent()
        return True

    def _prepare(self) -> None:
        """Control word, header and header CRC for every label."""
        data, generation = bytes(self._groups.length), self._link.generation
        self._heads = [wire.block_write(wire.BROADCAST, registers.REAL_TIME, data, tl, generation)[:22]
                       for tl in range(wire.TL_COUNT)]
        self._made_for = generation


class SequentialWrite:
    """One datagram a board."""

    def __init__(self, link: Link, rows: Rows) -> None:
        self._link, self._rows, self._groups = link, rows, Groups(rows)

    def write(self) -> bool:
        """Send board after board; all are tried even when one datagram cannot be sent."""
        link, rows, groups = self._link, self._rows, self._groups
        groups.encode()
        step, done = 4 * rows.layout.write_quads, True
        for row, board in enumerate(rows.board_ids):
            data = bytes(groups.data[row * step : (row + 1) * step])
            node = rows.nodes[board]
            done &= link.send(wire.block_write(node, registers.REAL_TIME, data, link.next_tl(), link.generation))
        if done:
            groups.sent()
        return done


def parts(protocol: str, link: Link, rows: Rows) -> tuple[Reader, Writer]:
    """Reader and writer of a protocol (one of `port.PROTOCOLS`)."""
    if protocol == BROADCAST_QUERY:
        return QueryRead(link, rows), BroadcastWrite(link, rows)
    if protocol == SEQUENTIAL_BROADCAST:
        return SequentialRead(link, rows), BroadcastWrite(link, rows)
    return SequentialRead(link, rows), SequentialWrite(link, rows)
