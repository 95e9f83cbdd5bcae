"""The arrays of a port, and the layout of its boards' blocks in received datagrams."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from trocar.procs.fpga import blocks, registers, wire
from trocar.procs.io.bus.link import DROPPED, TIMED_OUT, Link, Quads
from trocar.procs.native.bus_fields import HUB
from trocar.procs.native.library import chosen

BOARD_MASK: Final = 0xFF00_0000  # of a status quadlet: number of axes and board id
BIG_QUAD: Final = np.dtype(">u4")
DATA_AT: Final = wire.RESPONSE_HEADER_BYTES // 4
REPLY: Final = struct.Struct(">xxHIxxxxH")  # label and tcode; source; length
TCODE_BITS: Final = 0xF0
QUERY_BYTES: Final = 22
_QUERY = struct.Struct(">IIII")


@dataclass(slots=True)
class Rows:
    """The arrays of a port, row by row the boards in ascending id, and where the boards are on the bus."""

    board_ids: tuple[int, ...]
    layouts: tuple[blocks.Layout, ...]
    columns: blocks.Columns
    blocks: Quads  # (n, columns.count)
    out: Quads  # (n, columns.width + 1)
    bad: NDArray[np.bool_]  # (n,) boards without a sample in the last read
    away: NDArray[np.bool_]  # (n,) boards that have left the bus: they are not read
    nodes: dict[int, int]  # board id to node; always includes the hub
    hub: int  # board id
    query_wait_ns: int | None = None  # None: the time the boards need

    @property
    def alike(self) -> bool:
        """Whether all boards have blocks of the same shape, which fill whole rows."""
        shapes = {(layout.firmware == 7, layout.motors, layout.encoders) for layout in self.layouts}
        width = self.columns.width
        return len(shapes) == 1 and next(iter(shapes))[1:] == (width, width)

    def starts(self, quads: list[int]) -> list[int]:
        """Where each board's part begins when parts of these sizes, in quadlets, follow each other."""
        return [sum(quads[:row]) for row in range(len(quads))]


def swapped(quad: int) -> int:
    """A quadlet as stored in a receive buffer, in the byte order of the wire."""
    return int.from_bytes(quad.to_bytes(4, "big"), "little")


def statuses(rows: Rows) -> Quads:
    """Expected top byte of every status quadlet."""
    ids = np.array(rows.board_ids, np.uint32)
    motors = np.array([layout.motors for layout in rows.layouts], np.uint32)
    return (motors << registers.STATUS_AXES_SHIFT | ids << registers.STATUS_BOARD_SHIFT).astype(np.uint32)


Places: TypeAlias = NDArray[np.int64]


def places(rows: Rows, starts: Sequence[int], members: Sequence[int]) -> tuple[Places, Places]:
    """Source and destination indices of quadlets, for the blocks of the rows `members` that begin at `starts`."""
    quads = [rows.layouts[row].read_quads for row in members]
    source = np.concatenate([np.arange(at, at + n) for at, n in zip(starts, quads, strict=True)])
    target = np.concatenate([row * rows.columns.count + np.array(rows.layouts[row].columns(rows.columns.width))
                             for row in members])
    return source, target


class Unpack:
    """Copies the blocks of all boards from a buffer in wire byte order to `rows.blocks`."""

    def __init__(self, rows: Rows, raw: Quads, starts: list[int], header: int, members: Sequence[int]) -> None:
        """Blocks of the rows `members` begin at quadlets `starts` of `raw`, each after `header` quadlets."""
        count, quads = len(rows.board_ids), [rows.layouts[row].read_quads for row in members]
        self._alike = rows.alike and starts == sorted(starts) and len(members) == count
        if self._alike:
            first, stride = starts[0] - header, header + quads[0]
            self._source = raw[first : first + count * stride].reshape(count, stride)[:, header:].view(BIG_QUAD)
            self._target = rows.blocks[:, : quads[0]]
            return
        self._raw, self._flat = raw, rows.blocks.reshape(-1)
        self._from, self._to = places(rows, starts, members)
        self._quads = np.zeros(len(self._from), np.uint32)

    def run(self) -> None:
        """Swap and copy."""
        if self._alike:
            self._target[...] = self._source
            return
        self._raw.take(self._from, out=self._quads, mode="clip")
        self._flat[self._to] = self._quads.view(BIG_QUAD)


