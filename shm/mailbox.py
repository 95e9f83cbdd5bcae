"""The mailbox: commands to one owner from up to 16 clients; each client has a queue and a reply ring of its own.

One segment. Each place has: a command queue (single producer, single consumer), a reply ring, and three cursors.

Submit (client):  M1 sent − taken < depth, else MailboxFull   M2 write the slot   M3 sent := sent + 1
Drain (owner):    N1 sent ≠ taken?   N2 copy the slot   N3 taken := taken + 1   N4 run it, write the reply, answered + 1
Reply (owner):    slot.sequence := 0, payload, slot.sequence := n, answered := n; read as a ring is read (shm/ring.py)

N3 comes before N4: a command runs at most once, also when the owner dies in between; the client then gets no reply and
sees the owner's epoch change. An owner that begins refuses what is waiting: a move or a power-on asked of its
predecessor must not happen whenever it comes back. A client claims a place with a lock that the kernel frees when it
dies; its successor goes on from the cursors, commands that were accepted (M3 done) are still run.

Nothing here is looked up by name or built by numpy while commands travel: a slot is one `struct` call into the map on
the way in, one copy of the bytes in use on the way out; values and text are decoded when somebody asks for them.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shm.commands import COMMANDS, Command
from shm.doorbell import claim_place
from shm.layout import LINE, Schema, cut_text, schema_from_json, schema_of
from shm.ring import attach
from shm.segment import Segment, SegmentError, create, segment_name
from shm.topics import COMMAND, REPLY

CLIENTS = 16
PER_CYCLE = 8
COMMANDS_DEPTH = COMMAND.depth
REPLIES_DEPTH = REPLY.depth
COMMAND_SCHEMA = schema_of(COMMAND)
REPLY_SCHEMA = schema_of(REPLY)
ACCEPTED, REFUSED, DONE, FAILED = 1, 2, 3, 4
OUTCOMES = {ACCEPTED: "accepted", REFUSED: "refused", DONE: "done", FAILED: "failed"}

# What the rows of the topic table come to; tests compare these with the schemas.
COMMAND_HEAD = struct.Struct("<QHH64s")  # id, code, count, text
HEAD_START = COMMAND_SCHEMA.offset("id")
TEXT_START = COMMAND_SCHEMA.offset("text")
VALUES_START = COMMAND_SCHEMA.offset("values")
VALUES_IN_RAW = VALUES_START - TEXT_START
FLOAT = np.dtype(np.float64)
ID_WORD = HEAD_START // 8
COUNT_WORD = COMMAND_SCHEMA.offset("code") // 8  # code in its lowest 16 bits, count in the next
MAX_VALUES, MAX_TEXT = 64, 64
VALUES = tuple(struct.Struct(f"<{n}d") for n in range(MAX_VALUES + 1))
REPLY_BODY = struct.Struct("<QB200s")  # id, outcome, text
REPLY_START = REPLY_SCHEMA.offset("id")
REPLY_TEXT = 199

# The segment's one "slot": cursors (arrays over the places, each cell with one writer), then the queues.
CURSORS = ("sent", "taken", "answered", "place")  # the bytes of "place" are never written: clients lock them
CURSOR_BYTES = LINE * 2
QUEUES_AT = CURSOR_BYTES * len(CURSORS)
PLACE_BYTES = COMMANDS_DEPTH * COMMAND_SCHEMA.stride + REPLIES_DEPTH * REPLY_SCHEMA.stride
WHOLE = schema_from_json(
    b'{"topic":"mailbox","fields":[{"name":"cursors","dtype":"(4,16)<u8"},{"name":"queues","dtype":"(%d,)u1"}]}'
    % (CLIENTS * PLACE_BYTES)
)
CURSOR_BITS = tuple((2**64 - 1) << 64 * place for place in range(CLIENTS))
SEQUENCES = (tuple, list)
NOBODY = bytes(8 * CLIENTS)


class MailboxFull(Exception):
    """The owner has not taken our last commands; nothing was queued."""


@dataclass(frozen=True, slots=True)
class Reply:
    """What became of a command: outcome is accepted, refused, done or failed."""

    id: int
    outcome: str
    text: str


def create_mailbox(system: str, instance: str, kind: str, *, mode: int = 0o600, group: int = -1) -> int:
    """Make the mailbox of an instance of `kind`; returns its size."""
    commands = [{"name": c.name, "values": c.values, "text": c.text, "doc": c.doc, "moves": c.moves}
                for c in COMMANDS.get(kind, ())]
    info = {"kind": kind, "commands": commands}
    return create(segment_name(system, instance, "mailbox"), "mailbox", WHOLE, 1, info, mode=mode, group=group)


class _Places:
    """Where the cursors and slots of all places lie: cursors as indices of words, slots as byte offsets."""

    def __init__(self, system: str, instance: str) -> None:
        self.segment = Segment(segment_name(system, instance, "mailbox"), write=True)
        try:
            attach(self.segment, "mailbox", WHOLE)
        except BaseException:
            self.segment.close()
            raise
        self.first = self.segment.header.first + 16  # behind the slot's own sequence and stamp
        self.words = self.segment.words()
        self.view = self.segment.view

    def cursor(self, which: str, place: int) -> int:
        """Index of a cursor in `words`."""
        return (self.first + CURSORS.index(which) * CURSOR_BYTES) // 8 + place

    def commands(self, place: int) -> list[int]:
        """Offsets of the command slots of a place."""
        return self._slots(COMMAND_SCHEMA, place, 0, COMMANDS_DEPTH)

    def replies(self, place: int) -> list[int]:
        """Offsets of the reply slots of a place."""
        return self._slots(REPLY_SCHEMA, place, COMMANDS_DEPTH * COMMAND_SCHEMA.stride, REPLIES_DEPTH)

    def _slots(self, schema: Schema, place: int, offset: int, depth: int) -> list[int]:
        start = self.first + QUEUES_AT + place * PLACE_BYTES + offset
        return [start + i * schema.stride for i in range(depth)]


class Received:
    """One command on the owner's side; answer it once with accept/refuse, and later done/fail if it takes time."""

    __slots__ = ("_box", "_place", "_raw", "_values", "command", "id")

    def __init__(
        self, box: Mailbox, place: int, number: int, command: Command, raw: bytearray
    ) -> None:
        self._box, self._place, self._raw = box, place, raw
        self.id, self.command = number, command
        self._values: NDArray[np.float64] | None = None

    @property
    def name(self) -> str:
        """The command's name."""
        return self.command.name

    @property
    def values(self) -> NDArray[np.float64]:
        """Its numbers, as many as were sent; our own copy."""
        if self._values is None:
            count = len(self._raw) - VALUES_IN_RAW >> 3
            self._values = np.ndarray((count,), FLOAT, self._raw, VALUES_IN_RAW)
        return self._values

    @property
    def text(self) -> str:
        """Its text argument."""
        return self._raw[:MAX_TEXT].rstrip(b"\0").decode(errors="replace")

    def accept(self, text: str = "") -> None:
        """It is under way; `done` or `fail` follows when it takes time."""
        self._box.answer(self._place, self.id, ACCEPTED, text)

    def refuse(self, reason: str) -> None:
        """It will not be done, because of `reason`."""
        self._box.answer(self._place, self.id, REFUSED, reason)

    def done(self, text: str = "") -> None:
        """It has been carried out."""
        self._box.answer(self._place, self.id, DONE, text)

    def fail(self, reason: str) -> None:
        """It was accepted and has failed, because of `reason`."""
        self._box.answer(self._place, self.id, FAILED, reason)


