"""An ECM: its endoscope, and the checks that keep the tip out of the cannula."""

from __future__ import annotations

import dataclasses
from typing import Final

from trocar.procs.arm.arm import ArmLogic
from trocar.procs.arm.arm_commands import ArmCommandRow
from trocar.procs.arm.context import ArmContext
from trocar.procs.arm.gravity import Weight
from trocar.procs.arm.joints import joints
from trocar.procs.arm.motion import Mode
from trocar.procs.arm.states import ArmState
from trocar.procs.document.system import ArmConfig
from trocar.procs.kinematics.endoscopes import NAMES
from trocar.procs.kinematics.poses import Array
from trocar.procs.node.requests import CommandRefused
from trocar.procs.tables import codes
from trocar.shm.mailbox.received import Request

INSERTION: Final = 2
MIN_INSERTION: Final = 0.04  # m; goals of the tip never retract the endoscope further
CARTESIAN_INSERTION: Final = 0.05  # m, above which Cartesian control may begin


class EcmLogic(ArmLogic):
    """See ArmLogic."""

    def __init__(self, arm: ArmConfig, around: ArmContext) -> None:
        """Resumes with the endoscope of the previous process."""
        super().__init__(arm, around)
        before = self._previous_state
        if before is not None and before.tool in NAMES:
            self._carry(before.tool)
        self._commands.rows["set_endoscope_type"] = ArmCommandRow(self._set_endoscope_type)

    def safe(self, at: Array) -> str:
        if at[INSERTION] > CARTESIAN_INSERTION:
            return ""
        return f"the endoscope needs to be inserted past the cannula, to {CARTESIAN_INSERTION} m, for Cartesian control"

    def guard(self, found: Array, seed: Array) -> None:
        found[INSERTION] = max(found[INSERTION], MIN_INSERTION)

    def report_attached(self) -> None:
        if self.control.arm.endoscope:
            self.control.reports.emit("endoscope_type", self.control.arm.endoscope)

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
        """Another tip and another mass; the joints keep their positions."""
        control = self.control
        control.arm = dataclasses.replace(control.arm, endoscope=name)
        before = control.gravity
        control.gravity = Weight(control.arm)
        control.gravity.go_on(before)
        control.use(joints(control.arm))
