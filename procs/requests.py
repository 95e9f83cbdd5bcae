"""What a process that follows commands is handed: commands to answer, a way to ask others, events to tell."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from procs.codes import Code


class CommandOrigin(Protocol):
    """The person's command that another comes from; see shm/origins.py."""

    @property
    def id(self) -> int:
        """Its number, 0: of nobody."""

    @property
    def generation(self) -> int:
        """The fault generation it was given in."""

    @property
    def program(self) -> str:
        """The program it was given with."""


class Request(Protocol):
    """A command as the mailbox hands it over; answered by refuse, by done, or by accept and later done or fail."""

    @property
    def origin(self) -> CommandOrigin:
        """The person's command that it comes from."""

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
    """The way to somebody's mailbox; see shm/client.py."""

    def on_behalf(self, origin: CommandOrigin) -> None:
        """What is sent from now on comes from this command of a person."""

    def send(self, name: str, values: Sequence[float] | NDArray[np.float64] = (), text: str = "") -> int:
        """Queue a command; returns its id, 0 when there was no room."""

    def poll(self) -> Sequence[Answer]:
        """Replies since the last call."""
