"""A place in a mailbox: the sending end. shm/mailbox/mailbox.py describes the protocol.

Programs use shm/mailbox/client.py, where all handles of a process to one mailbox share one place.
"""

from __future__ import annotations

import os
import struct
from functools import partial
from typing import Any

import numpy as np

from trocar.shm.mailbox.command_row import CommandRow
from trocar.shm.mailbox.mailbox import LAST_NUMBER
from trocar.shm.mailbox.mailbox_map import (
    CLIENTS,
    COMMAND_HEAD,
    COMMAND_START,
    COMMANDS_DEPTH,
    COMMANDS_OF,
    MAX_TEXT,
    MAX_VALUES,
    REPLIES_DEPTH,
    REPLY_BODY,
    REPLY_START,
    RESERVED,
    MailboxMap,
)
from trocar.shm.mailbox.messages import Reply
from trocar.shm.mailbox.origins import NO_ORIGIN, PROGRAM_BYTES, Origin
from trocar.shm.mailbox.received import OUTCOMES
from trocar.shm.memory.header import SegmentError
from trocar.shm.memory.locks import AllTaken, Places
from trocar.shm.time.clock import monotonic_ns, pause
from trocar.shm.time.control_page import ControlPage

SEQUENCES = (tuple, list)
FAR = 1 << 40  # commands; twenty years at 1500 Hz
STOP_TRIES, STOP_PAUSE_S = 200, 0.001  # while another process stores a stop, or the place for stops is out of step


class MailboxFull(Exception):
    """The owner has not taken our last commands; nothing was queued."""


