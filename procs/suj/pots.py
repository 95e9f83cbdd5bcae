"""Two potentiometers for every joint: their weighted mean, and whether they agree."""

from __future__ import annotations

from typing import Final

import numpy as np

from trocar.procs.document.cart import CartArm
from trocar.procs.kinematics.poses import Array
from trocar.procs.suj.setups import Setups
from trocar.procs.tables import codes
from trocar.shm.system.events import Events

CLASSIC_LIMITS: Final = (0.002, np.radians(1.0))  # m of the first joint, rad of the others
SI_LIMITS: Final = (0.003, np.radians(2.0))


class Potentiometers:
    """The potentiometers of one setup arm."""

    def __init__(self, arm: CartArm, limits: tuple[float, float]) -> None:
        """`limits`: permitted difference between the two of a joint, prismatic and revolute."""
        self._scale = np.array([[row[0] for row in pots] for pots in (arm.primary, arm.secondary)])
        self._offset = np.array([[row[1] for row in pots] for pots in (arm.primary, arm.secondary)])
        self._there = np.logical_or.reduce(self._scale != 0.0)  # a scale of 0: no such joint
        self._weight = np.array(arm.weight)
        self._limits = np.array([limits[0]] + [limits[1]] * (arm.joints - 1))
        self.joints: Array = np.zeros(arm.joints)
        self.worst = -1  # joint with the largest excess difference between its potentiometers; -1: they agree
        self.apart, self.limit = 0.0, 0.0

    def update(self, primary: Array, secondary: Array) -> bool:
        """Take readings (joints,); returns whether they agree. `joints` is the weighted mean, 0 for absent joints."""
        positions = self._offset + self._scale * np.stack((primary, secondary))
        positions[:, ~self._there] = 0.0
        self.joints[...] = self._weight * positions[0] + (1.0 - self._weight) * positions[1]
        share = np.abs(positions[0] - positions[1]) / self._limits
        worst = int(np.argmax(np.where(np.isnan(share), np.inf, share)))
        self.apart, self.limit = float(abs(positions[0, worst] - positions[1, worst])), float(self._limits[worst])
        agree = bool(share[worst] <= 1.0)
        self.worst = -1 if agree else worst
        return agree

    def volts(self, joints: Array) -> tuple[Array, Array]:
        """Voltages of both potentiometers of every joint at these positions; 0 for absent ones."""
        scale = np.where(self._scale == 0.0, 1.0, self._scale)
        values = np.where(self._scale == 0.0, 0.0, (joints - self._offset) / scale)
        return values[0], values[1]


class PotReadings:
    """Readings of setup arms at rest, and reports about them."""

    def __init__(self, setups: Setups, limits: tuple[float, float], reports: Events) -> None:
        """`limits` as in `Potentiometers`."""
        self._setups, self._reports = setups, reports
        self._pots = [Potentiometers(arm, limits) for arm in setups.arms]
        self._apart = [False] * len(setups.arms)

    def take(self, place: int, primary: Array, secondary: Array) -> None:
        """Take both readings (joints,) of one arm; its pose is known while its potentiometers agree."""
        pots, name, apart = self._pots[place], self._setups.names[place], self._apart[place]
        agree = pots.update(primary, secondary)
        self._apart[place] = not agree
        if not agree:
            self._setups.lose(place, moved=False)
            if not apart:
                text = f"{name}: the potentiometers of joint {pots.worst + 1} don't agree; its position is not known"
                self._reports.report(codes.SETUP_POTS, text, name, pots.worst, pots.apart, pots.limit)
            return
        if apart:
            self._reports.status(f"{name}: the potentiometers agree", name)
        if self._setups.measure(place, pots.joints) >= 1.0:
            text = f"{name}: it has moved without being clutched; base frames follow"
            self._reports.report(codes.SETUP_MOVED, text, name)
