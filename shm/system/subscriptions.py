"""Subscriptions: the data that clients request from an instance. Data without a subscriber need not be computed.

Items: each topic of the instance, and each group of fields of a topic (shm/memory/rows.py), in the order in which the
info of its control page lists them; item n is bit n of a cell. A subscription to a group includes its topic. The last
bit, EVERY: the subscriber reads every record, so an instance at rest must not write fewer of them.

The control page has 64 places: a cell, a lock byte, and the holder's name. A client locks a place with a lock that the
kernel frees when the client ends (shm/memory/locks.py), and alone writes its cell; the instance reads all cells, and
writes none.

Come (client):      C1  lock a place      C2  cell := 0      C3  sign as holder
Want, drop:         D1  cell := wanted items
Go:                 G1  cell := 0         G2  unlock (closing the file does it)
Look (instance):    E1  copy all cells; unchanged? done      E2  wanted := all cells, or'ed
Clear (supervisor): F1  a cell is not 0   F2  lock its place; taken: its client is alive, done
                    F3  cell := 0         F4  unlock

A client that crashes leaves its cell unchanged and the lock free: the supervisor clears the cell in F, several times a
second, so that no process of the robot needs a system call for it. An earlier new client gets the place (C1) and clears
the cell itself (C2). Between F2 and F4 the place is locked: a new client takes another place, and if that was the last
one, tries again. So only the holder of the lock writes a cell. Between a crash and F3 too much is computed, never too
little: nothing else depends on it.

Memory order: none is needed. A cell is one aligned word, written by one move (shm/memory/order.py), and no other data
is read because of it. E1 copies 64 words, each whole but not all of one moment: a subscription made meanwhile is seen
in the next cycle. Clients wait for a valid value, or look at incoming records.
"""

from __future__ import annotations

import os
import struct
from typing import Any

from trocar.shm.memory.header import readable
from trocar.shm.memory.holders import HOLDER, PROGRAM, Holder, in_words
from trocar.shm.memory.layout import cut_text
from trocar.shm.memory.locks import AllTaken, Places
from trocar.shm.memory.segment import SegmentError
from trocar.shm.time.clock import pause
from trocar.shm.time.control_page import CELL_BITS, SCHEMA, SUBSCRIBERS, ControlPage, wanted_name

CELLS = struct.Struct(f"<{SUBSCRIBERS}Q")
NO_CELLS = bytes(CELLS.size)
EVERY = 1 << CELL_BITS
TRIES, PAUSE_S = 5, 0.002
"""Of coming where all places are taken: one may be being cleared."""


class Cells:
    """Positions of the cells and lock bytes in a control page, and the meaning of each bit."""

    def __init__(self, page: ControlPage) -> None:
        self.page, segment = page, page.segment
        first = segment.header.first
        listed: Any = segment.header.info.get("wanted", ())
        self.names = tuple(str(name) for name in listed)[:CELL_BITS] if isinstance(listed, list) else ()
        self.at = (first + SCHEMA.offset("wanted")) // 8  # as words
        self.bytes = segment.keep(segment.view[8 * self.at : 8 * self.at + CELLS.size])
        self.places = Places(segment, first + SCHEMA.offset("place"), SUBSCRIBERS)
        self.holders_at = first + SCHEMA.offset("holder")

    def bits(self, topic: str, group: str = "") -> int:
        """The bits of a topic, and of a group of it; SegmentError if the instance lacks them."""
        try:
            found = 1 << self.names.index(topic)
            return found | 1 << self.names.index(wanted_name(topic, group)) if group else found
        except ValueError:
            raise SegmentError(f"{self.page.instance} has no {wanted_name(topic, group)} to subscribe to; "
                               f"it has: {', '.join(self.names) or 'nothing'}") from None

    def holder(self, place: int) -> Holder:
        """The last client that signed for a place."""
        pid, program = HOLDER.unpack_from(self.page.segment.view, self.holders_at + place * HOLDER.size)
        return Holder(pid, readable(program))


