"""Commands of an instrument's jaw, which is the last of a joint vector."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from trocar.procs.arm.commands import ArmCommandRow, Ready, Table
from trocar.procs.arm.control import JAW_MOVE, Control
from trocar.procs.arm.motion import Mode, Space
from trocar.procs.node.requests import Request


class JawCommands:
    """The space stays, only the mode may change: the other joints are kept where they are."""

    def __init__(self, control: Control, enter: Callable[[str], None]) -> None:
        """`enter` refuses where Cartesian control may not begin."""
        self._control, self._enter = control, enter
        self.table: Table = {
            "jaw/servo_jp": ArmCommandRow(self._servo_jp, Ready.JAW),
            "jaw/servo_jf": ArmCommandRow(self._servo_jf, Ready.JAW),
            "jaw/move_jp": ArmCommandRow(self._move_jp, Ready.JAW),
        }

    def _servo_jp(self, request: Request) -> str:
        self._control.take_goal()[-1] = request.values[0]
        return self._control.adjust(request.name)

    def _servo_jf(self, request: Request) -> str:
        """From any other mode this begins Cartesian effort control, without a wrench at the tip."""
        control = self._control
        if control.motion.mode is not Mode.EFFORT:
            self._enter(request.name)
            control.push(Space.CARTESIAN).body(np.zeros(6), control.now_ns, absolute=False)
        control.efforts.jaw(float(request.values[0]), control.now_ns)
        return control.pushed()

    def _move_jp(self, request: Request) -> str:
        control = self._control
        control.take_target()[-1] = request.values[0]
        return control.move(request, control.motion.space, JAW_MOVE)
