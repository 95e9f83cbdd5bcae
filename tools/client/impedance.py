"""The springs and dampers of `servo_ci`, as crtk_msgs/CartesianImpedance has them."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from trocar.tools.client.values import Array, numbers, rotation_numbers

NONE = (0.0, 0.0, 0.0)
WITHOUT = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


@dataclass(slots=True)
class Gains:
    """Of three axes (3,) on one side: stiffness, damping, bias, and what the error is shrunk by: p · e + d · v + bias.

    Gains have their sign: a negative p pulls back, a negative d brakes. Forces: N/m, N·s/m, N, m; torques: N·m/rad,
    N·m·s/rad, N·m, rad.
    """

    p: ArrayLike = NONE
    d: ArrayLike = NONE
    bias: ArrayLike = NONE
    deadband: ArrayLike = NONE

    def rows(self) -> Array:
        """All of them (4, 3); ValueError where one has not three numbers."""
        rows = [numbers(row) for row in (self.p, self.d, self.bias, self.deadband)]
        for name, row in zip(("p", "d", "bias", "deadband"), rows, strict=True):
            if row.shape != (3,):
                raise ValueError(f"{name} has 3 numbers, one for each axis, not {row.size}")
        return np.array(rows)


@dataclass(slots=True)
class Impedance:
    """Forces about a place, in axes of their own, and torques about an orientation; all in the reference frame.

    `force_position` (3,) m; `force_orientation` (3, 3): axes of the errors and gains of the place; `torque_orientation`
    (3, 3): the orientation, and axes of its errors and gains. Errors that are positive go by one set of gains, those
    that are negative by another.
    """

    force_position: ArrayLike = NONE
    force_orientation: ArrayLike = WITHOUT
    torque_orientation: ArrayLike = WITHOUT
    position_positive: Gains = field(default_factory=Gains)
    position_negative: Gains = field(default_factory=Gains)
    orientation_positive: Gains = field(default_factory=Gains)
    orientation_negative: Gains = field(default_factory=Gains)

    def numbers(self) -> Array:
        """The numbers of the command (59,); ValueError where something has another size, or is no rotation."""
        place = numbers(self.force_position)
        if place.shape != (3,):
            raise ValueError(f"force_position has 3 numbers, not {place.size}")
        positive = np.hstack((self.position_positive.rows(), self.orientation_positive.rows()))
        negative = np.hstack((self.position_negative.rows(), self.orientation_negative.rows()))
        axes, orientation = rotation_numbers(self.force_orientation), rotation_numbers(self.torque_orientation)
        return np.concatenate((place, axes, orientation, positive.reshape(-1), negative.reshape(-1)))
