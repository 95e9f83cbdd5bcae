"""Efforts that bear an arm's own weight, worked out each cycle from where the arm is."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from procs.arm_types import ARM_TYPES
from procs.document.system import ArmConfig
from procs.kinematics.endoscopes import NONE, endoscope
from procs.kinematics.gravity import Gravity, up_of
from procs.kinematics.master_gravity import MasterGravity

Array = NDArray[np.float64]

Model = Callable[[Array, Array], Array]
"""Efforts (n,) at positions and velocities (n,) of the arm's first n joints."""


class Weight:
    """`used`: the compensation is on (it is where there is a model); `effort` (size,) is that of this cycle."""

    def __init__(self, arm: ArmConfig) -> None:
        """Of the joints of the arm itself."""
        joints = ARM_TYPES[arm.type].joints
        self._model = _model(arm, joints)
        self._joints = joints
        self.used = self.known
        self.use(joints)

    @property
    def known(self) -> bool:
        """There is a model."""
        return self._model is not None

    def use(self, size: int) -> None:
        """Another size of joint vectors."""
        self.effort = np.zeros(size)
        self._done: tuple[bytes, bytes, float] | None = None

    def step(self, position: Array, velocity: Array, share: float) -> None:
        """Work out `effort` at joint positions and velocities (size,), of which a `share` is borne, 0 to 1."""
        if self._model is None:
            return
        n = self._joints
        borne = position.tobytes(), velocity.tobytes(), share if self.used else 0.0
        if borne == self._done:
            return
        self._done = borne
        if share and self.used:
            np.multiply(self._model(position[:n], velocity[:n]), share, out=self.effort[:n])
        else:
            self.effort[:n] = 0.0


def _model(arm: ArmConfig, joints: int) -> Model | None:
    if arm.skip_gravity_compensation:
        return None
    if arm.master_gravity is not None:
        return MasterGravity(arm.master_gravity).effort
    if arm.links is None:
        return None
    mass = endoscope(arm.endoscope or NONE).mass if ARM_TYPES[arm.type].has_endoscope else None
    model = Gravity(arm.links, joints, up_of(arm.mounting_pitch or 0.0), mass)
    return lambda position, _: model.effort(position)
