"""The three protocols that sample and command all boards once a cycle.

A protocol is a reader and a writer. Broadcast-query-read-write takes the same number of datagrams, array operations and
Python instructions for any number of boards; the sequential protocols handle board after board. Where all boards are
alike, a datagram has their blocks in the layout of `Rows.blocks`; otherwise an index gives the place of each quadlet.
"""

from __future__ import annotations

import struct
from typing import Final

import numpy as np

from trocar.procs.fpga import blocks, registers, wire
from trocar.procs.io.bus.discovery import Rescan
from trocar.procs.io.bus.link import TIMED_OUT, Link, Quads
from trocar.procs.io.bus.rows import (
    BIG_QUAD,
    BOARD_MASK,
    DATA_AT,
    REPLY,
    TCODE_BITS,
    HubBlocks,
    Rows,
    Unpack,
    statuses,
    swapped,
)
from trocar.procs.native.bus_fields import WRITE
from trocar.procs.native.library import chosen

SEQUENTIAL: Final = "sequential-read-write"
SEQUENTIAL_BROADCAST: Final = "sequential-read-broadcast-write"
BROADCAST_QUERY: Final = "broadcast-query-read-write"
PROTOCOLS: Final = (SEQUENTIAL, SEQUENTIAL_BROADCAST, BROADCAST_QUERY)

QUERY_WAIT_NS, BOARD_WAIT_NS = 10_000, 5_000  # after a query, and for each board to reach the hub's memory
MAX_WAIT_NS: Final = 400_000  # longest wait in this process
UNSENT: Final = -1  # in place of a label
_QUAD = struct.Struct(">I")


class BusNodes:
    """First step of every reader: find the nodes again when the bus generation changed."""

    def __init__(self, link: Link, rows: Rows) -> None:
        self._link, self._rows = link, rows
        self._rescan = Rescan(link, rows.nodes, rows.hub)
        self._away = self._rescan.away

    @property
    def is_lost(self) -> bool:
        """Whether the map of nodes is out of date."""
        return self._rescan.active

    def blame(self) -> bool:
        """Mark all boards as bad: the nodes are not known again yet, which is no board's fault. Always False."""
        self._rows.bad[...] = True
        return False

    def settled(self) -> bool:
        """Whether the map of nodes is up to date."""
        link = self._link
        if link.seen_generation != link.generation and not link.by_board and not self._rescan.active:
            self._rescan.start()
        if self._rescan.active and not self._rescan.advance():
            return False
        if self._rescan.away != self._away or self._rescan.probe():
            self._away = self._rescan.away
            self._rows.away[...] = [board in self._rescan.away for board in self._rows.board_ids]
            if self._rows.away.all():  # only a hub that is not one of our boards
                self._rescan.start()
                return False
        return True


