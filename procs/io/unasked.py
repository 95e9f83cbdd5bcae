"""The broadcast query of Ethernet-only buses: the board nearest to us sends what all have told it, unasked.

Blocks come in any order, but hardly ever in another than the last time; so the wanted headers are compared where they
were, and the order is looked up anew only when that fails.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence

import numpy as np

from procs.io.link import TIMED_OUT, Link
from procs.io.protocols import BOARD_MASK, DATA_AT, Rows, Unpack, statuses, swapped
from procs.lib import blocks, registers, wire

_REPLY = struct.Struct(">xxHIxxxxH")  # label and tcode; source; length
_QUAD = struct.Struct(">I")
_TCODE_BITS = 0xF0


class UnaskedRead:
    """One query by multicast, one reply that nobody asked for; when that is lost, hub memory is read."""

    def __init__(self, link: Link, rows: Rows) -> None:
        self._link, self._rows = link, rows
        self._mask_of_boards = sum(1 << board for board in rows.board_ids)
        self._row_of = {board: row for row, board in enumerate(rows.board_ids)}
        self._hub, self._sequence, self._tl = rows.hub, 0, 0
        self._asked = self._sent = False
        self._quads = [layout.hub_quads for layout in rows.layouts]
        self._length = 4 * (sum(self._quads) + 1)
        self._check = np.array([(swapped(layout.check_mask), swapped(BOARD_MASK)) for layout in rows.layouts],
                               np.uint32)
        count = len(rows.board_ids)
        self._masked, self._expected = np.zeros((count, 2), np.uint32), np.zeros((count, 2), np.uint32)
        self._expected[:, 1] = statuses(rows).byteswap()
        self._expect(range(count))

    def _expect(self, order: Sequence[int]) -> None:
        """Blocks will come in this order of rows."""
        heads, at = [0] * len(self._quads), DATA_AT
        for row in order:
            heads[row] = at
            at += self._quads[row]
        self._heads = np.array([(head, head + 1 + blocks.STATUS) for head in heads], np.intp)
        self._unpack = Unpack(self._rows, self._link.rx_quads, [head + 1 for head in heads], header=1)

    def ask(self) -> None:
        """Query all boards."""
        link = self._link
        if link.suspect:
            link.drain()
        self._sequence = sequence = self._sequence % 0xFFFF + 1
        self._tl = tl = link.next_tl()
        value = sequence << 16 | self._mask_of_boards
        self._sent = link.send(wire.quadlet_write(wire.BROADCAST, registers.QUERY, value, tl, link.generation,
                                                  link.flags))
        self._expected[:, 0] = [swapped(layout.header(sequence)) for layout in self._rows.layouts]
        self._asked = True

    def read(self) -> bool:
        """Sample every board."""
        link = self._link
        if not self._asked:
            self.ask()
        self._asked = False
        if not self._sent:
            return self._blame_all()
        patience_ms = max(1, link.cycle_timeout_ms // 2)
        size = link.receive(self._tl, patience_ms)
        if size == TIMED_OUT:
            tl = link.next_tl()
            link.send(wire.block_read(self._hub, registers.HUB, self._length, tl, link.generation, link.flags))
            size = link.receive(tl, patience_ms)
        if size != self._length + wire.BLOCK_OVERHEAD_BYTES:
            return self._blame_all(silent=size == TIMED_OUT)
        label, source, length = _REPLY.unpack_from(link.rx)
        source = source >> 16 & 0x3F
        if label & _TCODE_BITS != wire.BLOCK_RESPONSE << 4 or source not in self._row_of or length != self._length:
            link.counters.stray += 1
            return self._blame_all()
        self._hub = source
        if not self._is_expected() and not (self._find_order() and self._is_expected()):
            return self._blame_some()
        self._unpack.run()
        return True

    def _is_expected(self) -> bool:
        """Every board's header and status are where they were the last time, and answer this query."""
        self._link.rx_quads.take(self._heads, out=self._masked, mode="clip")
        np.bitwise_and(self._masked, self._check, self._masked)
        return self._masked.tobytes() == self._expected.tobytes()

    def _find_order(self) -> bool:
        """Learn the order of the blocks from their statuses; False where they are not those of all boards."""
        order, at = [], DATA_AT
        for _ in self._quads:
            status = _QUAD.unpack_from(self._link.rx, 4 * (at + 1 + blocks.STATUS))[0]
            row = self._row_of.get(registers.board_of(status), -1)
            if row < 0 or row in order:
                return False
            order.append(row)
            at += self._quads[row]
        self._expect(order)
        return True

    def _blame_all(self, *, silent: bool = False) -> bool:
        rows, counters = self._rows, self._link.counters
        rows.bad[...] = True
        counters.board_bad_reads += 1
        if silent and self._hub in self._row_of:
            counters.board_timeouts[self._row_of[self._hub]] += 1
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
