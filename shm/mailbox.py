"""The mailbox: commands to one owner from up to 16 clients; each client has a queue and a reply ring of its own.

One segment. Each place has: a command queue (single producer, single consumer), a reply queue, and four cursors.

Submit (client):  M1 sent − taken < depth, else MailboxFull   M2 write the slot   M3 sent := sent + 1
Drain (owner):    N1 sent ≠ taken?   N2 copy the slot   N3 taken := taken + 1   N4 run it, write the reply, answered + 1

N3 comes before N4: a command runs at most once, also when the owner dies in between; the client then gets no reply and
sees the owner's epoch change. A client claims a place with a lock that the kernel frees when it dies; its successor
goes on from the cursors, commands that were accepted (M3 done) are still run.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shm.commands import COMMANDS, Command, code_of
from shm.doorbell import claim_place
from shm.layout import LINE, schema_from_json, schema_of
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

# The segment's one "slot": cursors (arrays over the places, each cell with one writer), then the queues.
CURSORS = ("sent", "taken", "answered", "client_pid")
CURSOR_BYTES = LINE * 2
QUEUES_AT = CURSOR_BYTES * len(CURSORS)
PLACE_BYTES = COMMANDS_DEPTH * COMMAND_SCHEMA.stride + REPLIES_DEPTH * REPLY_SCHEMA.stride
WHOLE = schema_from_json(
    b'{"topic":"mailbox","fields":[{"name":"cursors","dtype":"(4,16)<u8"},{"name":"queues","dtype":"(%d,)u1"}]}'
    % (CLIENTS * PLACE_BYTES)
)


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
    """Cursor words and queue slots of all places."""

    def __init__(self, system: str, instance: str) -> None:
        self.segment = Segment(segment_name(system, instance, "mailbox"), write=True)
        attach(self.segment, "mailbox", WHOLE)
        self.first = self.segment.header.first + 16  # the slot's own sequence and stamp
        self.words = self.segment.words()
        self.view = self.segment.view

    def cursor(self, which: str, place: int) -> int:
        """Index of a cursor in `words`."""
        return (self.first + CURSORS.index(which) * CURSOR_BYTES) // 8 + place

    def commands(self, place: int) -> NDArray[Any]:
        """The command slots of a place."""
        return self._array(COMMAND_SCHEMA, place, 0, COMMANDS_DEPTH)

    def replies(self, place: int) -> NDArray[Any]:
        """The reply slots of a place."""
        return self._array(REPLY_SCHEMA, place, COMMANDS_DEPTH * COMMAND_SCHEMA.stride, REPLIES_DEPTH)

    def _array(self, schema: Any, place: int, offset: int, depth: int) -> NDArray[Any]:
        start = self.first + QUEUES_AT + place * PLACE_BYTES + offset
        raw = np.frombuffer(self.view, dtype=np.uint8, count=depth * schema.stride, offset=start)
        return np.ndarray((depth,), dtype=schema.dtype, buffer=raw.data, strides=(schema.stride,))


class Received:
    """One command on the owner's side; answer it once with accept/refuse, and later done/fail if it takes time."""

    __slots__ = ("_box", "_place", "command", "id", "text", "values")

    def __init__(self, box: Mailbox, place: int, number: int, command: Command, values: NDArray[np.float64], text: str):
        self._box, self._place = box, place
        self.id, self.command, self.values, self.text = number, command, values, text

    @property
    def name(self) -> str:
        """The command's name."""
        return self.command.name

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
        self._places = _Places(system, instance)
        self._places.segment.claim(instance)
        self._table = COMMANDS.get(kind, ())
        start = self._places.first
        self._sent_bytes = self._places.view[start : start + 8 * CLIENTS]
        self._words = self._places.words
        self._sent = [self._places.cursor("sent", p) for p in range(CLIENTS)]
        self._taken = [self._places.cursor("taken", p) for p in range(CLIENTS)]
        self._answered = [self._places.cursor("answered", p) for p in range(CLIENTS)]
        self._queues = [self._places.commands(p) for p in range(CLIENTS)]
        self._replies = [self._places.replies(p) for p in range(CLIENTS)]
        self._taken_bytes = self._places.view[start + CURSOR_BYTES : start + CURSOR_BYTES + 8 * CLIENTS]

    def drain(self) -> Iterator[Received]:
        """Commands that came in, in each client's order, at most 8 a client; unknown ones are refused here."""
        if self._sent_bytes.tobytes() == self._taken_bytes.tobytes():  # N1 for all places at once
            return
        for place in range(CLIENTS):
            waiting = self._words[self._sent[place]] - self._words[self._taken[place]]
            if waiting > COMMANDS_DEPTH or waiting < 0:  # a cursor no honest client writes
                self._words[self._taken[place]] = self._words[self._sent[place]]
                continue
            for _ in range(min(waiting, PER_CYCLE)):
                received = self._take(place)
                if received is not None:
                    yield received

    def _take(self, place: int) -> Received | None:
        n = self._words[self._taken[place]] + 1
        slot = self._queues[place][n % COMMANDS_DEPTH].copy()  # N2
        self._words[self._taken[place]] = n  # N3
        number, code, count = int(slot["id"]), int(slot["code"]), int(slot["count"])
        if code >= len(self._table):
            self.answer(place, number, REFUSED, f"command {code} is not in the table")
            return None
        values = slot["values"]
        if count > len(values):
            self.answer(place, number, REFUSED, f"{count} values; allowed are {len(values)}")
            return None
        text = bytes(slot["text"]).rstrip(b"\0").decode(errors="replace")
        return Received(self, place, number, self._table[code], values[:count], text)

    def answer(self, place: int, number: int, outcome: int, text: str) -> None:
        """Write a reply; the oldest is overwritten when a client does not read its replies."""
        n = self._words[self._answered[place]] + 1
        slot = self._replies[place][n % REPLIES_DEPTH]
        slot["sequence"] = 0
        slot["id"], slot["outcome"], slot["text"] = number, outcome, text.encode()[:199]
        slot["sequence"] = n
        self._words[self._answered[place]] = n

    def close(self) -> None:
        """Give the claim back."""
        self._places.segment.close()


