"""What each arm type does by itself, per controlled joint: how fast it goes, and where it goes to when only played."""

from __future__ import annotations

from dataclasses import dataclass
from math import radians

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class TrajectoryLimits:
    """Velocity and acceleration a joint trajectory may use at ratio 1, per joint: rad/s or m/s, rad/s² or m/s²."""

    velocity: tuple[float, ...]
    acceleration: tuple[float, ...]

    def scaled(self, velocity_ratio: float = 1.0, acceleration_ratio: float = 1.0) -> tuple[Array, Array]:
        """(velocity, acceleration) as new arrays (n,), times the ratios a person may set."""
        return velocity_ratio * np.array(self.velocity), acceleration_ratio * np.array(self.acceleration)


LIMITS = {
    "PSM": TrajectoryLimits(  # yaw, pitch, insertion, four discs (or roll, wrist pitch, wrist yaw, jaw)
        velocity=(radians(90), radians(90), 0.2, *(radians(1080),) * 4),
        acceleration=(radians(90), radians(90), 0.2, *(radians(720),) * 4),
    ),
    "ECM": TrajectoryLimits(  # yaw, pitch, insertion, roll
        velocity=(radians(30), radians(30), 0.06, radians(30)),
        acceleration=(radians(90), radians(90), 0.06, radians(90)),
    ),
    "MTM": TrajectoryLimits(  # six joints, then roll
        velocity=(*(radians(90),) * 6, radians(360)),
        acceleration=(*(radians(45),) * 6, radians(360)),
    ),
}

# Where a KINEMATIC arm homes to, rad or m: instrument or endoscope inserted, so that it can move its tip from there on.
KINEMATIC_HOME = {
    "PSM": (0.0, 0.0, 0.12, 0.0, 0.0, 0.0, 0.0),
    "ECM": (0.0, 0.0, 0.12, 0.0),
    "MTM": (0.0,) * 7,
}
