"""What the gravity-compensation file of a master says, as the document has it: parameters measured on that very arm."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

JOINTS: Final = 7
MODELLED: Final = 6  # all but the roll
TERMS: Final = 10  # of the masses
ORDERS: Final = 5  # of a polynomial: 0 to 4
PARAMETERS: Final = TERMS + MODELLED * ORDERS


@dataclass(frozen=True, slots=True)
class MasterGravityParameters:
    """Of one arm: (40,) for motion up and down, and (7,) each: torques [N·m], velocities [rad/s], friction share."""

    positive: tuple[float, ...]
    negative: tuple[float, ...]
    lower: tuple[float, ...]
    upper: tuple[float, ...]
    dead_band: tuple[float, ...]
    saturation: tuple[float, ...]
    friction: tuple[float, ...]

    def __post_init__(self) -> None:
        for name in ("positive", "negative", "lower", "upper", "dead_band", "saturation", "friction"):
            count = PARAMETERS if name in ("positive", "negative") else JOINTS
            values = getattr(self, name)
            if len(values) != count or not all(math.isfinite(value) for value in values):
                raise ValueError(f"{name}: {count} finite numbers, not {len(values)}")
        if any(low > high for low, high in zip(self.lower, self.upper, strict=True)):
            raise ValueError("a lower torque limit is above the upper one")
        if any(not 0.0 <= band < full for band, full in zip(self.dead_band, self.saturation, strict=True)):
            raise ValueError("velocities: 0 <= dead-band < saturation must hold")
