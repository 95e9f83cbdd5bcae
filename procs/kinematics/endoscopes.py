"""Endoscopes of an ECM: their tip frames, relative to the roll joint, and the masses of their cameras."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from trocar.procs.kinematics.poses import Array, rotation_from_vector

MASSES: Final = {"Classic_SD": 1.5, "Classic_HD": 2.5, "Si_HD": 1.8, "Custom": 0.8}  # kg
LOOKS: Final = {"STRAIGHT": 0.0, "UP": -30.0, "DOWN": 30.0}  # degrees about x
CUSTOM_LENGTH: Final = 0.18  # m further along the shaft
NONE: Final = "NONE"
NO_MASS: Final = 0.1  # kg of the empty holder
NAMES: Final = (NONE, *(f"{kind}_{look}" for kind in MASSES for look in LOOKS))


@dataclass(frozen=True, slots=True)
class Endoscope:
    """One endoscope: camera mass [kg], and the frame of its tip (4, 4) relative to the roll joint."""

    name: str
    mass: float
    tip: Array


def endoscope(name: str) -> Endoscope:
    """The endoscope called `name`, one of NAMES; ValueError otherwise."""
    if name not in NAMES:
        raise ValueError(f"no endoscope {name!r}; allowed: {', '.join(NAMES)}")
    tip = np.eye(4)
    tip[:3, :3] = ((0.0, 1.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 0.0, 1.0))  # images are upright where the roll is 0
    if name == NONE:
        return Endoscope(name, NO_MASS, tip)
    kind, _, look = name.rpartition("_")
    tip[:3, :3] = tip[:3, :3] @ rotation_from_vector(np.array((math.radians(LOOKS[look]), 0.0, 0.0)))
    if kind == "Custom":
        tip[2, 3] = CUSTOM_LENGTH
    return Endoscope(name, MASSES[kind], tip)
