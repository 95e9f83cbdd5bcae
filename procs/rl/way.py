"""Where an arm has been asked to be: a setpoint that is elsewhere was moved by somebody else, by hand for instance."""

from __future__ import annotations

from collections import deque
from typing import Final

import numpy as np
from numpy.typing import NDArray

from trocar.procs.rl.model import ArmModel

Array = NDArray[np.float64]

LAG_NS: Final = 100_000_000
"""A goal may be gone to for so long after the next one is known: records and commands take their time."""
NEAR: Final = {"rad": 0.005, "m": 0.001}
"""So far a setpoint may be from the way where the arm rests: a base on setup joints trembles."""
BENT: Final = 0.2
"""So much of the longest way of a joint more where it moves: the tip's straight way is a bent one for joints."""


class Way:
    """The joints, with the jaw, between the goals that were given lately."""

    def __init__(self, model: ArmModel) -> None:
        self._space = space = model.space
        self._near = np.array([NEAR[space.unit(axis)] for axis in range(space.size)])
        self._goals: deque[tuple[int, Array]] = deque()

    @property
    def has_begun(self) -> bool:
        """The arm is ours, and goes where we ask it to."""
        return bool(self._goals)

    def forget(self) -> None:
        """It goes otherwise from now on."""
        self._goals.clear()

    def begin(self, here: Array) -> None:
        """It stands at `here` (size,)."""
        self._goals = deque([(0, here)])

    def add(self, goal: Array, now_ns: int) -> None:
        """It goes to `goal` (size,) from now on."""
        self._goals.append((now_ns, goal))
        while len(self._goals) > 2 and self._goals[2][0] < now_ns - LAG_NS:
            self._goals.popleft()

    def objection(self, at: Array) -> str:
        """Which joint of a setpoint (size,) is not on the way, and how far from it; empty: all are."""
        goals = np.array([goal for _, goal in self._goals])
        lower, upper = goals.min(axis=0), goals.max(axis=0)
        away = np.maximum(lower - at, at - upper)
        excess = away - self._near * (1.0 + BENT * float(((upper - lower) / self._near).max()))
        axis = int(excess.argmax())
        return f"{self._space.name(axis)} {away[axis]:.3g} {self._space.unit(axis)}" if excess[axis] > 0.0 else ""
