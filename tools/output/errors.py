"""Errors for a person at the command line, and the exit code of each."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from typing import Any, NoReturn


class Problem(Exception):
    """A problem of the robot or its environment: exit code 1. The message gives the problem and the remedy."""


class PlaceTaken(Problem):
    """Another program has the place, and keeps it until it is ended: waiting does not help."""


class Misuse(Exception):
    """The verb was used wrongly: exit code 2."""


class Clipped(UserWarning):
    """A goal of a move or a stream was clipped to the joint limits before execution."""


class Short(UserWarning):
    """A move has ended with a joint short of its goal."""


class NotThere(Problem):
    """A running system has no component of this name, so that waiting does not help."""


class Disconnected(Problem):
    """The connection to a robot on another machine is gone, or an object is closed; connect again."""


class Refused(Problem):
    """The component refused the command, or failed to carry it out; the message gives the reason."""


def closed(what: str) -> Any:
    """Replaces a closed part of `what`: any use of it except `close` raises Disconnected."""
    return _Closed(what)


class _Closed:
    def __init__(self, what: str) -> None:
        self._what = what

    def close(self) -> None:
        """No effect: it is already closed."""

    def __getattr__(self, name: str) -> NoReturn:
        raise Disconnected(f"{self._what} is closed; make it again")


@contextlib.contextmanager
def only_waiting(stops: str) -> Iterator[None]:
    """Ctrl-C ends only the wait for a command, and the line that reports it says so; `stops`: what stops it, or ""."""
    try:
        yield
    except KeyboardInterrupt as pressed:
        may, how = (": arms may move", f"; {stops} stops them") if stops else ("", "")
        raise KeyboardInterrupt(f", but {str(pressed) or f'the command continues{may}'}{how}") from None
