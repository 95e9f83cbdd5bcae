"""A command on its owner's side: content, sender, and ways to answer."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from trocar.shm.mailbox.command_row import CommandRow
from trocar.shm.mailbox.mailbox_map import CLIENTS, COMMAND_HEAD, MAX_TEXT, PROGRAM_IN_RAW, TEXT_IN_RAW
from trocar.shm.mailbox.origins import Origin, SenderId
from trocar.shm.memory.header import readable
from trocar.shm.memory.holders import Holder

if TYPE_CHECKING:
    from collections.abc import Sequence

    from trocar.shm.mailbox.mailbox import Mailbox

ACCEPTED, REFUSED, DONE, FAILED = 1, 2, 3, 4
OUTCOMES = {ACCEPTED: "accepted", REFUSED: "refused", DONE: "done", FAILED: "failed"}
SENDERS = tuple(SenderId(place) for place in range(CLIENTS))


class Request(Protocol):
    """A command from a mailbox, or a desired state of an arm (procs/io/arm_requests.py).

    The answer is refuse, done, or accept followed by done or fail.
    """

    @property
    def origin(self) -> Origin:
        """The operator's command from which this one originates."""

    @property
    def sender(self) -> SenderId:
        """The program, and the client of a bridge, that sent it."""

    @property
    def sent_by(self) -> str:
        """The program that sent it, by name, and the operator's program for which it acts."""

    @property
    def holder(self) -> Holder:
        """The process that sent it, as it reported itself."""

    @property
    def command(self) -> CommandRow:
        """Its row of the table."""

    @property
    def pid(self) -> int:
        """Process id that the sender states; 0 if unknown."""

    @property
    def place(self) -> int:
        """Place in the mailbox that it came through."""

    @property
    def id(self) -> int:
        """Number of the command, unique for its place."""

    @property
    def has_client(self) -> bool:
        """Whether the mailbox place it came from has a living client (see `pid`). Asks the Linux kernel."""

    @property
    def name(self) -> str:
        """The command's name."""

    @property
    def values(self) -> NDArray[np.float64]:
        """Its numbers."""

    @property
    def text(self) -> str:
        """Its text."""

    def accept(self, text: str = "") -> None:
        """Report that execution has begun."""

    def refuse(self, reason: str) -> None:
        """Report that it will not be executed."""

    def done(self, text: str = "") -> None:
        """Report that it has been executed."""

    def fail(self, reason: str) -> None:
        """Report that it failed after it was accepted."""


class CommandHead:
    """What the commands of a stream have in common: all but stamp, number and values. `command` is None if its `code`
    is not in the table.
    """

    __slots__ = ("code", "command", "count", "generation", "origin", "origin_id", "peer", "shape", "text")
    origin_id: int
    peer: int

    def __init__(self, raw: bytes, table: Sequence[CommandRow]) -> None:
        """`raw` is a slot, but for its sequence."""
        _, _, self.origin_id, self.generation, self.code, self.count, self.peer = COMMAND_HEAD.unpack_from(raw)
        self.command = table[self.code] if self.code < len(table) else None
        self.shape = (self.count,)
        self.origin = Origin(self.origin_id, self.generation, readable(raw[PROGRAM_IN_RAW:TEXT_IN_RAW]))
        self.text = raw[TEXT_IN_RAW : TEXT_IN_RAW + MAX_TEXT].rstrip(b"\0").decode(errors="replace")


class Received:
    """One command; answer it once with accept/refuse/done, and later done/fail if it takes time."""

    __slots__ = ("_box", "_head", "_holder", "command", "id", "place", "sent_ns", "values")

    def __init__(self, box: Mailbox, place: int, command: CommandRow, head: CommandHead, number: int, sent_ns: int,
                 values: NDArray[np.float64]) -> None:
        """`command` is its row of the table, `values` (count,) its numbers, our own copy, read-only.

        `sent_ns`: real monotonic time when the client sent it.
        """
        self._box, self.place, self.command, self._head = box, place, command, head
        self.id, self.sent_ns, self.values = number, sent_ns, values
        self._holder: Holder | None = None

    @property
    def name(self) -> str:
        """The command's name."""
        return self.command.name

    @property
    def holder(self) -> Holder:
        """The program that sent it, as it reported itself. Fixed at the first call: places are reused."""
        if self._holder is None:
            self._holder = self._box.holder(self.place)
        return self._holder

    @property
    def sent_by(self) -> str:
        """The program that sent it, by name, and the operator's program for which it acts."""
        return self.holder.acting_for(self.origin.program)

    @property
    def pid(self) -> int:
        """The process that sent it; 0: unknown."""
        return self.holder.pid

    @property
    def peer(self) -> int:
        """Of a bridge: which of its clients sent it, 0: the program itself."""
        return self._head.peer

    @property
    def sender(self) -> SenderId:
        """Which program, and which client of a bridge, sent it."""
        place, peer = self.place, self._head.peer
        return SENDERS[place] if place < CLIENTS and not peer else SenderId(self._box.home_of(place), peer)

    @property
    def has_client(self) -> bool:
        """Whether the place it came from has a live client (`pid` says which). Makes a system call."""
        return self._box.has_client(self.place)

    @property
    def needs_operator(self) -> bool:
        """Whether it requires an operator's command given since the last fault."""
        return self.command.needs_operator(self.text, self.values)

    @property
    def origin(self) -> Origin:
        """The person's command from which it originates."""
        return self._head.origin

    @property
    def text(self) -> str:
        """Its text argument."""
        return self._head.text

    def accept(self, text: str = "") -> None:
        """It is under way; `done` or `fail` follows later."""
        self._box.reply(self, ACCEPTED, text)

    def refuse(self, reason: str) -> None:
        """It will not be done, because of `reason`."""
        self._box.reply(self, REFUSED, reason)

    def done(self, text: str = "") -> None:
        """It has been carried out."""
        self._box.reply(self, DONE, text)

    def fail(self, reason: str) -> None:
        """It was accepted and has failed, because of `reason`."""
        self._box.reply(self, FAILED, reason)