class Mailbox:
    """The owner's end."""

    def __init__(self, system: str, instance: str, kind: str) -> None:
        """Claim the mailbox of `instance`."""
        places = self._places = _Places(system, instance)
        try:
            places.segment.claim(instance)
        except BaseException:
            places.segment.close()
            raise
        self._table = COMMANDS.get(kind, ())
        self._view, self._words = places.view, places.words
        self._sent_bytes = places.segment.keep(places.view[places.first : places.first + len(NOBODY)])
        self._sent = [places.cursor("sent", p) for p in range(CLIENTS)]
        self._taken_at = [places.cursor("taken", p) for p in range(CLIENTS)]
        self._answered_at = [places.cursor("answered", p) for p in range(CLIENTS)]
        # ours alone, the cells in the segment only tell the clients: whatever they write there, our loop goes on
        self._taken = [_sane(self._words[i]) for i in self._taken_at]
        self._answered = [_sane(self._words[i]) for i in self._answered_at]
        self._queues = [places.commands(p) for p in range(CLIENTS)]
        self._replies = [places.replies(p) for p in range(CLIENTS)]
        self._seen, self._seen_cursors, self._backlog = NOBODY, 0, sum(CURSOR_BITS)
        self._last = 0

    def drain(self) -> Iterator[Received]:
        """Commands that came in, in each client's order, at most 8 a client; unknown ones are refused here."""
        sent = self._sent_bytes.tobytes()
        if sent == self._seen and not self._backlog:  # N1 for all places at once
            return iter(())
        return self._drain(sent)

    def refuse_waiting(self, reason: str) -> None:
        """Refuse all that came in before now: an owner that begins must not act on what its predecessor was told."""
        for _ in range(COMMANDS_DEPTH // PER_CYCLE):
            for command in self.drain():
                command.refuse(reason)

    def _drain(self, sent: bytes) -> Iterator[Received]:
        """Serve the client that came last, without looking who else has come; then all whose cursors have moved.

        A place stays in the backlog until nothing waits in it, also when the caller leaves the loop early.
        """
        first = self._last
        yield from self._serve(first)
        cursors = int.from_bytes(sent, "little")
        changed = cursors ^ self._seen_cursors | self._backlog
        self._seen, self._seen_cursors, self._backlog = sent, cursors, changed
        while changed:
            place = (changed & -changed).bit_length() - 1 >> 6
            changed &= ~CURSOR_BITS[place]
            if place != first:
                yield from self._serve(place)
            if not 0 < self._words[self._sent[place]] - self._taken[place] <= COMMANDS_DEPTH:
                self._backlog &= ~CURSOR_BITS[place]

    def _serve(self, place: int) -> Iterator[Received]:
        taken = self._taken[place]
        waiting = self._words[self._sent[place]] - taken
        if 0 < waiting <= COMMANDS_DEPTH:  # other cursors no honest client writes; they are left alone
            self._last = place
            for n in range(taken + 1, taken + 1 + min(waiting, PER_CYCLE)):
                received = self._take(place, n)
                if received is not None:
                    yield received

    def _take(self, place: int, n: int) -> Received | None:
        at = self._queues[place][n % COMMANDS_DEPTH]
        number: int = self._words[(at >> 3) + ID_WORD]
        counted = self._words[(at >> 3) + COUNT_WORD]
        code, count = counted & 0xFFFF, counted >> 16 & 0xFFFF
        end = at + VALUES_START + 8 * min(count, MAX_VALUES)
        raw = bytearray(self._view[at + TEXT_START : end])  # N2
        self._taken[place] = self._words[self._taken_at[place]] = n  # N3
        if count > MAX_VALUES:
            wrong = f"{count} values; allowed are {MAX_VALUES}"
        elif code >= len(self._table):
            wrong = f"command {code} is not in the table"
        else:
            return Received(self, place, number, self._table[code], raw)
        self.answer(place, number, REFUSED, wrong)
        return None

    def answer(self, place: int, number: int, outcome: int, text: str) -> None:
        """Write a reply; the oldest is overwritten when a client does not read its replies."""
        words = self._words
        n = self._answered[place] + 1
        at = self._replies[place][n % REPLIES_DEPTH]
        words[at >> 3] = 0
        REPLY_BODY.pack_into(self._view, at + REPLY_START, number, outcome, cut_text(text, REPLY_TEXT))
        words[at >> 3] = n
        self._answered[place] = words[self._answered_at[place]] = n

    def close(self) -> None:
        """Give the claim back."""
        self._places.segment.close()


def _sane(cursor: int) -> int:
    return cursor if cursor < 2**62 else 0


class Client:
    """The sending end: one place in an owner's mailbox."""

    def __init__(self, system: str, instance: str) -> None:
        """Claim a free place; SegmentError when the instance has no mailbox or all places are taken."""
        places = self._places = _Places(system, instance)
        segment = places.segment
        self.instance = instance
        self.kind = str(segment.header.info.get("kind", ""))
        self._codes = {command.name: code for code, command in enumerate(COMMANDS.get(self.kind, ()))}
        try:
            place = claim_place(segment, places.first + CURSOR_BYTES * CURSORS.index("place"), CLIENTS)
        except BaseException:
            segment.close()
            raise
        self._view, self._words = places.view, places.words
        self._sent, self._taken = places.cursor("sent", place), places.cursor("taken", place)
        self._answered = places.cursor("answered", place)
        self._queue, self._replies = places.commands(place), places.replies(place)
        if not 0 <= self._words[self._sent] - self._words[self._taken] <= COMMANDS_DEPTH:
            self._words[self._sent] = self._words[self._taken]  # a predecessor left garbage
        self._count: int = self._words[self._sent]
        self._known: int = self._words[self._taken]
        self._seen: int = self._words[self._answered]
        self.lost = 0

    @property
    def commands(self) -> list[dict[str, Any]]:
        """The owner's command table, as its mailbox describes it."""
        return list(self._places.segment.header.info.get("commands", []))

    def send(self, name: str, values: Any = (), text: str = "") -> int:
        """Queue a command, returns its id; MailboxFull when the owner does not keep up, KeyError: no such command.

        `values` are at most 64 numbers, a sequence or an array, `text` at most 64 bytes of UTF-8.
        """
        code = self._codes.get(name)
        if code is None:
            raise KeyError(f"{self.kind} has no command {name}; it has: {', '.join(self._codes)}")
        numbers = values if isinstance(values, SEQUENCES) else np.asarray(values, dtype=np.float64).reshape(-1)
        count = len(numbers)
        encoded = text.encode()
        if count > MAX_VALUES:
            raise ValueError(f"{name}: {count} values; allowed are {MAX_VALUES}")
        if len(encoded) > MAX_TEXT:
            raise ValueError(f"{name}: the text has {len(encoded)} bytes; allowed are {MAX_TEXT}")
        n = self._count + 1
        if n - self._known > COMMANDS_DEPTH:  # M1; the cell is on the owner's core: looked at when it matters
            self._known = self._words[self._taken]
            if n - self._known > COMMANDS_DEPTH:
                raise MailboxFull(f"{self.instance} has not taken the last {COMMANDS_DEPTH} commands")
        at = self._queue[n % COMMANDS_DEPTH]  # M2
        try:
            VALUES[count].pack_into(self._view, at + VALUES_START, *numbers)
        except struct.error:
            raise ValueError(f"{name}: {values!r} are not numbers") from None
        COMMAND_HEAD.pack_into(self._view, at + HEAD_START, n, code, count, encoded)
        self._count = self._words[self._sent] = n  # M3
        return n

    def poll(self) -> list[Reply]:
        """Replies that came since the last call, in order; what was overwritten is counted in `lost`."""
        head: int = self._words[self._answered]
        if head == self._seen:
            return []
        begin = max(self._seen + 1, head - REPLIES_DEPTH + 1)
        self.lost += begin - self._seen - 1
        self._seen = head
        found = []
        for n in range(begin, head + 1):
            at = self._replies[n % REPLIES_DEPTH]
            number, outcome, raw = REPLY_BODY.unpack_from(self._view, at + REPLY_START)
            if self._words[at >> 3] == n:  # after the copy: the owner may have come round meanwhile
                text = raw.rstrip(b"\0").decode(errors="replace")
                found.append(Reply(number, OUTCOMES.get(outcome, "unknown"), text))
            else:
                self.lost += 1
        return found

    def close(self) -> None:
        """Free the place."""
        self._places.segment.close()


__all__ = ["Client", "Mailbox", "MailboxFull", "Received", "Reply", "SegmentError", "create_mailbox"]
