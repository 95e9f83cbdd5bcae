"""The three ways to sample all boards and to command them, once a cycle.

A protocol is a reader and a writer. Broadcast-query-read-write takes the same number of datagrams, array operations
and Python instructions whatever the number of boards; the sequential protocols go from board to board. Where all boards
are alike, their blocks lie in a datagram as rows do in `Rows.blocks`; otherwise an index says where each quadlet goes.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray

from procs.io.discovery import Rescan
from procs.io.link import Link
from procs.io.port import Quads
from procs.lib import blocks, registers, wire

BOARD_MASK: Final = 0xFF00_0000  # of a status quadlet: number of axes and board id
BIG_QUAD: Final = np.dtype(">u4")
QUERY_WAIT_NS: Final = 10_000  # for the first board, and for each further one, to reach the hub's memory
DATA_AT: Final = wire.RESPONSE_HEADER_BYTES // 4

_QUERY = struct.Struct(">IIII")
_REPLY = struct.Struct(">xxHIxxxxH")  # label and tcode; source; length
_TCODE_BITS: Final = 0xF0


@dataclass(slots=True)
class Rows:
    """The arrays of a port, row by row the boards in ascending id, and where the boards are on the bus."""

    board_ids: tuple[int, ...]
    layouts: tuple[blocks.Layout, ...]
    columns: blocks.Columns
    blocks: Quads  # (n, columns.count)
    out: Quads  # (n, columns.width + 1)
    bad: NDArray[np.bool_]  # (n,) boards to blame for the last bad read
    nodes: dict[int, int]  # board id to node; the hub is always in it
    hub: int  # board id
    query_wait_ns: int | None = None  # None: what the boards need

    @property
    def alike(self) -> bool:
        """All boards have blocks of the same shape, and these fill whole rows."""
        shapes = {(layout.firmware == 7, layout.motors, layout.encoders) for layout in self.layouts}
        width = self.columns.width
        return len(shapes) == 1 and next(iter(shapes))[1:] == (width, width)

    def starts(self, quads: list[int]) -> list[int]:
        """Where the part of every board begins when parts of so many quadlets follow each other."""
        return [sum(quads[:row]) for row in range(len(quads))]


class Reader(Protocol):
    """Samples all boards."""

    def ask(self) -> None:
        """Have the boards sample, where that is a step of its own."""

    def read(self) -> bool:
        """True: `rows.blocks` holds a complete fresh sample."""


class Writer(Protocol):
    """Commands all boards."""

    def write(self) -> bool:
        """True: `rows.out` was sent."""


def swapped(quad: int) -> int:
    """A quadlet as it lies in a receive buffer, in the byte order of the wire."""
    return int.from_bytes(quad.to_bytes(4, "big"), "little")


def statuses(rows: Rows) -> Quads:
    """What the top byte of every status quadlet must be."""
    ids = np.array(rows.board_ids, np.uint32)
    motors = np.array([layout.motors for layout in rows.layouts], np.uint32)
    return (motors << registers.STATUS_AXES_SHIFT | ids << registers.STATUS_BOARD_SHIFT).astype(np.uint32)


class Unpack:
    """Copies the read blocks of all boards out of a buffer, which holds them as the wire does, to `rows.blocks`."""

    def __init__(self, rows: Rows, raw: Quads, starts: list[int], header: int) -> None:
        """Blocks begin at quadlets `starts` of `raw`, each after a header of `header` quadlets."""
        count, quads = len(rows.board_ids), [layout.read_quads for layout in rows.layouts]
        self._alike = rows.alike and starts == sorted(starts)
        if self._alike:
            first, stride = starts[0] - header, header + quads[0]
            self._source = raw[first : first + count * stride].reshape(count, stride)[:, header:].view(BIG_QUAD)
            self._target = rows.blocks[:, : quads[0]]
            return
        self._raw, self._flat = raw, rows.blocks.reshape(-1)
        self._from = np.concatenate([np.arange(at, at + n) for at, n in zip(starts, quads, strict=True)])
        self._to = np.concatenate([row * rows.columns.count + np.array(layout.columns(rows.columns.width))
                                   for row, layout in enumerate(rows.layouts)])
        self._quads = np.zeros(len(self._from), np.uint32)

    def run(self) -> None:
        """Swap and copy."""
        if self._alike:
            self._target[...] = self._source
            return
        self._raw.take(self._from, out=self._quads, mode="clip")
        self._flat[self._to] = self._quads.view(BIG_QUAD)


class Bus:
    """What every reader does first: find the nodes again when the bus generation changed."""

    def __init__(self, link: Link, rows: Rows) -> None:
        self._link = link
        self._rescan = Rescan(link, rows.nodes)

    def settled(self) -> bool:
        """True when the map of nodes is up to date."""
        link = self._link
        if link.seen_generation != link.generation and not link.by_board and not self._rescan.active:
            self._rescan.start()
        return not self._rescan.active or self._rescan.advance()


class QueryRead:
    """One query to all boards, then one read of everything from the hub."""

    def __init__(self, link: Link, rows: Rows) -> None:
        self._link, self._rows, self._bus = link, rows, Bus(link, rows)
        count, first = len(rows.board_ids), rows.layouts[0]
        self._mask_of_boards = sum(1 << board for board in rows.board_ids)
        self._sequence = 0
        sizes = [layout.hub_quads for layout in rows.layouts]
        self._length = 4 * (sum(sizes) + 1)
        self._size = self._length + wire.BLOCK_OVERHEAD_BYTES
        heads = [DATA_AT + start for start in rows.starts(sizes)]
        self._unpack = Unpack(rows, link.rx_quads, [head + 1 for head in heads], header=1)
        # Header and status are compared as they lie in the buffer, so that only good blocks are swapped and copied.
        self._heads = np.array([(head, head + 1 + blocks.STATUS) for head in heads], np.intp)
        self._check = np.array([(swapped(layout.check_mask), swapped(BOARD_MASK)) for layout in rows.layouts],
                               np.uint32)
        self._masked = np.zeros((count, 2), np.uint32)
        self._expected = np.zeros((count, 2), np.uint32)
        self._expected[:, 1] = statuses(rows).byteswap()
        self._sizes = np.array([layout.header(0) for layout in rows.layouts], np.uint32).byteswap()
        self._sequence_bits = swapped(first.header(0xFFFF) ^ first.header(0))
        self._header = first.header
        self._last_header_at = 4 * heads[-1]
        self._time_mask = rows.layouts[-1].time_mask
        self._least_wait_ns = QUERY_WAIT_NS * count
        self._wait_ns = self._least_wait_ns if rows.query_wait_ns is None else rows.query_wait_ns
        self._made_for = (-1, -1)
        self._reads: list[bytes] = []
        self._asked, self._sent, self._hub_node, self._ready_ns = False, False, -1, 0

    def ask(self) -> None:
        """Query all boards."""
        link = self._link
        self._asked, self._sent = True, False
        if not self._bus.settled():
            return
        if link.suspect:
            link.drain()
        self._hub_node = hub_node = self._rows.nodes[self._rows.hub]
        if (link.generation, hub_node) != self._made_for:
            self._prepare(hub_node)
        self._sequence = sequence = self._sequence % 0xFFFF + 1
        query = _QUERY.pack(0xFFFF0000 | link.next_tl() << 10, wire.HOST_ID << 16, registers.QUERY,
                            sequence << 16 | self._mask_of_boards)
        self._sent = link.send(self._control + query + wire.crc_bytes(query))
        self._ready_ns = link.send_ns + self._wait_ns
        np.bitwise_or(self._sizes, swapped(self._header(sequence)) & self._sequence_bits, self._expected[:, 0])

    def read(self) -> bool:
        """Sample every board; a fixed number of datagrams and array operations."""
        link, now_ns = self._link, self._link.now_ns
        if not self._asked:
            self.ask()
        self._asked, ready_ns = False, self._ready_ns if self._sent and link.real_time else 0
        while now_ns() < ready_ns:
            pass
        tl = link.next_tl()
        if not self._sent or not link.send(self._reads[tl]):
            return self._blame_all()
        size = link.receive(tl, link.cycle_timeout_ms)
        if size != self._size:
            return self._blame_all(silent=size == 0)
        label, source, length = _REPLY.unpack_from(link.rx)
        node = source >> 16 & 0x3F
        if label & _TCODE_BITS != wire.BLOCK_RESPONSE << 4 or node != self._hub_node or length != self._length:
            link.counters.stray += 1
            return self._blame_all()
        link.rx_quads.take(self._heads, out=self._masked, mode="clip")
        np.bitwise_and(self._masked, self._check, self._masked)
        if self._masked.tobytes() != self._expected.tobytes():
            return self._blame_some()
        self._unpack.run()
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
        ticks = int.from_bytes(self._link.rx[at : at + 4], "big") & self._time_mask
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
        self._quads = [layout.read_quads for layout in rows.layouts]
        self._starts = rows.starts(self._quads)
        self._sample = np.zeros(sum(self._quads), np.uint32)
        self._unpack = Unpack(rows, self._sample, self._starts, header=0)
        self._statuses = [swapped(status) for status in statuses(rows).tolist()]
        self._board_mask = swapped(BOARD_MASK)

    def ask(self) -> None:
        """Every board samples when it is read."""

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
        self._unpack.run()
        return True

    def _read_board(self, row: int, node: int) -> bool:
        link, quads = self._link, self._quads[row]
        if link.suspect:
            link.drain()
        tl = link.next_tl()
        if not link.send(wire.block_read(node, registers.REAL_TIME, 4 * quads, tl, link.generation, link.flags)):
            return False
        size = link.receive(tl, link.cycle_timeout_ms)
        if size != 4 * quads + wire.BLOCK_OVERHEAD_BYTES:
            link.counters.board_timeouts[row] += size == 0
            return False
        label, source, length = _REPLY.unpack_from(link.rx)
        if label & _TCODE_BITS != wire.BLOCK_RESPONSE << 4 or source >> 16 & 0x3F != node or length != 4 * quads:
            link.counters.stray += 1
            return False
        at = self._starts[row]
        self._sample[at : at + quads] = link.rx_quads[DATA_AT : DATA_AT + quads]
        return int(self._sample[at + blocks.STATUS]) & self._board_mask == self._statuses[row]


class Groups:
    """The write groups of all boards in one datagram buffer; `encode` fills it from `rows.out`."""

    def __init__(self, rows: Rows) -> None:
        self._rows, width = rows, rows.columns.width
        self.sizes = [4 * layout.write_quads for layout in rows.layouts]  # bytes
        self.length = sum(self.sizes)
        self.starts = rows.starts(self.sizes)
        # The datagram starts 2 bytes into the buffer: then its quadlets are aligned for numpy.
        buffer = memoryview(bytearray(2 + 22 + self.length + 4))
        self.datagram = buffer[2:]
        self.data = buffer[24 : 24 + self.length]
        quads = np.frombuffer(buffer, BIG_QUAD, self.length // 4, 24)
        self._boards = np.array(rows.board_ids, np.uint32)[:, np.newaxis]
        self._axis_bits = np.uint32(1) << np.arange(width, dtype=np.uint32)
        self._rev_7 = rows.layouts[0].firmware == 7  # whose groups have no header; they are mixed with no others
        if not self._rev_7:
            quads[[start // 4 for start in self.starts]] = [
                board << 8 | layout.write_quads for board, layout in zip(rows.board_ids, rows.layouts, strict=True)]
        self._alike = rows.alike
        if self._alike:
            self._payload = quads.reshape(len(rows.board_ids), -1)[:, -(width + 1) :]
            return
        # motors of every board, then its control word, which is the last column of its row
        self._quads, self._flat = quads, rows.out.reshape(-1)
        self._from = np.concatenate([row * (width + 1) + np.array([*range(layout.motors), width])
                                     for row, layout in enumerate(rows.layouts)])
        self._to = np.concatenate([start // 4 + 1 + np.arange(layout.motors + 1)
                                   for start, layout in zip(self.starts, rows.layouts, strict=True)])

    def encode(self) -> None:
        """Put `rows.out` into the datagram."""
        if self._rev_7:
            self._encode_rev_7()
        elif self._alike:
            self._payload[...] = self._rows.out
        else:
            self._quads[self._to] = self._flat.take(self._from)

    def _encode_rev_7(self) -> None:
        """Rev 7 has the board id where later ones have the mode, and amplifier enables in the control word."""
        dac, control = self._rows.out[:, :-1], self._rows.out[:, -1]
        kept = registers.DAC_VALID | registers.DAC_COLLECT | registers.DAC_VALUE_MASK
        self._payload[:, :-1] = dac & np.uint32(kept) | self._boards << registers.DAC_BOARD_SHIFT
        enable = (dac >> 28 & 1) @ self._axis_bits
        mask = (dac >> 29 & 1) @ self._axis_bits
        self._payload[:, -1] = (control | enable << registers.CONTROL_AMP_SHIFT
                                | mask << registers.CONTROL_AMP_MASK_SHIFT)

    def sent(self) -> None:
        """Control words act once: a power-on repeated every cycle would clear faults as they are latched."""
        self._rows.out[:, -1] = 0


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
        data, generation, flags = bytes(self._groups.length), self._link.generation, self._link.flags
        self._heads = [wire.block_write(wire.BROADCAST, registers.REAL_TIME, data, tl, generation, flags)[:22]
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
        done = True
        for row, board in enumerate(rows.board_ids):
            at = groups.starts[row]
            data = bytes(groups.data[at : at + groups.sizes[row]])
            node = rows.nodes[board]
            done &= link.send(wire.block_write(node, registers.REAL_TIME, data, link.next_tl(), link.generation,
                                               link.flags))
        if done:
            groups.sent()
        return done
