"""A master's platform follows the wrist while efforts are asked for: it keeps the wrist yaw away from its limits.

With wrenches at the tip the seven joints are one more than the tip's freedoms, and nobody asks for anything of the one
that is left over.
"""

from __future__ import annotations

import math
from typing import Final

from trocar.procs.arm.control import Control

PLATFORM, PITCH, YAW = 3, 4, 5
STIFFNESS: Final = 1.0  # N·m/rad
DAMPING: Final = 0.1  # N·m·s/rad
MAX_WAY: Final = 0.05 * math.pi  # rad: further off does not pull harder
MAX_EFFORT: Final = 0.4  # N·m


class Platform:
    """A spring that is stretched by what the yaw turns about the platform's axis."""

    def __init__(self, control: Control) -> None:
        self._control = control
        self._gain = control.arm.platform_gain
        self._low, self._high = control.joints.lower[PLATFORM], control.joints.upper[PLATFORM]

    def step(self) -> None:
        """Add its effort to those of this cycle."""
        io = self._control.io
        position = io.position[PLATFORM]
        way = min(max(io.position[YAW] * math.cos(io.position[PITCH]), -MAX_WAY), MAX_WAY)
        goal = min(max(position + way, self._low), self._high)
        effort = self._gain * (STIFFNESS * (goal - position) - DAMPING * io.velocity[PLATFORM])
        self._control.motion.effort[PLATFORM] += min(max(effort, -MAX_EFFORT), MAX_EFFORT)
