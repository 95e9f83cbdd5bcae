"""What each arm type does by itself, per controlled joint: how fast it goes, what effort mode allows, where it goes to
when only played.
"""

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



@dataclass(frozen=True, slots=True)
class EffortLimits:
    """What effort mode allows, per joint: rad/s or m/s, rad or m.

    `speed`: nothing drives a joint that is as fast, and a faster one is braked. `zone`: so far before a position limit
    the soft wall begins.
    """

    speed: tuple[float, ...]
    zone: tuple[float, ...]


# As fast as the arm goes by itself or a hand takes it in ordinary use, and no faster; zones in which a joint's own
# motor stops it from there: longer than speed² · inertia / effort.
EFFORT_LIMITS = {
    # Yaw, pitch: as in moves. Insertion: a hand on the clutch draws faster than that. Wrist: less than moves may do,
    # which no short zone stops; the tip goes 60 mm/s by it.
    "PSM": EffortLimits((radians(90), radians(90), 0.3, radians(720), *(radians(360),) * 3),
                        (0.15, 0.15, 0.010, *(0.15,) * 4)),
    # Twice and more that of moves, which are made for a picture that does not blur, not for a hand on the clutch.
    "ECM": EffortLimits((radians(60), radians(60), 0.12, radians(180)), (0.15, 0.15, 0.010, 0.15)),
    # A surgeon's hand is to feel neither: 120°/s of the outer joints are 0.8 m/s at the handle, and hands at work go up
    # to 0.5 m/s; wrists turn at up to 300°/s, and fingers roll faster.
    "MTM": EffortLimits((*(radians(120),) * 3, radians(180), radians(360), radians(360), radians(720)),
                        (*(0.2,) * 3, 0.15, 0.25, 0.2, 1.0)),
}

# Where a KINEMATIC arm homes to, rad or m: instrument or endoscope inserted, so that it can move its tip from there on.
KINEMATIC_HOME = {
    "PSM": (0.0, 0.0, 0.12, 0.0, 0.0, 0.0, 0.0),
    "ECM": (0.0, 0.0, 0.12, 0.0),
    "MTM": (0.0,) * 7,
}