class QueryRead:
    """One query to all boards, then one read of everything from the hub."""

    def __init__(self, link: Link, rows: Rows) -> None:
        self._link, self._rows, self._bus = link, rows, BusNodes(link, rows)
        self._time_mask = rows.layouts[-1].time_mask
        self._take_members()
        self.made_for = -1, -1, rows.away.tobytes()
        """Bus generation, node of the hub, and boards away: everything prepared is valid for these."""
        self._reads: list[bytes] = []
        self._asked, self._sent, self._ready_ns = False, False, 0
        self._read = self._is_good = False  # the last read brought blocks; all were valid

    def _take_members(self) -> None:
        """Read the boards that are present."""
        rows = self._rows
        members = np.flatnonzero(~rows.away).tolist()
        self.blocks = HubBlocks(self._link, rows, members)
        self._query = self.blocks.query.data
        self._least_wait_ns = QUERY_WAIT_NS + BOARD_WAIT_NS * len(members)
        self._wait_ns = self._least_wait_ns if rows.query_wait_ns is None else rows.query_wait_ns

    def ask(self) -> None:
        """Query all boards."""
        link = self._link
        self._asked, self._sent = True, False
        if self._read and self._rows.query_wait_ns is None:  # here, where it takes no time from the cycle
            self._adapt_wait()
        self._read = False
        if not self._bus.settled() or not link.ready():
            return
        hub_node = self._rows.nodes[self._rows.hub]
        if (link.generation, hub_node, self._rows.away.tobytes()) != self.made_for:
            self._prepare(hub_node)
        self.blocks.ask(link.next_sequence(), link.next_tl(), link.generation)
        self._sent = link.send(self._query)
        self._ready_ns = link.send_ns + self._wait_ns

    def read(self) -> bool:
        """Sample every board; a fixed number of datagrams and array operations."""
        tl, link = self.request(), self._link
        return tl != UNSENT and self.take(link.receive(tl, link.cycle_timeout_ms))

    def request(self) -> int:
        """Once the boards have sampled, request all blocks from the hub: the label of the reply, or UNSENT."""
        if not self._asked:
            self.ask()
        link, now_ns, found = self._link, self._link.now_ns, self.blocks
        self._asked, ready_ns = False, self._ready_ns if self._sent and link.real_time else 0
        while now_ns() < ready_ns:
            pass
        if self._sent:
            tl = link.next_tl()
            if link.send(self._reads[tl]):
                return tl
            found.blame_all()
        elif self._bus.is_lost:
            self._bus.blame()
        else:
            found.blame_all()
        return UNSENT

    def take(self, size: int) -> bool:
        """The reply, or another datagram, is in the link's buffer: True if all blocks are the requested ones."""
        found = self.blocks
        if found.source(size) != self.hub_node:
            return found.blame_reply(size, self._rows.hub)
        good = bool(found.take())
        self.has_taken(good)
        return True if good else found.blame()

    def has_taken(self, good: bool) -> None:
        """A reply was taken; a `good` one gives the time the boards needed."""
        self._read, self._is_good = True, good

    def _prepare(self, hub_node: int) -> None:
        """Read requests with every label, for this generation, hub and boards."""
        generation, away = self._link.generation, self._rows.away.tobytes()
        if away != self.made_for[2]:
            self._take_members()
        self._reads = [wire.block_read(hub_node, registers.HUB, self.blocks.length, tl, generation)
                       for tl in range(wire.TL_COUNT)]
        self.made_for = generation, hub_node, away

    @property
    def hub_node(self) -> int:
        """The node that replies."""
        return self.made_for[1]

    def _adapt_wait(self) -> None:
        """Wait as long as the last board needed the last time, if longer than the rule.

        If a block was missing, wait a little longer each time, until a good one gives the time it needed.
        """
        if not self._is_good:
            self._wait_ns = min(self._wait_ns + BOARD_WAIT_NS, MAX_WAIT_NS)
            return
        ticks = swapped(self.blocks.last.item()) & self._time_mask
        self._wait_ns = max(self._least_wait_ns, ticks * 1_000_000_000 // registers.CLOCK_HZ)


class UnaskedRead:
    """Ethernet-only: one query by multicast, and the nearest board sends all blocks unrequested.

    If that reply is lost, hub memory is read. The order of the blocks rarely changes. So the headers are compared at
    their last positions, and the order is determined again only when that fails.
    """

    def __init__(self, link: Link, rows: Rows) -> None:
        self._link, self._blocks = link, HubBlocks(link, rows, range(len(rows.board_ids)))
        self._row_of = {board: row for row, board in enumerate(rows.board_ids)}
        self._hub, self._tl = rows.hub, 0
        self._asked = self._sent = False

    def ask(self) -> None:
        """Query all boards."""
        link = self._link
        self._asked, self._sent = True, False
        if not link.ready():
            return
        sequence = link.next_sequence()
        self._tl = tl = link.next_tl()
        value = sequence << 16 | self._blocks.mask_of_boards
        self._sent = link.send(wire.quadlet_write(wire.BROADCAST, registers.QUERY, value, tl, link.generation,
                                                  link.flags))
        self._blocks.expect(sequence)

    def read(self) -> bool:
        """Sample every board."""
        link, found = self._link, self._blocks
        if not self._asked:
            self.ask()
        self._asked = False
        if not self._sent:
            return found.blame_all()
        patience_ms = max(1, link.cycle_timeout_ms // 2)
        size = link.receive(self._tl, patience_ms)
        if size == TIMED_OUT:
            tl = link.next_tl()
            link.send(wire.block_read(self._hub, registers.HUB, found.length, tl, link.generation, link.flags))
            size = link.receive(tl, patience_ms)
        source = found.source(size)
        if source not in self._row_of:
            return found.blame_reply(size, self._hub)
        self._hub = source
        if not found.take() and not (self._find_order() and found.take()):
            return found.blame()
        return True

    def _find_order(self) -> bool:
        """Learn the order of the blocks from their statuses; False if they are not those of all boards."""
        order, at, quads = [], DATA_AT, self._blocks.quads
        for _ in quads:
            status = _QUAD.unpack_from(self._link.rx, 4 * (at + 1 + blocks.STATUS))[0]
            row = self._row_of.get(registers.board_of(status), -1)
            if row < 0 or row in order:
                return False
            order.append(row)
            at += quads[row]
        self._blocks.order(order)
        return True


class SequentialRead:
    """A block read of every board, one after the other; stops at the first failure."""

    def __init__(self, link: Link, rows: Rows) -> None:
        self._link, self._rows, self._bus = link, rows, BusNodes(link, rows)
        self._quads = [layout.read_quads for layout in rows.layouts]
        self._starts = rows.starts(self._quads)
        self._sample = np.zeros(sum(self._quads), np.uint32)
        self._unpack = Unpack(rows, self._sample, self._starts, 0, range(len(rows.board_ids)))
        self._statuses = [swapped(status) for status in statuses(rows).tolist()]
        self._board_mask = swapped(BOARD_MASK)

    def ask(self) -> None:
        """No action: a board samples when it is read."""

    def read(self) -> bool:
        """Sample board after board, except those that are away."""
        rows, counters = self._rows, self._link.counters
        if not self._bus.settled():
            return self._bus.blame()
        dropped = counters.dropped
        for row, board in enumerate(rows.board_ids):
            if not rows.away[row] and not self._read_board(row, rows.nodes[board]):
                rows.bad[...] = False
                rows.bad[row] = True
                counters.board_bad_reads[row] += counters.dropped == dropped  # else the fault is the bus's
                return False
        self._unpack.run()
        rows.bad[...] = rows.away
        return True

    def _read_board(self, row: int, node: int) -> bool:
        link, quads = self._link, self._quads[row]
        if not link.ready():
            return False
        tl = link.next_tl()
        if not link.send(wire.block_read(node, registers.REAL_TIME, 4 * quads, tl, link.generation, link.flags)):
            return False
        size = link.receive(tl, link.cycle_timeout_ms)
        if size <= 0:
            link.counters.board_timeouts[row] += size == TIMED_OUT
            return False
        label, source, length = REPLY.unpack_from(link.rx)
        at = self._starts[row]
        self._sample[at : at + quads] = link.rx_quads[DATA_AT : DATA_AT + quads]
        if (size == 4 * quads + wire.BLOCK_OVERHEAD_BYTES and label & TCODE_BITS == wire.BLOCK_RESPONSE << 4
                and source >> 16 & 0x3F == node and length == 4 * quads
                and int(self._sample[at + blocks.STATUS]) & self._board_mask == self._statuses[row]):
            return True
        link.doubt()
        return False


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
        self.datagram_array, self.datagram_bytes = np.frombuffer(self.datagram, np.uint8), len(self.datagram)
        self.data = buffer[24 : 24 + self.length]
        quads = np.frombuffer(buffer, BIG_QUAD, self.length // 4, 24)
        self._boards = np.array(rows.board_ids, np.uint32)[:, np.newaxis]
        self._axis_bits = np.uint32(1) << np.arange(width, dtype=np.uint32)
        self._rev_7 = rows.layouts[0].firmware == 7  # its groups have no header and cannot be mixed with others
        if not self._rev_7:
            quads[[start // 4 for start in self.starts]] = [
                board << 8 | layout.write_quads for board, layout in zip(rows.board_ids, rows.layouts, strict=True)]
        # motors of every board, then its control word, which is the last column of its row
        self._quads, self.out, header = quads, rows.out, 0 if self._rev_7 else 1
        self.packed_from = np.concatenate([row * (width + 1) + np.array([*range(layout.motors), width])
                                           for row, layout in enumerate(rows.layouts)])
        self.packed_to = np.concatenate([start // 4 + header + np.arange(layout.motors + 1)
                                         for start, layout in zip(self.starts, rows.layouts, strict=True)])
        self.quads_count, (self.boards_count, self.columns) = len(self.packed_to), rows.out.shape
        self.board_ids, self.is_rev_7 = self._boards.reshape(-1), int(self._rev_7)
        (self.pack,) = chosen(WRITE, self)  # type: ignore[method-assign]

    def pack(self) -> int:
        """Put `rows.out` into the datagram, and the CRC of its data."""
        out = self._as_rev_7() if self._rev_7 else self.out
        self._quads[self.packed_to] = out.reshape(-1).take(self.packed_from)
        self.datagram[-4:] = wire.crc_bytes(self.data)
        return 0

    def _as_rev_7(self) -> Quads:
        """Rev 7 has the board id where later ones have the mode, and amplifier enables in the control word."""
        out = self.out.copy()
        dac, kept = self.out[:, :-1], registers.DAC_VALID | registers.DAC_COLLECT | registers.DAC_VALUE_MASK
        out[:, :-1] = dac & np.uint32(kept) | self._boards << registers.DAC_BOARD_SHIFT
        enable = (dac >> 28 & 1) @ self._axis_bits
        mask = (dac >> 29 & 1) @ self._axis_bits
        out[:, -1] |= enable << registers.CONTROL_AMP_SHIFT | mask << registers.CONTROL_AMP_MASK_SHIFT
        return out

    def sent(self) -> None:
        """Clear the control words, which act once: a power-on repeated every cycle would clear faults as they are
        latched.
        """
        self._rows.out[:, -1] = 0


class BroadcastWrite:
    """One datagram with the groups of all boards."""

    def __init__(self, link: Link, rows: Rows) -> None:
        self._link, self.groups = link, Groups(rows)
        self._made_for = -1
        self._heads: list[bytes] = []

    def write(self) -> bool:
        """Encode and send the groups of all boards."""
        link, groups = self._link, self.groups
        heads = self.heads()
        groups.pack()
        datagram = groups.datagram
        datagram[:22] = heads[link.next_tl()]
        if not link.send(datagram):
            return False
        groups.sent()
        return True

    def heads(self) -> list[bytes]:
        """Control word, header and header CRC for every label."""
        link = self._link
        if link.generation != self._made_for:
            data, generation, flags = bytes(self.groups.length), link.generation, link.flags
            self._heads = [wire.block_write(wire.BROADCAST, registers.REAL_TIME, data, tl, generation, flags)[:22]
                           for tl in range(wire.TL_COUNT)]
            self._made_for = generation
        return self._heads


class SequentialWrite:
    """One datagram a board."""

    def __init__(self, link: Link, rows: Rows) -> None:
        self._link, self._rows, self._groups = link, rows, Groups(rows)

    def write(self) -> bool:
        """Send board after board; a failed datagram does not stop the others."""
        link, rows, groups = self._link, self._rows, self._groups
        groups.pack()
        done = True
        for row, board in enumerate(rows.board_ids):
            if rows.away[row]:  # its node may be another's by now
                continue
            at = groups.starts[row]
            data = bytes(groups.data[at : at + groups.sizes[row]])
            node = rows.nodes[board]
            done &= link.send(wire.block_write(node, registers.REAL_TIME, data, link.next_tl(), link.generation,
                                               link.flags))
        if done:
            groups.sent()
        return done
