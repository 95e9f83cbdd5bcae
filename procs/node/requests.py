"""Commands as a process that follows them is handed them, and how it carries them out.

A command is carried out by a function of its own, which raises CommandRefused where it will not be done.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray

from trocar.procs.kinematics.poses import PoseError
from trocar.shm.mailbox.command_row import CommandRow
from trocar.shm.mailbox.origins import Origin, SenderId


class Request(Protocol):
    """A command out of a mailbox, or a desired state of an arm (procs/io/arm_requests.py).

    It is answered by refuse, by done, or by accept and later done or fail.
    """

    @property
    def origin(self) -> Origin:
        """The person's command that it comes from."""

    @property
    def sender(self) -> SenderId:
        """Which program, and which client of a bridge, sent it."""

    @property
    def command(self) -> CommandRow:
        """Its row of the table."""

    @property
    def pid(self) -> int:
        """The process that sent it, by its own word; 0: not known."""

    @property
    def has_client(self) -> bool:
        """Whether somebody lives in the place that it came from; who, says `pid`. Asks the kernel."""

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
        """It is under way."""

    def refuse(self, reason: str) -> None:
        """It will not be done."""

    def done(self, text: str = "") -> None:
        """It has been carried out."""

    def fail(self, reason: str) -> None:
        """It was accepted and has failed."""


STREAM_ENDED: Final = "this stream has ended"
"""How an arm begins to answer the goals of a stream that it has ended, until the stream has paused for so long."""
STREAM_PAUSE_NS: Final = 500_000_000


class CommandRefused(Exception):
    """A command that will not be carried out; the text says why, without its name."""


Handler = Callable[[Request], str | None]
"""Carries a command out; returns what to answer, `ANSWERED` when that was done already."""

ANSWERED: Final = "answered"


def carry_out(request: Request, handler: Handler, joints: int | None = None) -> str:
    """Do what is asked, and answer; returns why it was refused, "" when it was not. `joints`: how many it moves."""
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
    """Whether the program that sent it, as process `pid`, is gone."""
    return not request.has_client or request.pid != pid


def switch(request: Request) -> bool:
    """On or off, of a command whose row takes 0 or 1."""
    return bool(request.values[0])
