"""Orientations as policies see them: two axes, which change smoothly where a quaternion changes its sign."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from trocar.procs.kinematics.poses import turned

Array = NDArray[np.float64]


def axes_of(quaternion: Array) -> Array:
    """The x and the z axis (6,) of a rotation given as x y z w (4,)."""
    turn = quaternion.tolist()
    return np.array((*turned(turn, (1.0, 0.0, 0.0)), *turned(turn, (0.0, 0.0, 1.0))))
