"""Coulomb friction of many joints at once, that really holds a joint at rest.

A joint at rest sits on a stiff spring with a damper, which gives way at the friction's limit and then slides along.
Nothing creeps under a load below the limit: the joint yields by less than the last digit of an encoder and comes back.
The spring is as stiff as a joint's own armature allows at this period. What hangs on a joint only adds inertia, so no
posture and no coupling between joints can make it unstable.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

STIFFNESS = 0.25  # of armature / period²; up to 1 is stable, below there is room for the host's own gains
DAMPING = 0.5  # of armature / period


class Friction:
    """Of joints (n,) with friction `limit`, N·m or N, and `armature`, kg·m² or kg."""

    def __init__(self, limit: Array, armature: Array, period_s: float) -> None:
        """Every joint relaxed."""
        self.limit = limit.copy()
        self._least = -self.limit
        self.damping = DAMPING * armature / period_s
        self.gain = self.damping + STIFFNESS * armature / period_s  # damper, and the spring's growth in one period
        self.spring = np.zeros_like(limit)
        self._force = np.zeros_like(limit)

    def oppose(self, velocity: Array) -> Array:
        """What friction takes off the joints' efforts in the next period; the array changes with the next call."""
        force, spring = self._force, self.spring
        np.multiply(velocity, self.gain, force)
        np.add(force, spring, force)
        np.minimum(force, self.limit, out=force)
        np.maximum(force, self._least, out=force)
        np.multiply(velocity, self.damping, spring)
        np.subtract(force, spring, spring)
        return force

    def relax(self, joints: NDArray[np.intp]) -> None:
        """Joints that were put somewhere rest there."""
        self.spring[joints] = 0.0
