"""What is pushed with in effort mode: joint efforts as given, or a wrench at the tip, turned into them every cycle."""

from __future__ import annotations

from enum import Enum
from typing import Final

import numpy as np
from numpy.typing import NDArray

from procs.arm.cartesian import Cartesian
from procs.arm.impedance import Impedance
from procs.arm.motion import Mode, Motion

Array = NDArray[np.float64]

FOR_EVER: Final = 1 << 62  # ns


class Law(Enum):
    """Where the efforts come from."""

    JOINT = 0
    BODY = 1  # a wrench at the tip, in its axes or those of the reference frame
    SPATIAL = 2  # a wrench at the base's origin, in its axes
    IMPEDANCE = 3


class Efforts:
    """Works out `motion.effort` of the arm's joints; nothing else of it is changed."""

    def __init__(self, cartesian: Cartesian) -> None:
        """`cartesian` is that of this cycle."""
        self._cartesian = cartesian
        self.law = Law.JOINT
        self._absolute = False
        self.wrench = np.zeros(6)
        self._turned = np.zeros(6)
        self._end_ns = FOR_EVER
        self._impedance: Impedance | None = None

    def joint(self) -> None:
        """Efforts stay as they were given."""
        self.law = Law.JOINT

    def body(self, wrench: Array, *, absolute: bool, end_ns: int = FOR_EVER) -> None:
        """A force and torque (6,) at the tip, until changed or `end_ns`; `absolute`: in axes of the reference frame."""
        self.law, self._absolute, self.wrench[...] = Law.BODY, absolute, wrench
        self._end_ns = end_ns

    def spatial(self, wrench: Array) -> None:
        """A force and torque (6,) at the origin of the arm's base, in its axes, until changed."""
        self.law, self.wrench[...] = Law.SPATIAL, wrench

    def impede(self, impedance: Impedance) -> None:
        """Push as a spring and damper do, until changed."""
        self.law, self._absolute, self._impedance = Law.IMPEDANCE, True, impedance

    def step(self, motion: Motion, now_ns: int) -> None:
        """The efforts of this cycle, from the measured tip."""
        cartesian = self._cartesian
        if self.law is Law.BODY and now_ns >= self._end_ns:
            self.wrench[...] = 0.0
            self._end_ns = FOR_EVER
        if motion.mode is not Mode.EFFORT or self.law is Law.JOINT:
            return
        n = cartesian.jacobian.shape[1]
        absolute = self._absolute and self.law is not Law.SPATIAL
        if not cartesian.valid or (absolute and not cartesian.base_known):
            motion.effort[:n] = 0.0
            return
        if self.law is Law.SPATIAL:
            motion.effort[:n] = cartesian.spatial.T @ self.wrench
            return
        wrench = self.wrench
        if self.law is Law.IMPEDANCE and self._impedance is not None:
            wrench = self._impedance.wrench(cartesian.to_reference(cartesian.tip), cartesian.twist)
        if absolute:
            np.matmul(wrench.reshape(2, 3), cartesian.rotation, out=self._turned.reshape(2, 3))  # Rᵀ · w, in rows
            wrench = self._turned
        motion.effort[:n] = cartesian.jacobian.T @ wrench