class Place:
    """A place in an owner's mailbox, once it is claimed; for one thread of one process."""

    def __init__(self, system: str, instance: str, program: str = "") -> None:
        """Attach; SegmentError when the instance has no mailbox. `program`: shown to others as the place's holder."""
        self._map = places = MailboxMap(system, instance)
        self.instance, self.kind, self._program = instance, places.kind, program
        self._codes = {command.name: code for code, command in enumerate(places.table)}
        self._words, self._view = places.words, places.view
        self._locks = Places(places.segment, places.locks, CLIENTS)
        self._page: ControlPage | None = None
        try:
            self._page = ControlPage(system, instance, write=True) if places.wakes else None
        except BaseException:
            places.segment.close()
            raise
        self._wakeup = self._page.wakeup() if self._page is not None else None
        self.lost = 0

    def claim(self) -> None:
        """Take a free place; SegmentError names the holders if none is free. Given back at close."""
        try:
            try:
                place = self._locks.claim(self._fit)
            except AllTaken:  # then one that is full
                place = self._locks.claim(partial(self._fit, room=0))
        except AllTaken as error:
            spoilt = CLIENTS - len(error.places)
            others = f"; {spoilt} are out of step until {self.instance} runs again" if spoilt else ""
            raise AllTaken(f"{self.instance}: all {CLIENTS} places for commands are taken: "
                           f"{self._map.holders(error.places)}{others}; close one", error.places) from None
        self._look_at(place)
        self._go_on(place)
        self._seen = self._words[self._answered]

    def _look_at(self, place: int) -> None:
        places = self._map
        self._sent, self._taken = places.cursor("sent", place), places.cursor("taken", place)
        self._answered = places.cursor("answered", place)
        self._queue, self._replies = places.commands(place), places.replies(place)

    def _go_on(self, place: int) -> None:
        """Resume at the cursors of the last client in this place, and sign as its holder."""
        self._count: int = self._words[self._sent]
        self._known: int = self._words[self._taken]
        self._map.sign(place, os.getpid(), self._program)

    def _fit(self, place: int, room: int = 1) -> bool:
        """Whether a place's cursors make sense and it has room; one out of step is left for the owner to put right."""
        words, at = self._words, self._map.cursor("sent", place)
        sent, taken = words[at], words[self._map.cursor("taken", place)]
        answered = words[self._map.cursor("answered", place)]
        newest = words[self._map.reply(place, answered) >> 3]
        if newest != answered != words[self._map.cursor("answered", place)]:
            newest = answered  # the owner has come round meanwhile
        waiting = sent - taken
        if 0 <= waiting <= COMMANDS_DEPTH and sent < LAST_NUMBER and (newest == answered or not answered):
            return bool(waiting + room <= COMMANDS_DEPTH)
        # further out of step, whatever the owner's own copy is: it looks where a cursor moves
        words[at] = sent + 2 * COMMANDS_DEPTH if FAR <= sent < LAST_NUMBER - 2 * COMMANDS_DEPTH else FAR
        return False

    @property
    def addresses(self) -> tuple[list[int], list[int], list[int]]:
        """Addresses of our cursors sent, taken and answered, of the slots of our commands, and of those of our replies.

        For code that sends in our place; see Segment.address.
        """
        begin = self._map.segment.address
        return ([begin + 8 * at for at in (self._sent, self._taken, self._answered)],
                [begin + at + COMMAND_START for at in self._queue], [begin + at for at in self._replies])

    @property
    def cursors(self) -> tuple[int, int, int]:
        """Commands sent, known to be taken, and replies seen; to be set by code that sends in our place."""
        return self._count, self._known, self._seen

    @cursors.setter
    def cursors(self, values: tuple[int, int, int]) -> None:
        self._count, self._known, self._seen = values

    def head(self, name: str, count: int, origin: Origin) -> bytes:
        """The begin of a command with this many values, without stamp and number."""
        return COMMAND_HEAD.pack(0, 0, origin.id, origin.generation, self._codes[name], count, 0) + struct.pack(
            f"{PROGRAM_BYTES}s{MAX_TEXT}s", origin.program.encode(), b"")

    def wake(self) -> None:
        """Wake the owner, if it sleeps between its cycles."""
        if self._wakeup is not None:
            self._wakeup.wake()

    @property
    def wakes(self) -> bool:
        """Whether the owner sleeps between its cycles, so that a command wakes it."""
        return self._wakeup is not None

    @property
    def table(self) -> tuple[CommandRow, ...]:
        """The commands that the owner accepts."""
        return self._map.table

    @property
    def commands(self) -> list[dict[str, Any]]:
        """The owner's command table, as its mailbox describes it."""
        listed = self._map.segment.header.info.get("commands")
        return [row for row in listed if isinstance(row, dict)] if isinstance(listed, list) else []

    def send(self, name: str, values: Any = (), text: str = "", origin: Origin = NO_ORIGIN, peer: int = 0,
             wake: bool = True, sent_ns: int = 0) -> int:
        """Queue a command, returns its id; MailboxFull if the owner does not keep up, KeyError: no such command.

        `values` are at most 64 numbers, a sequence or an array, `text` at most 64 bytes of UTF-8; `origin`: of the
        person's command behind it; `peer`: see SenderId. Without `wake` the owner sees it at its next look. `sent_ns`:
        when a client of ours sent it at the earliest, on CLOCK_MONOTONIC; 0: now.
        """
        code = self._codes.get(name)
        if code is None:
            raise KeyError(f"{self.kind} has no command {name}; it has: {', '.join(self._codes)}")
        numbers = values if values.__class__ in SEQUENCES else np.asarray(values, dtype=np.float64).reshape(-1)
        count = len(numbers)
        if count > MAX_VALUES:
            raise ValueError(f"{name}: {count} values; allowed are {MAX_VALUES}")
        encoded = text.encode() if text else b""
        if len(encoded) > MAX_TEXT:
            raise ValueError(f"{name}: the text has {len(encoded)} bytes; allowed are {MAX_TEXT}")
        n = self._count + 1
        if n - self._known > COMMANDS_DEPTH:  # M1; the cell is on the owner's core: looked at when it matters
            self._known = self._words[self._taken]
            if n - self._known > COMMANDS_DEPTH:
                raise MailboxFull(f"{self.instance} has not taken the last {COMMANDS_DEPTH} commands")
        at, whose, by = self._queue[n % COMMANDS_DEPTH] + COMMAND_START, (origin.id, origin.generation), origin.program
        when_ns = sent_ns or monotonic_ns()
        try:
            COMMANDS_OF[count].pack_into(
                self._view, at, when_ns, n, *whose, code, count, peer, by.encode(), encoded, *numbers)  # M2
        except struct.error:
            raise ValueError(f"{name}: {values!r} are not numbers") from None
        self._count = self._words[self._sent] = n  # M3
        if wake:
            self.wake()
        return n

    def poll(self) -> list[Reply]:
        """Replies since the last call, in order; overwritten ones are counted in `lost`."""
        head: int = self._words[self._answered]  # B1
        if head == self._seen:
            return []
        if head < self._seen:  # owners never go backwards: our copy was not the owner's, so check the slots
            self._seen = max(0, head - REPLIES_DEPTH)
        begin = max(self._seen + 1, head - REPLIES_DEPTH + 1)
        self.lost += begin - self._seen - 1
        self._seen = head
        found = []
        for n in range(begin, head + 1):
            at = self._replies[n % REPLIES_DEPTH]
            number, outcome, raw = REPLY_BODY.unpack_from(self._view, at + REPLY_START)  # B2
            if self._words[at >> 3] == n:  # B3
                text = raw.rstrip(b"\0").decode(errors="replace")
                found.append(Reply(number, OUTCOMES.get(outcome, "unknown"), text))
            else:
                self.lost += 1
        return found

    @property
    def file(self) -> tuple[int, int]:
        """Identity of the file under the mailbox's name: a restarted system has new files."""
        status = os.fstat(self._map.segment.fd)
        return status.st_dev, status.st_ino

    def close(self) -> None:
        """Unmap, and free the place."""
        if self._page is not None:
            self._page.close()
        self._map.segment.close()


