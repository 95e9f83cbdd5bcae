"""Effort mode within bounds: a speed limit, and a soft wall before each joint's limits, whatever the efforts come from.

What drives a joint may be no more than D · (v - speed): a joint that is pushed for ever comes to its limit of speed and
stays there, one that something else pushes beyond is braked. In the zone before a position limit that speed shrinks to
nothing on the way out, so that a joint comes to rest before it, and a spring pushes back whatever goes in. All of that
is one sided and continuous, and D is small: at half the limit of speed a joint still has its whole effort, which is a
fraction of what the joint controller damps with. Nothing acts on a joint that is slow and away from its limits.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from trocar.procs.arm.joints import JointSpace
from trocar.procs.arm.motion import Motion
from trocar.procs.kinematics.poses import Array

FREE_SHARE: Final = 0.5  # of the limit of speed, up to which nothing is taken from the largest effort
SPRING: Final = 0.3  # of the largest effort, which the wall pushes back with at the limit: soft for hands
MAX_ZONE: Final = 0.2  # of a joint's range
TINY: Final = 1e-9  # rad or m
FREE: Final = np.array([[np.inf], [-np.inf]])


class EffortGuard:
    """Changes the efforts of a cycle; `begin` where effort mode does."""

    def __init__(self, speed_ratio: float, zone_ratio: float) -> None:
        """Times speeds and zones of the table (`trocar.procs.tables.arm_types`); 0: off."""
        self._has_speed, self._has_zone = bool(speed_ratio), bool(zone_ratio)
        self._speed_ratio, self._zone_ratio = speed_ratio or 1.0, zone_ratio

    def use(self, joints: JointSpace, most: Array) -> None:
        """Another joint space; `most` (size,) are the largest efforts, inf where that is not known: not guarded."""
        n, known = joints.size, np.isfinite(most)
        self._unknown = None if known.all() else ~known
        self._most = np.where(known, most, 0.0)
        self._damping = self._most / (FREE_SHARE * joints.effort_speed)
        zone = np.minimum(joints.effort_zone * self._zone_ratio, MAX_ZONE * (joints.upper - joints.lower))
        per_zone = 1.0 / np.maximum(zone, TINY)
        # rows (2, size): upwards, downwards; so much of the zone is left, and most was since effort mode began
        self._left, self._seen, self._part = np.ones((2, n)), np.zeros((2, n)), np.zeros((2, n))
        self._per_zone = np.array([-per_zone, per_zone])
        self._limit = np.array([joints.upper * per_zone, -joints.lower * per_zone])
        self._driving = np.array([[1.0], [-1.0]]) * self._damping * joints.effort_speed * self._speed_ratio
        self._spring = np.array([[-1.0], [1.0]]) * SPRING * self._most
        self._bound = np.zeros((2, n))
        self._upper, self._lower = self._bound
        self._up, self._down = self._part
        self._effort, self._braking = np.zeros((2, n))
        self._least = -self._most

    def begin(self) -> None:
        """Effort mode begins: a joint that is in its zone already stays there, pushed back only if it goes further."""
        self._seen[...] = 0.0

    def step(self, position: Array, velocity: Array, motion: Motion) -> None:
        """Bound `motion.effort` at these joint positions and velocities (size,)."""
        left, bound, part, guarded = self._left, self._bound, self._part, self._effort
        if self._has_zone:
            np.multiply(self._per_zone, position, out=left)
            np.add(left, self._limit, out=left)
            np.minimum(left, 1.0, out=left)
            np.maximum(left, 0.0, out=left)
            np.maximum(self._seen, left, out=self._seen)
        np.multiply(self._driving, left, out=bound)
        np.multiply(self._damping, velocity, out=self._braking)
        np.subtract(bound, self._braking, out=bound)
        if not self._has_speed:
            np.copyto(bound, FREE, where=left == 1.0)
        np.minimum(motion.effort, self._upper, out=guarded)
        np.maximum(guarded, self._lower, out=guarded)
        np.minimum(guarded, self._most, out=guarded)
        np.maximum(guarded, self._least, out=guarded)
        if self._has_zone:
            np.subtract(self._seen, left, out=part)
            np.multiply(part, self._spring, out=part)
            np.add(guarded, self._up, out=guarded)
            np.add(guarded, self._down, out=guarded)
        if self._unknown is not None:
            np.copyto(guarded, motion.effort, where=self._unknown)
        np.copyto(motion.effort, guarded, where=motion.in_effort)
