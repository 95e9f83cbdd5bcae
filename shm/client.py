"""The sending end of a mailbox: one place in an owner's segment. The protocol stands in shm/mailbox.py."""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from shm.clock import monotonic_ns
from shm.commands import COMMANDS, WAKING
from shm.doorbell import Places
from shm.faults import Faults
from shm.header import SegmentError
from shm.mailbox import (
    CLIENTS,
    COMMAND_START,
    COMMANDS_DEPTH,
    COMMANDS_OF,
    CURSOR_BYTES,
    CURSORS,
    LAST_NUMBER,
    MAX_TEXT,
    MAX_VALUES,
    REPLIES_DEPTH,
    REPLY_BODY,
    REPLY_START,
    MailboxMap,
)
from shm.origins import NOBODY, Origin, Whose, new_id, program_name
from shm.pulse import Pulse
from shm.received import OUTCOMES

SEQUENCES = (tuple, list)
STREAM_NS = 100_000_000  # a stream that pauses so long has ended
FAR = 1 << 40  # commands; twenty years at 1500 Hz


class MailboxFull(Exception):
    """The owner has not taken our last commands; nothing was queued."""


@dataclass(frozen=True, slots=True)
class Reply:
    """What became of a command: outcome is accepted, refused, done or failed."""

    id: int
    outcome: str
    text: str


class Client:
    """The sending end: one place in an owner's mailbox. What it sends are commands of a person, see shm/origins.py."""

    is_person = True

    def __init__(self, system: str, instance: str) -> None:
        """Claim a free place; SegmentError when the instance has no mailbox or all places are taken."""
        places = self._map = MailboxMap(system, instance)
        segment = places.segment
        self.instance = instance
        self.kind = str(segment.header.info.get("kind", ""))
        rows = COMMANDS.get(self.kind, ())
        self._codes = {command.name: code for code, command in enumerate(rows)}
        self._streams = [command.streams for command in rows]
        self._faults = _faults(system) if self.is_person else None
        self._program, self._streamed_ns = program_name(), -STREAM_NS
        self.origin: Whose = NOBODY
        self._stream = NOBODY
        """Of what was sent last; `_stream`: of the stream under way."""
        self._words, self._view = places.words, places.view
        try:
            locks = Places(segment, places.first + CURSOR_BYTES * CURSORS.index("place"), CLIENTS)
            try:
                place = locks.claim(self._fit)
            except SegmentError:  # then one that is full
                place = locks.claim(partial(self._fit, room=0))
        except BaseException:
            segment.close()
            raise
        self._sent, self._taken = places.cursor("sent", place), places.cursor("taken", place)
        self._answered = places.cursor("answered", place)
        self._queue, self._replies = places.commands(place), places.replies(place)
        self._count: int = self._words[self._sent]
        self._known: int = self._words[self._taken]
        self._seen: int = self._words[self._answered]
        self._pulse = Pulse(system, instance, write=True) if self.kind in WAKING else None
        self._nap = self._pulse.nap() if self._pulse is not None else None
        self.lost = 0

    def _fit(self, place: int, room: int = 1) -> bool:
        """Whether a place's cursors make sense and it has room; one out of step is left for the owner to put right."""
        words, at = self._words, self._map.cursor("sent", place)
        sent, taken = words[at], words[self._map.cursor("taken", place)]
        answered = words[self._map.cursor("answered", place)]
        newest = words[self._map.replies(place)[answered % REPLIES_DEPTH] >> 3]
        waiting = sent - taken
        if 0 <= waiting <= COMMANDS_DEPTH and sent < LAST_NUMBER and (newest == answered or not answered):
            return bool(waiting + room <= COMMANDS_DEPTH)
        # further out of step, wherever the owner's own copy stands: it looks where a cursor moves
        words[at] = sent + 2 * COMMANDS_DEPTH if FAR <= sent < LAST_NUMBER - 2 * COMMANDS_DEPTH else FAR
        return False

    @property
    def commands(self) -> list[dict[str, Any]]:
        """The owner's command table, as its mailbox describes it."""
        listed = self._map.segment.header.info.get("commands")
        return [row for row in listed if isinstance(row, dict)] if isinstance(listed, list) else []

    def send(self, name: str, values: Any = (), text: str = "") -> int:
        """Queue a command, returns its id; MailboxFull when the owner does not keep up, KeyError: no such command.

        `values` are at most 64 numbers, a sequence or an array, `text` at most 64 bytes of UTF-8.
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
        at, now_ns = self._queue[n % COMMANDS_DEPTH] + COMMAND_START, monotonic_ns()
        origin = self._own_origin(self._streams[code], now_ns) if self.is_person else self.origin
        whose, by = (origin.id, origin.generation), origin.program.encode()
        try:
            COMMANDS_OF[count].pack_into(self._view, at, now_ns, n, *whose, code, count, by, encoded, *numbers)  # M2
        except struct.error:
            raise ValueError(f"{name}: {values!r} are not numbers") from None
        self._count = self._words[self._sent] = n  # M3
        if self._nap is not None:
            self._nap.rouse()
        return n

    def _own_origin(self, streams: bool, now_ns: int) -> Whose:
        """A stream is one command of a person: begun before a fault, it must not go on after it."""
        if streams:
            under_way, self._streamed_ns = now_ns - self._streamed_ns < STREAM_NS, now_ns
            if under_way:
                return self._stream
        generation = self._faults.generation() if self._faults is not None else 0
        self.origin = origin = Origin(new_id(), generation, self._program)
        if streams:
            self._stream = origin
        return origin

    def poll(self) -> list[Reply]:
        """Replies that came since the last call, in order; what was overwritten is counted in `lost`."""
        head: int = self._words[self._answered]  # B1
        if head == self._seen:
            return []
        if head < self._seen:  # no owner goes backwards; begin anew from here
            self._seen = head
            return []
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

    def close(self) -> None:
        """Free the place."""
        if self._pulse is not None:
            self._pulse.close()
        if self._faults is not None:
            self._faults.close()
        self._map.segment.close()


def _faults(system: str) -> Faults | None:
    """The fault page; without one commands are of generation 0: they count until there is a fault."""
    try:
        return Faults(system)
    except SegmentError:
        return None


class LoopClient(Client):
    """A client for loops, which ask again for what they want: a full mailbox is no error there.

    It is no person: what it passes on comes from somebody else's command, see `on_behalf`.
    """

    is_person = False

    def __init__(self, system: str, instance: str, is_over: Callable[[], bool] = bool) -> None:
        """`is_over`: our cycle began so long ago that nothing of it may be sent any more."""
        super().__init__(system, instance)
        self._is_over, self._predecessors = is_over, self._count

    def on_behalf(self, origin: Whose) -> None:
        """What is sent from now on comes from this command of a person."""
        self.origin = origin

    def send(self, name: str, values: Any = (), text: str = "") -> int:
        """Queue a command, returns its id; 0 when there was no room, or the time for it is over."""
        if self._is_over():
            return 0
        try:
            return super().send(name, values, text)
        except MailboxFull:
            return 0

    def poll(self) -> list[Reply]:
        """Replies to what we sent; those to a predecessor in this place, us before a pause, are nobody's."""
        found = super().poll()
        return [reply for reply in found if reply.id > self._predecessors] if found else found
