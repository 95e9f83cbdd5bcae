"""Holding efforts of an MTM from parameters measured on that very arm, in its gravity-compensation file.

A linear model: torque = α · (Y(q) · pos) + (1 − α) · (Y(q) · neg), one parameter set for each direction of motion; α
blends them by joint velocity, which also compensates friction. Y holds ten terms of the masses and, for each of six
joints, a polynomial of fourth order (cables). The result is limited to the safe torques of the file; the roll gets
none.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from trocar.procs.document.arms import CABLE_ORDERS, MASS_TERMS, MASTER_JOINTS, MODELLED_JOINTS, MasterGravityParameters
from trocar.procs.kinematics.poses import Array

GRAVITY: Final = 9.81  # m/s², of the measurement


class MasterGravity:
    """Efforts (7,) that hold a master; the next call overwrites them."""

    def __init__(self, parameters: MasterGravityParameters) -> None:
        up, down = np.array(parameters.positive), np.array(parameters.negative)
        sets = np.column_stack((0.5 * (up + down), 0.5 * (up - down)))  # the mean, and the addition by motion
        self._masses = sets[:MASS_TERMS].copy()
        self._cables = sets[MASS_TERMS:].reshape(MODELLED_JOINTS, CABLE_ORDERS, 2).copy()
        self._lower, self._upper = np.array(parameters.lower), np.array(parameters.upper)
        self._band = np.array(parameters.dead_band)[:MODELLED_JOINTS]
        self._room = np.array(parameters.saturation)[:MODELLED_JOINTS] - self._band
        self._friction = np.array(parameters.friction)[:MODELLED_JOINTS]
        self._powers = np.ones((MODELLED_JOINTS, 1, CABLE_ORDERS))  # of the joints, 0 to 4
        self._effort = np.zeros(MASTER_JOINTS)

    def effort(self, q: Array, velocity: Array) -> Array:
        """Efforts at joint positions q and velocities (7,) [rad, rad/s]."""
        joints, powers, speed = q[:MODELLED_JOINTS], self._powers[:, 0], velocity[:MODELLED_JOINTS]
        powers[:, 1] = joints
        np.multiply(joints, joints, out=powers[:, 2])
        np.multiply(powers[:, 2], powers[:, 1:3].T, out=powers[:, 3:].T)
        both = np.matmul(mass_terms(q), self._masses)
        both += np.matmul(self._powers, self._cables)[:, 0]
        share = (np.abs(speed) - self._band) / self._room
        np.minimum(np.maximum(share, 0.0, out=share), 1.0, out=share)
        share *= self._friction
        effort = self._effort
        np.add(both[:, 0], np.copysign(share, speed) * both[:, 1], out=effort[:MODELLED_JOINTS])
        np.minimum(np.maximum(effort, self._lower, out=effort), self._upper, out=effort)
        effort[MODELLED_JOINTS:] = 0.0
        return effort


def mass_terms(q: Array) -> Array:
    """(6, 10): the effect of the ten mass parameters on the joints; the first joint is vertical and carries none."""
    _, q2, q3, q4, q5, q6 = q[:MODELLED_JOINTS].tolist()
    s, c = math.sin(q2 + q3), math.cos(q2 + q3)
    s4, c4, s5, c5, s6, c6 = math.sin(q4), math.cos(q4), math.sin(q5), math.cos(q5), math.sin(q6), math.cos(q6)
    elbow = (c, -s, c * c4, -c * s4, -(s * c5 + c * c4 * s5), c * c4 * c5 - s * s5,
             c * s4 * s6 + s * s5 * c6 - c * c4 * c5 * c6, c * s4 * c6 - s * s5 * s6 + c * c4 * c5 * s6)
    platform = (-s * s4, -s * c4, s * s4 * s5, -s * c5 * s4, s * (c4 * s6 + c5 * c6 * s4), s * (c4 * c6 - c5 * s4 * s6))
    pitch = (-(c * s5 + s * c4 * c5), c * c5 - s * c4 * s5, -c * c5 * c6 + s * c4 * s5 * c6,
             c * c5 * s6 - s * c4 * s5 * s6)
    yaw = (s * s4 * c6 + c * s5 * s6 + s * c4 * c5 * s6, c * c6 * s5 - s * s4 * s6 + s * c4 * c5 * c6)
    rows = ((), (math.sin(q2), math.cos(q2), *elbow), elbow, platform, pitch, yaw)
    terms = np.zeros((MODELLED_JOINTS, MASS_TERMS))
    for joint, row in enumerate(rows):
        if row:
            terms[joint, MASS_TERMS - len(row) :] = row
    terms *= GRAVITY
    return terms
