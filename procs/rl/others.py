"""Actions of others on an arm while an environment has it: their commands, and motion by hand.

Such an action takes the arm over, and the environment ends.
"""

from __future__ import annotations

from collections import deque
from typing import Final

import numpy as np

from trocar.procs.crtk.plain import plain
from trocar.procs.kinematics.poses import Array
from trocar.procs.rl.model import ArmModel
from trocar.shm.commands import COMMANDS
from trocar.shm.mailbox.command_row import SETTING
from trocar.shm.ring.ring import RingReader

ROWS: Final = {row.name: row for row in COMMANDS["arm"]}
BASE: Final = "set_base_frame"
"""The position of the base is in the arm's state."""
LAG_NS: Final = 100_000_000
"""The arm may go to a goal for this long after the next one is known: records and commands have delays."""
NEAR: Final = {"rad": 0.005, "m": 0.001}
"""Maximum distance of a setpoint from its way at rest: a base on setup joints trembles."""
BENT: Final = 0.2
"""Additional distance in motion, relative to the longest way of a joint: a straight tip path is curved for joints."""


class OtherCommands:
    """Reads the commands of others to an arm, from its audit ring."""

    def __init__(self, audit: RingReader, own: int) -> None:
        """`own`: number of the person's command behind all our commands; the caller closes the reader."""
        self._audit, self._own, self._asked = audit, own, ""
        self._command, self._text, self._outcome = audit.field("command"), audit.field("text"), audit.field("outcome")
        self._origin, self._program = audit.field("origin"), audit.field("program")
        self._is_stop = False
        audit.rewind(0)

    def begin(self) -> None:
        """Earlier motion commands do not count; stops do, since we were made."""
        while self.look() and not self._is_stop:
            self._asked = ""

    def look(self) -> str:
        """The first relevant motion or stop commanded by others, with the program; empty: none."""
        while not self._asked and self._audit.next():
            command = str(plain(self._command.item()))
            row = ROWS.get(command)
            is_harmless = command == BASE or (row is not None and row.effect <= SETTING)
            if self._origin[()] == self._own or is_harmless or self._outcome[()] in (b"refused", b"failed"):
                continue
            text = str(plain(self._text.item()))
            self._is_stop = row is not None and row.is_stop(text, ())
            self._asked = f"{command} {text}".rstrip() + f" from {plain(self._program.item()) or 'another process'}"
        if self._audit.lost:  # a stop may have been among it
            self._asked, self._is_stop = f"more commands than are kept: {self._audit.lost} of them are lost", True
        return self._asked


class Way:
    """The joints, with the jaw, between the latest goals."""

    def __init__(self, model: ArmModel) -> None:
        self._space = space = model.space
        self._near = np.array([NEAR[space.unit(axis)] for axis in range(space.size)])
        self._goals: deque[tuple[int, Array]] = deque()

    @property
    def has_begun(self) -> bool:
        """Whether we command the arm and it follows."""
        return bool(self._goals)

    def forget(self) -> None:
        """From now on it moves on another way."""
        self._goals.clear()

    def begin(self, here: Array) -> None:
        """The arm is at `here` (size,)."""
        self._goals = deque([(0, here)])

    def add(self, goal: Array, now_ns: int) -> None:
        """From now on it moves to `goal` (size,)."""
        self._goals.append((now_ns, goal))
        while len(self._goals) > 2 and self._goals[2][0] < now_ns - LAG_NS:
            self._goals.popleft()

    def objection(self, at: Array) -> str:
        """The joint of a setpoint (size,) that is off the way, and its distance; empty: all are on it."""
        goals = np.array([goal for _, goal in self._goals])
        lower, upper = goals.min(axis=0), goals.max(axis=0)
        away = np.maximum(lower - at, at - upper)
        excess = away - self._near * (1.0 + BENT * float(((upper - lower) / self._near).max()))
        axis = int(excess.argmax())
        return f"{self._space.name(axis)} {away[axis]:.3g} {self._space.unit(axis)}" if excess[axis] > 0.0 else ""
