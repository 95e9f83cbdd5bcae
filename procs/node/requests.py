"""Commands as a process receives them, and their execution.

Each command has a handler, which raises CommandRefused to refuse it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray

from trocar.procs.kinematics.poses import PoseError
from trocar.shm.mailbox.command_row import CommandRow
from trocar.shm.mailbox.origins import Origin, SenderId
from trocar.shm.memory.holders import Holder


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
    def holder(self) -> Holder:
        """The process that sent it, as it reported itself."""

    @property
    def command(self) -> CommandRow:
        """Its row of the table."""

    @property
    def pid(self) -> int:
        """Process id that the sender states; 0 if unknown."""

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


STREAM_ENDED: Final = "this stream has ended"
"""Begin of an arm's answers to goals of a stream that it has ended, until the stream pauses for STREAM_PAUSE_NS."""
STREAM_PAUSE_NS: Final = 500_000_000


class CommandRefused(Exception):
    """A command is refused; the text is the reason, without the command's name."""


Handler = Callable[[Request], str | None]
"""Executes a command; returns the text of the answer, or `ANSWERED` if it has answered itself."""

ANSWERED: Final = "answered"


def carry_out(request: Request, handler: Handler, joints: int | None = None) -> str:
    """Execute a command and answer it; returns the reason of a refusal, or "". `joints`: number of joints it moves."""
    try:
        if why := request.command.objection(request.values, joints):
            raise CommandRefused(why)
        text = handler(request)
    except (CommandRefused, PoseError) as error:
        reason = f"{request.name}: {error}"
        request.refuse(reason)
        return reason
    if text != ANSWERED:
        request.done(text or "")
    return ""


def has_left(request: Request, pid: int) -> bool:
    """Whether the sender, process `pid`, has ended."""
    return not request.has_client or request.pid != pid


def switch(request: Request) -> bool:
    """Whether a command switches on (its value is 1) or off (0)."""
    return bool(request.values[0])
