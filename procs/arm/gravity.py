"""Efforts that bear an arm's own weight, worked out each cycle from where the arm is."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

from trocar.procs.document.system import ArmConfig
from trocar.procs.kinematics.endoscopes import NONE, endoscope
from trocar.procs.kinematics.gravity import Gravity, up_of
from trocar.procs.kinematics.master_gravity import MasterGravity
from trocar.procs.kinematics.poses import Array
from trocar.procs.tables.arm_types import ARM_TYPES

Model = Callable[[Array, Array], Array]
"""Efforts (n,) at positions and velocities (n,) of the arm's first n joints."""


RAMP_NS: Final = 1_000_000_000
"""Switched off, the compensation goes in this time: a hand may be on the arm. Switched on, it is there at once: nothing
else may hold the arm any more."""


class Weight:
    """`used`: the compensation is to be on (it is where there is a model); `effort` (size,) is that of this cycle."""

    def __init__(self, arm: ArmConfig) -> None:
        """Of the joints of the arm itself."""
        joints = ARM_TYPES[arm.type].joints
        self._model = _model(arm, joints)
        self._joints = joints
        self.used = self.known
        self._used_share, self._stepped_ns = float(self.used), 0
        self.use(joints)

    @property
    def known(self) -> bool:
        """There is a model."""
        return self._model is not None

    def go_on(self, before: Weight) -> None:
        """Another weight of the same arm, switched on as the one before was."""
        self.used = before.used and self.known
        self._used_share, self._stepped_ns = before._used_share, before._stepped_ns

    def use(self, size: int) -> None:
        """Another size of joint vectors."""
        self.effort = np.zeros(size)
        self._done: tuple[bytes, bytes, float] | None = None

    def step(self, position: Array, velocity: Array, share: float, now_ns: int) -> None:
        """Work out `effort` at joint positions and velocities (size,), of which a `share` is borne, 0 to 1."""
        if self._model is None:
            return
        passed_ns, self._stepped_ns = now_ns - self._stepped_ns, now_ns
        if self._used_share != self.used:
            self._used_share = 1.0 if self.used else max(0.0, self._used_share - passed_ns / RAMP_NS)
        n, share = self._joints, share * self._used_share
        borne = position.tobytes(), velocity.tobytes(), share
        if borne == self._done:
            return
        self._done = borne
        if share:
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
