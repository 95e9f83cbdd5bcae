"""Brakes of a Classic cart: a current lets those of one setup arm go, along a ramp of 8 A/s up and down."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from trocar.procs.document.cart import CartArm

Array = NDArray[np.float64]

RAMP_A_S: Final = 8.0


class SetupArmBrakes:
    """`current` (n,) is what is asked of the brakes of each setup arm, A; they hold where `engaged`."""

    def __init__(self, arms: tuple[CartArm, ...]) -> None:
        """All engaged, without current."""
        release = np.array([arm.release_current for arm in arms])
        self._sign = np.where(release < 0.0, -1.0, 1.0)  # files have the ramp's sizes; the wiring may turn them
        self._release = np.abs(release)
        self._hold = np.array([arm.engaged_current for arm in arms])
        self._size: Array = np.zeros(len(arms))
        self.current: Array = np.zeros(len(arms))
        self.engaged: NDArray[np.bool_] = np.ones(len(arms), dtype=bool)

    def step(self, dt_s: float, clutched: NDArray[np.bool_]) -> None:
        """`dt_s` later, somebody wants to move those that are clutched."""
        goal = np.where(clutched, self._release, self._hold)
        most = RAMP_A_S * dt_s
        self._size += np.clip(goal - self._size, -most, most)
        np.multiply(self._sign, self._size, out=self.current)
        np.equal(self._size, self._hold, out=self.engaged)
        self.engaged[clutched] = False

    def cut(self) -> None:
        """No power: they hold at once."""
        self._size.fill(0.0)
        self.current.fill(0.0)
        self.engaged.fill(True)