class Client:
    """The sending end: one place in an owner's mailbox."""

    def __init__(self, system: str, instance: str) -> None:
        """Claim a free place; SegmentError when the instance has no mailbox or all places are taken."""
        self._places = _Places(system, instance)
        segment = self._places.segment
        self.instance = instance
        self.kind = str(segment.header.info.get("kind", ""))
        place = claim_place(segment, self._places.first + CURSOR_BYTES * 3, CLIENTS)
        self._words = self._places.words
        self._sent, self._taken = self._places.cursor("sent", place), self._places.cursor("taken", place)
        self._answered = self._places.cursor("answered", place)
        self._queue, self._replies = self._places.commands(place), self._places.replies(place)
        self._seen: int = self._words[self._answered]
        self.lost = 0

    @property
    def commands(self) -> list[dict[str, Any]]:
        """The owner's command table, as its mailbox describes it."""
        return list(self._places.segment.header.info.get("commands", []))

    def send(self, name: str, values: Any = (), text: str = "") -> int:
        """Queue a command, returns its id; MailboxFull when the owner does not keep up, KeyError: no such command."""
        code = code_of(self.kind, name)
        numbers = np.asarray(values, dtype=np.float64).reshape(-1)
        if len(numbers) > 64:
            raise ValueError(f"{name}: {len(numbers)} values; allowed are 64")
        if len(text.encode()) > 64:
            raise ValueError(f"{name}: the text has {len(text.encode())} bytes; allowed are 64")
        n = self._words[self._sent] + 1
        if n - self._words[self._taken] > COMMANDS_DEPTH:  # M1
            raise MailboxFull(f"{self.instance} has not taken the last {COMMANDS_DEPTH} commands")
        slot = self._queue[n % COMMANDS_DEPTH]  # M2
        slot["id"], slot["code"], slot["count"], slot["text"] = n, code, len(numbers), text.encode()
        slot["values"][: len(numbers)] = numbers
        self._words[self._sent] = n  # M3
        return int(n)

    def poll(self) -> list[Reply]:
        """Replies that came since the last call, in order; what was overwritten is counted in `lost`."""
        head = self._words[self._answered]
        if head == self._seen:
            return []
        begin = max(self._seen + 1, head - REPLIES_DEPTH + 1)
        self.lost += begin - self._seen - 1
        self._seen = head
        found = []
        for n in range(begin, head + 1):
            slot = self._replies[n % REPLIES_DEPTH].copy()
            if slot["sequence"] == n:
                text = bytes(slot["text"]).rstrip(b"\0").decode(errors="replace")
                found.append(Reply(int(slot["id"]), OUTCOMES.get(int(slot["outcome"]), "unknown"), text))
            else:
                self.lost += 1
        return found

    def close(self) -> None:
        """Free the place."""
        self._places.segment.close()


__all__ = ["Client", "Mailbox", "MailboxFull", "Received", "Reply", "SegmentError", "create_mailbox"]
