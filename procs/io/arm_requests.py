"""Desired states: what arms request of io by level. They arrive with the setpoints and are checked every cycle until io
has reached them.

    ignored: a desired state NONE, generation 0, and setpoints that are not fresh
    TAKEN   a new generation: desired states that are not yet reached are tried in every cycle
    SO      all desired states are reached: from now on only VOID can change this
    VOID    a later operator's command to the robot, or a fault that switched something off, made the generation void
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from trocar.procs.io.record import Flags
from trocar.procs.io.robots import IoData
from trocar.procs.io.setpoint_tracker import SetpointTracker, TrackedRobot
from trocar.procs.tables.desired_state import DESIRED_STATES, NONE, OFF, ON, SETTINGS, Order
from trocar.shm.commands import COMMANDS
from trocar.shm.mailbox.command_row import CommandRow
from trocar.shm.mailbox.origins import Origin, SenderId
from trocar.shm.memory.holders import NAMELESS
from trocar.shm.memory.layout import shorten

ROWS: Final = {row.name: row for row in COMMANDS["io"]}


@dataclass(slots=True)
class DesiredProgress:
    """Progress of io with the desired states of one robot."""

    reported: set[tuple[str, str, str]] = field(default_factory=set)  # command, outcome, reason
    refusals: list[str] = field(default_factory=list)  # in this cycle


class DesiredCommand:
    """One desired state as a command of the arm, carried out by `IoCommands`."""

    pid = place = 0
    holder, sent_by = NAMELESS, NAMELESS.program
    has_client = True
    sender = SenderId(0)

    def __init__(self, robot: str, order: Order, generation: int, origin: Origin, state: DesiredProgress,
                 report: Callable[[DesiredCommand, str, str], None]) -> None:
        self.command: CommandRow = ROWS[order[0]]
        self.name, self.values = order[0], np.array(order[1])
        self.text, self.id = robot, generation
        self.origin = origin
        self._state, self._report = state, report

    def accept(self, text: str = "") -> None:
        """The command is in progress."""
        self._say("accepted", text)

    def refuse(self, reason: str) -> None:
        """Not possible now; tried again in the next cycle."""
        self._state.refusals.append(reason)
        self._say("refused", reason)

    def done(self, text: str = "") -> None:
        """The command has been carried out."""
        self._say("done", text)

    def fail(self, reason: str) -> None:
        """The command was accepted and has failed."""
        self._say("failed", reason)

    def _say(self, outcome: str, reason: str) -> None:
        what = self.name, outcome, reason
        if what not in self._state.reported:  # brakes take many cycles to release
            self._state.reported.add(what)
            self._report(self, outcome, reason)


class ArmRequests:
    """The desired states of all arms of one io."""

    def __init__(self, data: IoData, follow: SetpointTracker,
                 report: Callable[[DesiredCommand, str, str], None] | None) -> None:
        """`report` receives each outcome once."""
        robots, record = data.robots, data.record
        self._robots, self._record, self._follow = robots, record, follow
        self._report = report or (lambda asked, outcome, reason: None)
        self._flags: list[NDArray[Any]] = [getattr(record, desired.shown) for desired in DESIRED_STATES]
        self._states = [DesiredProgress() for _ in robots.names]
        count = len(robots.names)
        self.taken: NDArray[np.uint32] = np.zeros(count, dtype=np.uint32)  # the newest generation
        self.open: Flags = np.zeros(count, dtype=bool)  # the newest generation has a state that is not reached
        self.has_news = True
        """A fresh record has another generation, or a state of the newest generation is not reached."""
        self._cut = record.desired_refused.dtype.itemsize

    def void(self, robot: int, reason: str = "") -> None:
        """Make the robot's present generation void; `reason` is for cases that no other message explains."""
        record = self._record
        for follower in self._follow.followers:
            if follower.robot == robot and self._follow.is_fresh[follower.place]:
                self._take(robot, follower.source.desired.generation.item())
        self.open[robot] = False
        record.desired_void[robot] = True
        record.desired_refused[robot] = shorten(reason, self._cut)

    def wants(self, robot: int, command: str, on: bool) -> str:
        """The arm whose desired state for this command is on, or off; empty: no arm."""
        for follower in self._follow.followers:
            fields = follower.source.desired
            if (follower.robot == robot and self._follow.is_fresh[follower.place]
                    and not self._record.desired_void[robot]
                    and fields.generation.item() and fields.wanted[DESIRED_STATES.index(SETTINGS[command])].item()
                    == (ON if on else OFF)):
                return follower.arm
        return ""

    def are_new(self) -> bool:
        """See `has_news`."""
        for follower in self._follow.followers:
            if self._follow.is_fresh[follower.place]:
                generation = follower.source.desired.generation.item()
                if self.open[follower.robot] or generation not in (0, self.taken[follower.robot]):
                    return True
        return False

    def due(self) -> Iterator[DesiredCommand]:
        """Desired states that are not reached, as commands to be carried out one by one."""
        if not self.has_news:
            return
        for follower in self._follow.followers:
            if self._follow.is_fresh[follower.place]:
                self._take(follower.robot, follower.source.desired.generation.item())
                if self.open[follower.robot]:
                    yield from self._open(follower)

    def _take(self, robot: int, generation: int) -> None:
        record, state = self._record, self._states[robot]
        if generation not in (0, self.taken[robot]):
            record.desired_generation[robot], record.desired_void[robot] = generation, False
            record.desired_refused[robot] = b""
            self.taken[robot], self.open[robot], state.reported = generation, True, set()

    def _open(self, follower: TrackedRobot) -> Iterator[DesiredCommand]:
        robot, fields, record = follower.robot, follower.source.desired, self._record
        state, origin = self._states[robot], fields.origin
        state.refusals.clear()
        self.open[robot] = False
        for desired, cell, flag in zip(DESIRED_STATES, fields.wanted, self._flags, strict=True):
            wanted = cell.item()
            order = desired.on if wanted == ON else desired.off if wanted == OFF else ("", ())
            if wanted == NONE or not order[0] or bool(flag[robot]) is (wanted == ON):
                continue
            yield DesiredCommand(self._robots.names[robot], order, int(self.taken[robot]), origin, state, self._report)
            self.open[robot] |= bool(flag[robot]) is not (wanted == ON)
        refused = shorten("; ".join(dict.fromkeys(state.refusals)), self._cut)
        if refused != record.desired_refused[robot]:
            record.desired_refused[robot] = refused
