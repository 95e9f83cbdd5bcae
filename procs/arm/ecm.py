"""An ECM: the endoscope it carries, and what keeps its tip out of the cannula."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from typing import Final

import numpy as np
from numpy.typing import NDArray

from trocar.procs.arm.arm import ArmLogic
from trocar.procs.arm.commands import ArmCommandRow, Table
from trocar.procs.arm.gravity import Weight
from trocar.procs.arm.joints import joints
from trocar.procs.arm.motion import Mode
from trocar.procs.arm.recovery import PreviousState
from trocar.procs.arm.states import ArmState
from trocar.procs.kinematics.endoscopes import NAMES
from trocar.procs.node.requests import CommandRefused, Request
from trocar.procs.tables import codes

Array = NDArray[np.float64]

INSERTION: Final = 2
MIN_INSERTION: Final = 0.04  # m; a goal of the tip never takes the endoscope further out
CARTESIAN_INSERTION: Final = 0.05  # m, above which Cartesian control may begin


class EcmLogic(ArmLogic):
    """See ArmLogic."""

    def prepare(self, before: PreviousState | None) -> None:
        """Go on with the endoscope that a predecessor had."""
        if before is not None and before.tool in NAMES:
            self._carry(before.tool)

    def tables(self) -> Iterable[Table]:
        """See ArmLogic."""
        return ({"set_endoscope_type": ArmCommandRow(self._set_endoscope_type)},)

    def safe(self, at: Array) -> str:
        """See ArmLogic."""
        if at[INSERTION] > CARTESIAN_INSERTION:
            return ""
        return f"the endoscope needs to be inserted past the cannula, to {CARTESIAN_INSERTION} m, for Cartesian control"

    def guard(self, found: Array, seed: Array) -> None:
        """See ArmLogic."""
        found[INSERTION] = max(found[INSERTION], MIN_INSERTION)

    def _set_endoscope_type(self, request: Request) -> None:
        control, name = self.control, request.text.strip()
        if self.machine.moving or self.state is ArmState.HOMING or control.motion.mode is Mode.EFFORT:
            raise CommandRefused("the arm is moving or in effort mode")
        if name not in NAMES:
            control.reports.emit("endoscope_type", "ERROR")
            reason = f"no endoscope {name or '(empty)'}; allowed: {', '.join(NAMES)}"[:199]
            raise control.refusal(codes.ENDOSCOPE_TYPE, request.name, reason)
        self._carry(name)
        control.cartesian.update()
        control.reports.emit("endoscope_type", name)

    def _carry(self, name: str) -> None:
        """Another tip and another mass; the joints stay where they are."""
        control = self.control
        control.arm = dataclasses.replace(control.arm, endoscope=name)
        before = control.gravity
        control.gravity = Weight(control.arm)
        control.gravity.go_on(before)
        control.use(joints(control.arm))
