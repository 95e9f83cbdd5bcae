"""Buttons of setup arms and of the lift, and the commands that act like them, under one rule.

Without power, neither has an effect, then or later: after power-on, a button must first be released, and a loss of
power ends a command at once.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from trocar.procs.document.cart import CartArm
from trocar.procs.node.requests import CommandRefused
from trocar.procs.tables import codes
from trocar.shm.system.events import Events

CLUTCH_COMMAND_NS: Final = 60_000_000_000
POWER_OFF: Final = "clutch command ended: power went off; brakes engaged"

Flags = NDArray[np.bool_]


class SetupButtons:
    """States of buttons: one for each setup arm, followed by others, e.g. the lift's.

    As of the last `step`: `held` (n,), pressed or by command; `by_command` (n,); `acts` (n,), held and has an effect;
    `stuck` (n,), pressed when power came.
    """

    def __init__(self, arms: Sequence[CartArm], reports: Events, more: int = 0) -> None:
        """Nothing is held, and there is no power."""
        n = len(arms) + more
        self._arms, self._reports = arms, reports
        self._until_ns = np.zeros(n, dtype=np.int64)
        self._powered: Flags = np.zeros(n, dtype=bool)
        self._counts: Flags = np.zeros(n, dtype=bool)
        self.held: Flags = np.zeros(n, dtype=bool)
        self.by_command: Flags = np.zeros(n, dtype=bool)
        self.acts: Flags = np.zeros(n, dtype=bool)
        self.stuck: Flags = np.zeros(n, dtype=bool)

    def command(self, place: int, until_ns: int) -> None:
        """Act like a pressed button until `until_ns`; 0: end the command."""
        if until_ns and not self._powered[place]:
            raise CommandRefused("it has no power; power on first")
        self._until_ns[place] = until_ns

    def step(self, pressed: Flags, powered: Flags, now_ns: int) -> None:
        """Once a cycle; `pressed` and `powered` (n,)."""
        for place in np.flatnonzero(self._until_ns).tolist():
            if pressed[place]:
                self._until_ns[place] = 0  # releasing the button also ends the command
            elif not powered[place]:
                self._end(place, POWER_OFF)
            elif now_ns >= self._until_ns[place]:
                self._end(place, "clutch command ended after a minute; brakes engaged")
        self.stuck = pressed & powered & ~self._powered
        self._counts = (self._counts | ~pressed) & powered
        self._powered = powered.copy()
        self.by_command = self._until_ns > 0
        self.held = pressed | self.by_command
        self.acts = self.held & (self._counts | self.by_command)

    def cut(self) -> None:
        """End all commands: power is off, or was off between two steps."""
        for place in np.flatnonzero(self._until_ns).tolist():
            self._end(place, POWER_OFF)
        self._counts.fill(False)

    def _end(self, place: int, why: str) -> None:
        self._until_ns[place] = 0
        if place < len(self._arms):
            name = self._arms[place].name
            self._reports.report(codes.CLUTCH_RELEASED, f"{name}: {why}", name)