class Subscriptions:
    """The instance's end: the requested data. Call `look` each cycle; `wanted` has a bit for each item."""

    def __init__(self, page: ControlPage) -> None:
        """On the instance's own page, which closes it."""
        self._cells = Cells(page)
        self._bytes, self._seen = self._cells.bytes, NO_CELLS
        self.wanted = 0

    def bits(self, topic: str, group: str = "") -> int:
        """The bits in `wanted` of a topic, or of one of its groups alone; SegmentError if there is no such item."""
        both = self._cells.bits(topic, group)
        return both & ~self._cells.bits(topic) if group else both

    def look(self) -> bool:
        """Whether `wanted` has changed since the last call; a copy and a comparison of bytes when it has not."""
        cells = self._bytes.tobytes()  # E1
        if cells == self._seen:
            return False
        self._seen, before, wanted = cells, self.wanted, 0
        for cell in CELLS.unpack(cells):
            wanted |= cell
        self.wanted = wanted  # E2
        return wanted != before


class Subscriber:
    """A client's end, for one thread: it has a place until it is closed or its process ends."""

    def __init__(self, system: str, instance: str, program: str = "", *, every: bool = False) -> None:
        """Take a place; SegmentError when there is no such instance, or names the holders of all places.

        `program`: shown to others as the place's holder. `every`: its topics are wanted at full rate.
        """
        self._page, self._pid, self._wanted = ControlPage(system, instance, write=True), os.getpid(), 0
        self._every = EVERY if every else 0
        try:
            self._cells = Cells(self._page)
            self._words = self._page.segment.words()
            self.place = self._come(instance)  # C1
            self._at = self._cells.at + self.place
        except BaseException:
            self._page.close()
            raise
        self._words[self._at] = 0  # C2
        at = self._cells.holders_at + self.place * HOLDER.size
        HOLDER.pack_into(self._page.segment.view, at, self._pid, cut_text(program, PROGRAM))  # C3

    def _come(self, instance: str) -> int:
        for _ in range(TRIES):
            try:
                return self._cells.places.claim(lambda place: True)
            except AllTaken as error:
                taken = error.places
            pause(PAUSE_S)
        holders = in_words(self._cells.holder(place) for place in taken)
        raise AllTaken(f"{instance}: all {SUBSCRIBERS} places for subscriptions are taken: {holders}; close one", taken)

    def want(self, topic: str, *groups: str) -> None:
        """Subscribe to a topic and groups of its fields; SegmentError if there is no such item."""
        for group in groups or ("",):
            self._set(self._wanted | self._cells.bits(topic, group) | self._every)

    def drop(self, topic: str, *groups: str) -> None:
        """Unsubscribe from groups; without groups from the whole topic."""
        cells = self._cells
        whole, gone = cells.bits(topic), 0
        for group in groups:
            gone |= cells.bits(topic, group) & ~whole
        if not groups:
            gone = sum(1 << bit for bit, name in enumerate(cells.names) if name.split("/")[0] == topic)
        left = self._wanted & ~gone
        self._set(left if left & ~EVERY else 0)

    def _set(self, wanted: int) -> None:
        if wanted != self._wanted:
            self._wanted = self._words[self._at] = wanted  # D1

    def close(self) -> None:
        """End all subscriptions and release the place; a forked child leaves its parent's unchanged."""
        if os.getpid() == self._pid:
            self._set(0)  # G1
        self._page.close()  # G2


class Clearing:
    """The supervisor's end: clears the cells that crashed clients left in a page."""

    def __init__(self, page: ControlPage) -> None:
        """On a page that is open for writing, and closes it."""
        self._cells, self._words = Cells(page), page.segment.words()

    def clear(self) -> int:
        """Clear the cells of crashed clients; returns how many. No system call without subscriptions."""
        cells, cleared = self._cells, 0
        now = cells.bytes.tobytes()
        if now == NO_CELLS:
            return 0
        for place, cell in enumerate(CELLS.unpack(now)):
            if cell and cells.places.take(place):  # F1, F2
                self._words[cells.at + place] = 0  # F3
                cells.places.give_back(place)  # F4
                cleared += 1
        return cleared
