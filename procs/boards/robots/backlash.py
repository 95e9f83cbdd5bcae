"""Backlash: motors that move within the play of their drive before the joint follows.

The motor of such a drive is a mass of its own, half of what the motor and its joint are together, with half of the
friction. At either end of the play it meets the joint on a spring as stiff as the period allows. Encoders sit on the
motors.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from trocar.procs.boards.robots.friction import Friction

Array = NDArray[np.float64]

STIFFNESS = 0.5  # 1 would stop motor and joint on each other within one period; friction needs some of that, too
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
        self._stiffness = STIFFNESS / (both.sum(axis=1) * period_s**2)
        self.lead = np.zeros(len(places))  # of the motor before its joint
        self._speed = np.zeros(len(places))

    def resume(self, earlier: Play) -> None:
        """The motors are where those of an earlier model of the same robots are."""
        self.lead[:], self._speed[:] = earlier.lead, earlier._speed

    def take_off(self, position: Array) -> None:
        """In place, from where the motors are to where their joints are."""
        position[self._places] -= self.lead

    def place(self, robot: slice) -> None:
        """The motors of a robot are put in the middle of their play, at rest."""
        here = np.flatnonzero((self._places >= robot.start) & (self._places < robot.stop))
        self.lead[here], self._speed[here] = 0.0, 0.0
        self._friction.relax(here)

    def transmit(self, effort: Array, velocity: Array) -> None:
        """Motors' efforts in, in place what arrives at the joints; `velocity` is the joints' (all at the actuators)."""
        lead, speed, own = self.lead, self._speed, effort[self._places]
        meeting = lead + self._period_s * (speed - velocity[self._places])
        meeting -= np.clip(meeting, self._lower, self._upper)
        meeting *= self._stiffness
        effort[self._places] = meeting
        speed += self._kick * (own - meeting - self._friction.oppose(speed))

    def follow(self, position: Array, velocity: Array) -> None:
        """After the joints' step: in place, from what the joints do to what the motors do."""
        self.lead += self._period_s * (self._speed - velocity[self._places])
        position[self._places] += self.lead
        velocity[self._places] = self._speed
