"""Gravity compensation: efforts against an arm's own weight, computed each cycle from its position."""

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
"""Time for the compensation to fade after switching off: a hand may be on the arm. Switching on is immediate: the arm
may have no other support.
"""


class Weight:
    """`used`: the compensation is requested (by default if there is a model); `effort` (size,): efforts of this cycle.
    """

    def __init__(self, arm: ArmConfig) -> None:
        """For the joints of the arm itself."""
        joints = ARM_TYPES[arm.type].joints
        self._model = _model(arm, joints)
        self._joints = joints
        self.used = self.known
        self._used_share, self._stepped_ns = float(self.used), 0
        self.use(joints)

    @property
    def known(self) -> bool:
        """Whether a model exists."""
        return self._model is not None

    def go_on(self, before: Weight) -> None:
        """Continue for another weight of the same arm: switched on or off as `before`."""
        self.used = before.used and self.known
        self._used_share, self._stepped_ns = before._used_share, before._stepped_ns

    def use(self, size: int) -> None:
        """Use another size of joint vectors."""
        self.effort = np.zeros(size)
        self._done: tuple[bytes, bytes, float] | None = None

    def step(self, position: Array, velocity: Array, share: float, now_ns: int) -> None:
        """Compute `effort` at joint positions and velocities (size,); a `share` of the weight is compensated, 0 to 1.
        """
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
