"""The broadcast query of Ethernet-only buses: the nearest board collects all blocks and sends them unrequested.

The order of the blocks rarely changes. So the headers are compared at their last positions, and the order is determined
again only when that fails.
"""

from __future__ import annotations

import struct

from trocar.procs.fpga import blocks, registers, wire
from trocar.procs.io.bus.link import TIMED_OUT, Link
from trocar.procs.io.bus.rows import DATA_AT, HubBlocks, Rows

_QUAD = struct.Struct(">I")


class UnaskedRead:
    """One query by multicast, one unrequested reply; if the reply is lost, hub memory is read."""

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
