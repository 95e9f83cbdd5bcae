"""Holding efforts of an MTM from parameters measured on that very arm, as its gravity-compensation file has them.

A linear model: torque = α · (Y(q) · pos) + (1 − α) · (Y(q) · neg), one parameter set for each direction of motion; α
blends them by joint velocity, which also compensates friction. Y holds ten terms of the masses and, for each of six
joints, a polynomial of fourth order (cables). The result is kept within the torques the file calls safe; the roll gets
none.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

GRAVITY: Final = 9.81  # m/s², of the measurement
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


class MasterGravity:
    """Efforts (7,) that hold a master; the next call overwrites them."""

    def __init__(self, parameters: MasterGravityParameters) -> None:
        self._sets = np.array((parameters.positive, parameters.negative)).T.copy()
        self._lower, self._upper = np.array(parameters.lower), np.array(parameters.upper)
        self._band, self._full = np.array(parameters.dead_band), np.array(parameters.saturation)
        self._friction = np.array(parameters.friction)
        self._regressor = np.zeros((MODELLED, PARAMETERS))
        self._effort = np.zeros(JOINTS)

    def effort(self, q: Array, velocity: Array) -> Array:
        """At joint positions q and velocities (7,) [rad, rad/s]."""
        y = self._regressor
        masses, polynomials = mass_terms(q), _polynomials(q)
        y[:, :TERMS] = masses
        for joint in range(MODELLED):
            y[joint, TERMS + ORDERS * joint : TERMS + ORDERS * (joint + 1)] = polynomials[joint]
        both = y @ self._sets
        speed = np.abs(velocity[:MODELLED])
        band, full = self._band[:MODELLED], self._full[:MODELLED]
        share = np.clip((speed - band) / (full - band), 0.0, 1.0) * self._friction[:MODELLED]
        blend = 0.5 + 0.5 * np.sign(velocity[:MODELLED]) * share
        self._effort[:MODELLED] = blend * both[:, 0] + (1.0 - blend) * both[:, 1]
        np.clip(self._effort, self._lower, self._upper, out=self._effort)
        self._effort[MODELLED:] = 0.0
        return self._effort


def mass_terms(q: Array) -> Array:
    """(6, 10): how the ten mass parameters act on the joints; the first joint is vertical and bears none."""
    _, q2, q3, q4, q5, q6 = q[:MODELLED].tolist()
    s, c = math.sin(q2 + q3), math.cos(q2 + q3)
    s4, c4, s5, c5, s6, c6 = math.sin(q4), math.cos(q4), math.sin(q5), math.cos(q5), math.sin(q6), math.cos(q6)
    elbow = (c, -s, c * c4, -c * s4, -(s * c5 + c * c4 * s5), c * c4 * c5 - s * s5,
             c * s4 * s6 + s * s5 * c6 - c * c4 * c5 * c6, c * s4 * c6 - s * s5 * s6 + c * c4 * c5 * s6)
    platform = (-s * s4, -s * c4, s * s4 * s5, -s * c5 * s4, s * (c4 * s6 + c5 * c6 * s4), s * (c4 * c6 - c5 * s4 * s6))
    pitch = (-(c * s5 + s * c4 * c5), c * c5 - s * c4 * s5, -c * c5 * c6 + s * c4 * s5 * c6,
             c * c5 * s6 - s * c4 * s5 * s6)
    yaw = (s * s4 * c6 + c * s5 * s6 + s * c4 * c5 * s6, c * c6 * s5 - s * s4 * s6 + s * c4 * c5 * c6)
    rows = ((), (math.sin(q2), math.cos(q2), *elbow), elbow, platform, pitch, yaw)
    terms = np.zeros((MODELLED, TERMS))
    for joint, row in enumerate(rows):
        if row:
            terms[joint, TERMS - len(row) :] = row
    terms *= GRAVITY
    return terms


def _polynomials(q: Array) -> Array:
    """(6, 5): powers 0 to 4 of the joints."""
    powers = np.ones((MODELLED, ORDERS))
    for order in range(1, ORDERS):
        powers[:, order] = powers[:, order - 1] * q[:MODELLED]
    return powers
