"""Layout of a mailbox's segment, and the holders of its places.

One "slot": cursors (arrays over the places, each cell with one writer), holders, then the queues of all places.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Any

from trocar.shm.mailbox.command_row import CommandRow, listed, row_of
from trocar.shm.mailbox.messages import COMMAND, REPLY
from trocar.shm.mailbox.origins import PROGRAM_BYTES
from trocar.shm.memory.header import SegmentError, readable
from trocar.shm.memory.holders import HOLDER, PROGRAM, Holder, in_words
from trocar.shm.memory.layout import LINE, Schema, cut_text, schema_from_json, schema_of
from trocar.shm.memory.segment import Make, Segment, create, segment_name
from trocar.shm.ring.ring import attach

CLIENTS = 16
RESERVED = CLIENTS
"""The place for stops."""
PLACES = CLIENTS + 1
COMMANDS_DEPTH = COMMAND.depth
REPLIES_DEPTH = REPLY.depth
COMMAND_SCHEMA = schema_of(COMMAND)
REPLY_SCHEMA = schema_of(REPLY)

# Sizes that result from the topic table's rows; tests compare these with the schemas.
MAX_VALUES, MAX_TEXT = 64, 64
COMMAND_START = 8  # in the slot: stamp, id, origin, generation, code, count, peer, program, text, values
COMMANDS_OF = tuple(struct.Struct(f"<qQQQHHI{PROGRAM_BYTES}s{MAX_TEXT}s{n}d")  # by number of values
                    for n in range(MAX_VALUES + 1))
COMMAND_HEAD = struct.Struct("<qQQQHHI")
STAMP_AND_NUMBER = struct.Struct("<qQ")
PROGRAM_IN_RAW = COMMAND_HEAD.size
TEXT_IN_RAW = PROGRAM_IN_RAW + PROGRAM_BYTES
VALUES_IN_RAW = COMMANDS_OF[0].size
REPLY_BODY = struct.Struct("<QB200s")  # id, outcome, text
REPLY_START = REPLY_SCHEMA.offset("id")
REPLY_TEXT = 199

CURSORS = ("sent", "taken", "answered", "place")  # the bytes of "place" are never written: clients lock them
CURSOR_BYTES = -(-8 * PLACES // LINE) * LINE
HOLDERS_AT = CURSOR_BYTES * len(CURSORS)
QUEUES_AT = HOLDERS_AT + HOLDER.size * PLACES
PLACE_BYTES = COMMANDS_DEPTH * COMMAND_SCHEMA.stride + REPLIES_DEPTH * REPLY_SCHEMA.stride
WHOLE = schema_from_json(
    b'{"topic":"mailbox","fields":[{"name":"cursors","dtype":"(4,%d)<u8"},{"name":"holders","dtype":"(%d,64)u1"},'
    b'{"name":"queues","dtype":"(%d,)u1"}]}' % (CURSOR_BYTES // 8, PLACES, PLACES * PLACE_BYTES)
)


def create_mailbox(system: str, instance: str, kind: str, rows: Sequence[CommandRow], make: Make = create, *,
                   wakes: bool = False, own: Sequence[CommandRow] = ()) -> int:
    """Make the mailbox of an instance; returns its size. `rows`: the commands of its `kind`.

    `wakes`: a command wakes its owner. `own`: commands that this instance has besides those of its kind.
    """
    commands = [*map(listed, rows), *({**listed(row), "own": True} for row in own)]
    info = {"kind": kind, "wakes": wakes, "commands": commands}
    return make(segment_name(system, instance, "mailbox"), "mailbox", WHOLE, 1, info)


class MailboxMap:
    """Positions of the cursors and slots of all places: cursors as word indices, slots as byte offsets."""

    def __init__(self, system: str, instance: str) -> None:
        """Attach; SegmentError if there is no such mailbox, or it is of another program version."""
        self.instance = instance
        self.segment = Segment(segment_name(system, instance, "mailbox"), write=True)
        try:
            attach(self.segment, "mailbox", WHOLE)
            self._read(self.segment.header.info)
        except BaseException:
            self.segment.close()
            raise
        self.first = self.segment.header.first + 16  # behind the slot's own sequence and stamp
        self.words = self.segment.words()
        self.view = self.segment.view

    def _read(self, info: dict[str, Any]) -> None:
        """A command travels as its place in the table that the mailbox lists: that of its kind, then its own."""
        kind, rows = info.get("kind"), info.get("commands")
        if not isinstance(kind, str) or not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
            raise SegmentError(f"{self.segment.name}: it does not list its commands")
        self.table = tuple(map(row_of, rows))
        self.own = tuple(row for row, given in zip(self.table, rows, strict=True) if given.get("own") is True)
        self.kind, self.wakes = kind, info.get("wakes") is True

    def cursor(self, which: str, place: int) -> int:
        """Index of a cursor in `words`."""
        return (self.first + CURSORS.index(which) * CURSOR_BYTES) // 8 + place

    def cursors(self, which: str) -> list[int]:
        """Indices of a cursor of all places."""
        return [self.cursor(which, place) for place in range(PLACES)]

    @property
    def locks(self) -> int:
        """File offset of the lock bytes."""
        return self.first + CURSORS.index("place") * CURSOR_BYTES

    def commands(self, place: int) -> tuple[int, ...]:
        """Offsets of the command slots of a place."""
        return self._slots(COMMAND_SCHEMA, place, 0, COMMANDS_DEPTH)

    def replies(self, place: int) -> tuple[int, ...]:
        """Offsets of the reply slots of a place."""
        return self._slots(REPLY_SCHEMA, place, COMMANDS_DEPTH * COMMAND_SCHEMA.stride, REPLIES_DEPTH)

    def reply(self, place: int, number: int) -> int:
        """Offset of the slot of a reply."""
        slot = number % REPLIES_DEPTH
        return self._queue(place) + COMMANDS_DEPTH * COMMAND_SCHEMA.stride + slot * REPLY_SCHEMA.stride

    def _queue(self, place: int) -> int:
        return self.first + QUEUES_AT + place * PLACE_BYTES

    def _slots(self, schema: Schema, place: int, offset: int, depth: int) -> tuple[int, ...]:
        start = self._queue(place) + offset
        return tuple(start + i * schema.stride for i in range(depth))

    def sign(self, place: int, pid: int, program: str) -> None:
        """Write down the current holder of a place."""
        at = self.first + HOLDERS_AT + place * HOLDER.size
        HOLDER.pack_into(self.view, at, pid, cut_text(program, PROGRAM))

    def holder(self, place: int) -> Holder:
        """The last holder that signed for a place."""
        pid, program = HOLDER.unpack_from(self.view, self.first + HOLDERS_AT + place * HOLDER.size)
        return Holder(pid, readable(program))

    def holders(self, places: list[int]) -> str:
        """The holders of these places, in words."""
        return in_words(self.holder(place) for place in places)