def take_place(system: str, instance: str, program: str = "") -> Place:
    """A place of one's own; SegmentError if there is no such mailbox or all places are taken."""
    place = Place(system, instance, program)
    try:
        place.claim()
    except BaseException:
        place.close()
        raise
    return place


class StopPlace(Place):
    """The place for stops, with no permanent holder: taken only while a stop is stored; its answer is read without it.

    Commands sent through it have negative numbers; those from a client's own place do not.
    """

    def __init__(self, system: str, instance: str, program: str = "") -> None:
        """Attach; SegmentError when the instance has no mailbox."""
        super().__init__(system, instance, program)
        self._look_at(RESERVED)
        self._waiting: set[int] = set()

    def stop(self, name: str, values: Any = (), text: str = "", tries: int = STOP_TRIES, origin: Origin = NO_ORIGIN,
             peer: int = 0) -> int:
        """Queue a stop, returns its number; SegmentError names a process that occupies the place and does not leave it.

        MailboxFull if the owner has not taken the last ones; `tries` are a millisecond each.
        """
        try:
            self._enter(tries)
            number = self.send(name, values, text, origin, peer)
        finally:
            self._locks.give_back(RESERVED)  # L3
        if len(self._waiting) >= REPLIES_DEPTH:  # their answers have been overwritten
            self._waiting.clear()
        self._waiting.add(number)
        return -number

    def _enter(self, tries: int) -> None:
        locks = self._locks
        for left in reversed(range(tries)):
            taken = not locks.take(RESERVED)  # L1
            if not taken and self._fit(RESERVED, room=0):
                self._go_on(RESERVED)  # L2
                if not self._waiting:
                    self._seen = self._words[self._answered]
                return
            if not taken:
                locks.give_back(RESERVED)
            if left:
                pause(STOP_PAUSE_S)
        why = f"taken: {self._map.holders([RESERVED])}" if taken else f"out of step until {self.instance} runs again"
        raise SegmentError(f"{self.instance}: the place for stops is {why}")

    def answers(self) -> list[Reply]:
        """Replies to our stops since the last call."""
        if not self._waiting:
            return []
        found = [reply for reply in self.poll() if reply.id in self._waiting]
        self._waiting.difference_update(reply.id for reply in found if reply.outcome != "accepted")
        return [Reply(-reply.id, reply.outcome, reply.text) for reply in found]
