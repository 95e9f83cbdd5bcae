"""A command on its owner's side: content, sender, and ways to answer."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from trocar.shm.mailbox.command_row import CommandRow
from trocar.shm.mailbox.mailbox_map import MAX_TEXT, PROGRAM_IN_RAW, TEXT_IN_RAW
from trocar.shm.mailbox.origins import Origin, SenderId
from trocar.shm.memory.header import readable
from trocar.shm.memory.holders import Holder

if TYPE_CHECKING:
    from trocar.shm.mailbox.mailbox import Mailbox

ACCEPTED, REFUSED, DONE, FAILED = 1, 2, 3, 4
OUTCOMES = {ACCEPTED: "accepted", REFUSED: "refused", DONE: "done", FAILED: "failed"}


class Received:
    """One command; answer it once with accept/refuse/done, and later done/fail if it takes time."""

    __slots__ = ("_box", "_head", "_holder", "_raw", "command", "id", "place", "values")

    def __init__(self, box: Mailbox, place: int, command: CommandRow, head: tuple[int, ...], raw: bytes,
                 values: NDArray[np.float64]) -> None:
        """`command` is its row of the table, `values` (count,) its numbers, our own copy, read-only.

        `raw` is its slot, but for the sequence, and `head` its fields by COMMAND_HEAD.
        """
        self._box, self.place, self._head, self._raw = box, place, head, raw
        self.id, self.command, self.values = head[1], command, values
        self._holder: Holder | None = None

    @property
    def name(self) -> str:
        """The command's name."""
        return self.command.name

    @property
    def sent_ns(self) -> int:
        """Real monotonic time when the client sent it."""
        return self._head[0]

    @property
    def holder(self) -> Holder:
        """The program that sent it, as it reported itself. Fixed at the first call: places are reused."""
        if self._holder is None:
            self._holder = self._box.holder(self.place)
        return self._holder

    @property
    def pid(self) -> int:
        """The process that sent it; 0: unknown."""
        return self.holder.pid

    @property
    def peer(self) -> int:
        """Of a bridge: which of its clients sent it, 0: the program itself."""
        return self._head[6]

    @property
    def sender(self) -> SenderId:
        """Which program, and which client of a bridge, sent it."""
        return SenderId(self._box.home_of(self.place), self.peer)

    @property
    def has_client(self) -> bool:
        """Whether the place it came from has a live client (`pid` says which). Makes a system call."""
        return self._box.has_client(self.place)

    @property
    def needs_operator(self) -> bool:
        """Whether it requires an operator's command given since the last fault."""
        return self.command.needs_operator(self.text, self.values)

    @property
    def origin_id(self) -> int:
        """Number of the person's command from which it originates."""
        return self._head[2]

    @property
    def origin(self) -> Origin:
        """The person's command from which it originates."""
        return Origin(self._head[2], self._head[3], readable(self._raw[PROGRAM_IN_RAW:TEXT_IN_RAW]))

    @property
    def text(self) -> str:
        """Its text argument."""
        return self._raw[TEXT_IN_RAW : TEXT_IN_RAW + MAX_TEXT].rstrip(b"\0").decode(errors="replace")

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
