"""The force on a hand whose slave is at a wall: a spring that only pushes out of the wall, and grows slowly."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from trocar.procs.kinematics.poses import Array
from trocar.procs.teleop.arms import IN_REFERENCE_FRAME, WRENCH_LASTS_S

STIFFNESS: Final = 200.0  # N/m
RISE, FALL = 30.0, 300.0  # N/s: changes of the force when it grows, and when it shrinks
TURNING_S: Final = 0.1
"""The direction out of the wall is that of the force, followed with this time constant: a slave slides around walls."""


class WallForce:
    """The force of one master; from 0 after `forget`."""

    def __init__(self, most: float) -> None:
        """`most` N."""
        self.most = most
        self.wrench = np.array((0.0,) * 6 + (WRENCH_LASTS_S, IN_REFERENCE_FRAME))
        """The values of a `body/servo_cf`."""
        self._force = self.wrench[:3]
        self._out = np.zeros(3)
        """The direction out of the wall, from when it was met; 0: at no wall."""
        self._pushed_ns = 0

    @property
    def is_on(self) -> bool:
        """Whether there is a force."""
        return bool(self._force.any())

    def forget(self) -> None:
        """Away from the wall, or followed again from another pose."""
        self._force[...] = self._out[...] = 0.0

    def push(self, ahead: Sequence[float] | Array, now_ns: int) -> None:
        """Set the wrench for a hand that is `ahead` (3,) of its slave, m, in the master's reference frame."""
        passed_s, self._pushed_ns = (now_ns - self._pushed_ns) * 1e-9, now_ns
        if not 0.0 <= passed_s <= WRENCH_LASTS_S:  # the last force has ended
            self.forget()
            passed_s = 0.0
        back = -STIFFNESS * np.array(ahead)
        size = math.hypot(*back)
        if size > 0.0 and not self._out.any():
            self._out[...] = back / size
        along = float(back @ self._out)
        if along > 0.0:
            self._out += min(passed_s / TURNING_S, 1.0) * (back / size - self._out)
            self._out /= math.hypot(*self._out)
        change = min(max(along, 0.0), self.most) * self._out - self._force
        fastest = RISE if along > math.hypot(*self._force) else FALL
        self._force += change * min(1.0, fastest * passed_s / max(math.hypot(*change), 1e-9))
