"""Commands as a process receives them, and their execution.

Each command has a handler, which raises CommandRefused to refuse it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from trocar.procs.kinematics.poses import PoseError
from trocar.shm.mailbox.received import Request

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
