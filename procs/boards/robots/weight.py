"""Weight of emulated masters: the negative of the efforts that, by their gravity files, hold them still.

A master has no brakes. Here it rests on its support until its motors lift it, and again when its amplifiers are off. A
master without such a file is counter-balanced.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from trocar.procs.document.system import ArmConfig
from trocar.procs.kinematics.master_gravity import MasterGravity
from trocar.procs.kinematics.poses import Array

RENEWED_S: Final = 0.01  # update interval: the weight changes as slowly as the arm moves


LIFTING_A: Final = 0.02  # motor current that only an arm command can cause


@dataclass(slots=True)
class Heavy:
    """One master: its actuators among all, its joints among the model's, and its support."""

    robot: str
    actuators: slice
    joints: NDArray[np.intp]
    holding: Callable[[Array, Array], Array]
    share: float
    is_lifted: bool = False


class Weights:
    """`effort` on the model's joints (nv,), to be subtracted from the others."""

    def __init__(self, heavy: list[Heavy], joints: int, period_s: float, supported: Collection[str]) -> None:
        """`supported`: robots whose weight a hand carries, updated by the caller."""
        self.effort = np.zeros(joints)
        self._supported = supported
        self._heavy = heavy
        self._every = max(1, round(RENEWED_S / period_s))
        self._turn = 0
        self._at_rest = np.zeros(joints)

    def step(self, current: Array, position: Array) -> None:
        """For motor currents (axes,) and the model's joint positions (nv,)."""
        self._turn -= 1
        if self._turn > 0:
            return
        self._turn = self._every
        for one in self._heavy:
            flowing = float(np.abs(current[one.actuators]).max())
            one.is_lifted = flowing > LIFTING_A or (one.is_lifted and flowing > 0.0)
            if one.is_lifted and one.robot not in self._supported:
                joints = position[one.joints]
                self.effort[one.joints] = one.share * one.holding(joints, self._at_rest[one.joints])
            else:
                self.effort[one.joints] = 0.0


def weights_of(arms: Mapping[str, ArmConfig], actuators: Mapping[str, slice], joints: Mapping[str, NDArray[np.intp]],
               shares: Mapping[str, float], count: int, period_s: float,
               supported: Collection[str] = ()) -> Weights | None:
    """Those of the arms (by robot) that have gravity files; the other tables are by robot, too. None: of none."""
    heavy = [Heavy(robot, actuators[robot], joints[robot], MasterGravity(arm.master_gravity).effort, shares[robot])
             for robot, arm in arms.items() if arm.master_gravity is not None and robot in joints]
    return Weights(heavy, count, period_s, supported) if heavy else None
