"""The check of motor currents in QLAs: an overcurrent of 50 ms cuts the amplifier.

In current mode the measured current may exceed the commanded one by 0x900, whatever their signs; small currents, and
commands near full scale, are not compared. In voltage mode it may not exceed the configured limit. A counter of 24 bits
counts consecutive ticks of overcurrent: if an amplifier is enabled again while the current is still too high, it is cut
at once.
"""

from __future__ import annotations

import numpy as np

from trocar.procs.boards.controllers.lines import NEVER, Flags, Ints
from trocar.procs.fpga import registers as reg

CURRENT_TRIP = 2_457_600  # 50 ms of too much current
CURRENT_SMALL = 0x300  # below this from zero nothing is compared
CURRENT_NEAR_FULL = 0xF6FF
COUNTER = 1 << 24  # the counter keeps counting and restarts


class Currents:
    """Since when each axis has too much current, and when that trips; arrays (boards, width)."""

    def __init__(self, shape: tuple[int, ...]) -> None:
        """No currents."""
        self.trip_at = np.full(shape, NEVER, dtype=np.int64)
        self._over_since = np.full(shape, NEVER, dtype=np.int64)

    def compare(self, tick: int, asked: Ints, measured: Ints, unchecked: Flags, limits: Ints | None) -> bool:
        """Currents (offset binary) that hold from `tick` on; `limits` are those of axes in voltage mode, else -1.

        Returns whether any current is or was too high.
        """
        mirrored = np.maximum(asked, 0xFFFF - asked)
        over = np.maximum(measured, 0xFFFF - measured) > mirrored + reg.CURRENT_EXCESS
        if limits is None and not over.any():
            if self._over_since[0, 0] == NEVER and (self._over_since == NEVER).all():
                return False
            self._over_since.fill(NEVER)
            self.trip_at.fill(NEVER)
            return True
        amount = np.abs(measured - reg.CURRENT_ZERO)
        over &= amount >= CURRENT_SMALL
        over &= (mirrored < CURRENT_NEAR_FULL) & ~unchecked
        if limits is not None:
            over = np.where(limits >= 0, amount > limits, over)
        self._over_since = np.where(over, np.minimum(self._over_since, tick), NEVER)
        self.arm(tick)
        return True

    def arm(self, tick: int) -> None:
        """Trip when the counters reach their limit; those at the limit already trip at once."""
        counted = (tick - self._over_since) % COUNTER
        due = np.where(counted < CURRENT_TRIP, tick + CURRENT_TRIP - counted, tick + 1)
        self.trip_at = np.where(self._over_since <= tick, due, NEVER)

    def forget(self, row: int) -> None:
        """Reset the counters of a board to 0."""
        self._over_since[row] = self.trip_at[row] = NEVER