class HubBlocks:
    """The blocks of boards as a hub sends them, each after a header with the number of the query it answers."""

    def __init__(self, link: Link, rows: Rows, members: Sequence[int]) -> None:
        """For the boards in rows `members`, at least one."""
        self._link, self._rows, self._members = link, rows, list(members)
        layouts = [rows.layouts[row] for row in members]
        count, first = len(layouts), layouts[0]
        self.mask_of_boards = sum(1 << rows.board_ids[row] for row in members)
        self.quads = [layout.hub_quads for layout in layouts]
        self.length = 4 * (sum(self.quads) + 1)  # bytes
        self.size = self.length + wire.BLOCK_OVERHEAD_BYTES  # of a reply
        # Header and status are compared in wire byte order, so that only good blocks are swapped and copied.
        self.check = np.array([(swapped(layout.check_mask), swapped(BOARD_MASK)) for layout in layouts], np.uint32)
        self.masked, self.expected = np.zeros((count, 2), np.uint32), np.zeros((count, 2), np.uint32)
        self.expected[:, 1] = statuses(rows)[self._members].byteswap()
        self.sizes = np.array([layout.header(0) for layout in layouts], np.uint32).byteswap()
        self.sequence_mask, self.sequence_shift = first.sequence_mask, first.sequence_shift
        self.members_count, (self.boards_count, self.columns) = count, rows.blocks.shape
        self.received, self.blocks, self.bad, self.away = link.rx_quads, rows.blocks, rows.bad, rows.away
        self.buffer_quads, self.block_quads = len(link.rx_quads), sum(layout.read_quads for layout in layouts)
        self.query: NDArray[np.uint8] = np.zeros(QUERY_BYTES, np.uint8)
        self.heads: Places = np.zeros((count, 2), np.int64)
        self.last_at: Places = np.zeros(1, np.int64)
        self.last: Quads = np.zeros(1, np.uint32)
        """Header of the last block that was taken, in wire byte order."""
        self.taken_from, self.taken_to = (np.zeros(self.block_quads, np.int64) for _ in range(2))
        self.order(range(count))
        self.ask, self.expect, self.take = chosen(HUB, self)  # type: ignore[method-assign]

    def order(self, order: Sequence[int]) -> None:
        """Set the order of the blocks, as indices of members."""
        heads, at = [0] * len(self.quads), DATA_AT
        for place in order:
            heads[place] = at
            at += self.quads[place]
        self.heads[...] = [(head, head + 1 + blocks.STATUS) for head in heads]
        starts = [head + 1 for head in heads]
        self._unpack = Unpack(self._rows, self._link.rx_quads, starts, header=1, members=self._members)
        self.taken_from[...], self.taken_to[...] = places(self._rows, starts, self._members)
        self.last_at[0] = heads[order[-1]]

    def ask(self, sequence: int, tl: int, generation: int) -> int:
        """Put the query with this number into `query`; the next blocks answer it."""
        body = _QUERY.pack(0xFFFF0000 | tl << 10, wire.HOST_ID << 16, registers.QUERY,
                           sequence << 16 | self.mask_of_boards)
        self.query.data[:] = bytes((0, generation)) + body + wire.crc_bytes(body)
        return self.expect(sequence)

    def expect(self, sequence: int) -> int:
        """The next blocks answer the query with this number."""
        header = swapped((sequence & self.sequence_mask) << self.sequence_shift)
        np.bitwise_or(self.sizes, np.uint32(header), self.expected[:, 0])
        return 0

    def source(self, size: int) -> int:
        """The node that sent the reply of `size` bytes, -1 if the reply is not a block of our length."""
        if size != self.size:
            return -1
        label, source, length = REPLY.unpack_from(self._link.rx)
        if label & TCODE_BITS != wire.BLOCK_RESPONSE << 4 or length != self.length:
            return -1
        return int(source) >> 16 & 0x3F

    def take(self) -> int:
        """Copy the blocks to `rows.blocks`. 0: a header or status is not as expected, nothing is copied."""
        self.received.take(self.heads, out=self.masked, mode="clip")
        np.bitwise_and(self.masked, self.check, self.masked)
        if self.masked.tobytes() != self.expected.tobytes():
            return 0
        self._unpack.run()
        self.bad[...] = self.away
        self.last[0] = self.received[self.last_at[0]]
        return 1

    def blame(self) -> bool:
        """Count the blocks that were not the requested ones: wrong board, or the answer to another query. Always False.
        """
        counters, wrong = self._link.counters, self.masked != self.expected
        self._rows.bad[...] = self._rows.away
        self._rows.bad[self._members] = np.any(wrong, axis=1)
        counters.board_bad_reads[self._members] += self._rows.bad[self._members]
        counters.board_sequence_errors[self._members] += wrong[:, 0]
        if wrong[:, 0].any():
            counters.sequence_errors += 1
        if wrong[:, 0].all():  # the reply to an earlier read
            self._link.doubt()
        self._link.suspect = True
        return False

    def blame_all(self) -> bool:
        """Mark all boards as bad: none was queried. Always False."""
        self._rows.bad[...] = True
        self._link.counters.board_bad_reads[self._members] += 1
        return False

    def blame_reply(self, size: int, hub: int) -> bool:
        """No blocks came, but a datagram of this size from board `hub`, or nothing. Always False."""
        rows, link = self._rows, self._link
        rows.bad[...] = True
        if size > 0:
            link.counters.stray += 1
            link.doubt()
        if size != DROPPED:  # else the fault is the bus's
            link.counters.board_bad_reads[self._members] += 1
        if size == TIMED_OUT and hub in rows.board_ids:
            link.counters.board_timeouts[rows.board_ids.index(hub)] += 1
        return False
