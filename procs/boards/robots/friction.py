"""Drives: Coulomb friction that really holds a joint at rest, and motors that move within the play of their drive.

A joint at rest is held by a stiff spring with a damper, which yields at the friction limit and then slides along. There
is no creep under a load below the limit: the joint yields by less than one encoder count and returns. The spring is as
stiff as a joint's own armature allows at this period. Bodies on a joint only add inertia, so no posture and no coupling
between joints can make it unstable.

The motor of a drive with play is a mass of its own, half of the mass of motor and joint together, with half of the
friction. At either end of the play it meets the joint on a spring as stiff as the period allows. Encoders sit on the
motors.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from trocar.procs.kinematics.poses import Array

STIFFNESS = 0.25  # of armature / period²; up to 1 is stable, below there is room for the host's own gains
DAMPING = 0.5  # of armature / period


class Friction:
    """Of joints (n,) with friction `limit`, N·m or N, and `armature`, kg·m² or kg."""

    def __init__(self, limit: Array, armature: Array, period_s: float) -> None:
        """Every joint relaxed."""
        self.limit = limit.copy()
        self.damping = DAMPING * armature / period_s
        self.gain = self.damping + STIFFNESS * armature / period_s  # damper, and the spring's growth in one period
        self.spring = np.zeros_like(limit)

    def oppose(self, velocity: Array) -> Array:
        """Reduction of the joints' efforts by friction in the next period."""
        force: Array = np.maximum(np.minimum(velocity * self.gain + self.spring, self.limit), -self.limit)
        np.subtract(force, velocity * self.damping, self.spring)
        return force

    def relax(self, joints: NDArray[np.intp]) -> None:
        """Joints set to a position are at rest there."""
        self.spring[joints] = 0.0


# 1 would stop motor and joint on each other within one period; friction needs some of that, too.
MEETING_STIFFNESS = 0.5
SHARE = 0.5  # of inertia and friction that is the motor's where a drive has play


class Play:
    """Drives (n,) at `places` among all actuators; `gap`, rad or m, is how far a motor can turn with its joint held."""

    def __init__(self, places: NDArray[np.intp], gap: Array, inertia: Array, friction: Array, joints: Array,
                 period_s: float) -> None:
        """`inertia` and `friction` (n,) of the motors; `joints`: inverse inertia (n, n) of the joints behind them."""
        self._places, self._period_s = places, period_s
        self._upper, self._lower = 0.5 * gap, -0.5 * gap
        self._friction = Friction(friction, inertia, period_s)
        self._kick = period_s / inertia
        both = np.abs(np.diag(1.0 / inertia) + joints)
        self._stiffness = MEETING_STIFFNESS / (both.sum(axis=1) * period_s**2)
        self.lead = np.zeros(len(places))  # of the motor before its joint
        self._speed = np.zeros(len(places))

    def resume(self, earlier: Play) -> None:
        """The motors are where those of an earlier model of the same robots are."""
        self.lead[:], self._speed[:] = earlier.lead, earlier._speed

    def take_off(self, position: Array) -> None:
        """In place: convert motor positions to joint positions."""
        position[self._places] -= self.lead

    def place(self, robot: slice) -> None:
        """Put the motors of a robot in the middle of their play, at rest."""
        here = np.flatnonzero((self._places >= robot.start) & (self._places < robot.stop))
        self.lead[here], self._speed[here] = 0.0, 0.0
        self._friction.relax(here)

    def transmit(self, effort: Array, velocity: Array) -> None:
        """Motors' efforts in, efforts at the joints out, in place; `velocity` is the joints' (all at the actuators)."""
        lead, speed, own = self.lead, self._speed, effort[self._places]
        meeting = lead + self._period_s * (speed - velocity[self._places])
        meeting -= np.clip(meeting, self._lower, self._upper)
        meeting *= self._stiffness
        effort[self._places] = meeting
        speed += self._kick * (own - meeting - self._friction.oppose(speed))

    def follow(self, position: Array, velocity: Array) -> None:
        """After the joints' step: convert, in place, the joints' motion to the motors' motion."""
        self.lead += self._period_s * (self._speed - velocity[self._places])
        position[self._places] += self.lead
        velocity[self._places] = self._speed
