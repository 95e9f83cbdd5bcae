"""Brakes: a current releases them, a smaller one keeps them released; without current they hold.

    ENGAGED    release  → RELEASING   release current, each brake for its own time
    RELEASING  time over → RELEASED   released current; the robot's brakes are released when all are
    any        engage   → ENGAGED     engaged current, at once
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from trocar.procs.io.record import Floats
from trocar.procs.io.robots import IoData


class Brakes:
    """Requested currents of all brakes, in A: `current` (b,), limited like every current before they are sent."""

    def __init__(self, data: IoData) -> None:
        """All engaged."""
        robots, self._record = data.robots, data.record
        self._of_robot = [places[places >= robots.axes] - robots.axes for places in robots.of_robot]
        rows = robots.brakes
        self._release = np.array([b.release_current for b in rows])
        self._released = np.array([b.released_current for b in rows])
        self._engaged = np.array([b.engaged_current for b in rows])
        self._time_s = np.array([b.release_s for b in rows])
        self._most = np.array([b.maximum_current for b in rows])
        self._spent_s = np.zeros(len(rows))
        self._releasing = np.zeros(len(rows), dtype=bool)
        self.busy = False
        self._alone: set[int] = set()  # robots with a single brake released
        self.current: Floats = self._engaged.copy()

    def has(self, robot: int) -> bool:
        """Whether the robot has brakes."""
        return len(self._of_robot[robot]) > 0

    def release(self, robot: int) -> None:
        """Release the robot's brakes; no effect on brakes that are releasing or released."""
        rows = self._of_robot[robot]
        if self._record.brakes_released[robot] or self._releasing[rows].any():
            return
        self._let_go(rows)
        self._alone.discard(robot)

    def release_one(self, robot: int, axis: int) -> float:
        """Release only the brake of this actuator, until `engage`; returns the time that takes, s; 0: it has no brake.

        The record shows brakes as released when all are, so it does not show this one.
        """
        rows = self._of_robot[robot][axis : axis + 1]
        if not len(rows):
            return 0.0
        self._let_go(rows)
        self._alone.add(robot)
        return float(self._time_s[rows[0]])

    def give(self, robot: int, axis: int, current_a: float) -> str:
        """Give only the brake of this actuator a current, until `engage`; returns the reason for a refusal, or ""."""
        rows = self._of_robot[robot][axis : axis + 1]
        if not len(rows):
            return f"axis {axis} has no brake"
        if self._releasing[self._of_robot[robot]].any():
            return "its brakes are being released; brake_engage first"
        if not abs(current_a) <= self._most[rows[0]]:
            return f"{current_a:g} A; allowed: up to {self._most[rows[0]]:g}"
        self.current[rows], self._releasing[rows] = current_a, False
        self._alone.add(robot)
        return ""

    def _let_go(self, rows: NDArray[np.intp]) -> None:
        self.current[rows], self._spent_s[rows], self._releasing[rows] = self._release[rows], 0.0, True
        self.busy = True

    def engage(self, robot: int) -> None:
        """Engage the robot's brakes."""
        rows = self._of_robot[robot]
        self._alone.discard(robot)
        self.current[rows], self._releasing[rows] = self._engaged[rows], False
        self._record.brakes_released[robot] = False

    def step(self, period_s: float) -> None:
        """Called with each good sample, `period_s` after the previous one."""
        if not self.busy:
            return
        self._spent_s[self._releasing] += period_s
        over = self._releasing & (self._spent_s > self._time_s)
        self.current[over] = self._released[over]
        self._releasing[over] = False
        self.busy = bool(self._releasing.any())
        for robot, rows in enumerate(self._of_robot):
            if over[rows].any() and not self._releasing[rows].any() and robot not in self._alone:
                self._record.brakes_released[robot] = True
