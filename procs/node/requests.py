"""What a process that follows commands is handed: commands to answer, a way to ask others, events to tell.

A command is carried out by a function of its own, which raises CommandRefused where it will not be done.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray

from trocar.procs.kinematics.poses import PoseError
from trocar.procs.tables.codes import Code
from trocar.shm.mailbox.command_row import CommandRow
from trocar.shm.mailbox.origins import Origin, SenderId


class Request(Protocol):
    """A command as the mailbox hands it over; answered by refuse, by done, or by accept and later done or fail."""

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


class Reports(Protocol):
    """The events it raises; stamps increase strictly from one to the next."""

    def status(self, text: str, component: str = "") -> None:
        """Something a person may like to know."""

    def report(self, code: Code, text: str, component: str = "", axis: int = -1, value: float = ...,
               limit: float = ..., board: int = -1) -> None:
        """A warning or error, as the row of the table of codes says."""

    def operating_state(self, state: str, sub_state: str, is_homed: bool, is_busy: bool) -> None:
        """The operating state, whenever it changes or is asked for."""

    def goal_reached(self, reached: bool) -> None:
        """A move has ended."""

    def emit(self, event: str, text: str = "", *, value: float = ...) -> None:
        """An event of its own name."""


class Answer(Protocol):
    """What became of a command of ours."""

    @property
    def id(self) -> int:
        """Its number."""

    @property
    def outcome(self) -> str:
        """accepted, refused, done or failed."""

    @property
    def text(self) -> str:
        """The reason."""


class Sender(Protocol):
    """The way to somebody's mailbox; see shm/mailbox/client.py."""

    def on_behalf(self, origin: Origin) -> None:
        """What is sent from now on comes from this command of a person."""

    def send(self, name: str, values: Sequence[float] | NDArray[np.float64] = (), text: str = "") -> int:
        """Queue a command; returns its id, 0 when there was no room."""

    def poll(self) -> Sequence[Answer]:
        """Replies since the last call."""
