"""A PSM: the instruments it may carry, the jaw, and what keeps its tip out of the cannula."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from procs.arm.arm import Arm
from procs.arm.commands import Ready, Row, Table
from procs.arm.control import JAW_MOVE, Refused
from procs.arm.joints import joints
from procs.arm.machine import Request
from procs.arm.motion import Mode
from procs.arm.states import State
from procs.arm.takeover import Predecessor
from procs.lib.arm import Tool

Array = NDArray[np.float64]


class Psm(Arm):
    """See Arm."""

    def prepare(self, before: Predecessor | None) -> None:
        """Go on with the instrument that a predecessor had."""
        arm = self.control.arm
        if before is not None and arm.tool_detection != "FIXED":
            tool = self._tool(before.tool)
            if tool is not None:
                self.control.use(joints(arm, tool))

    def tables(self) -> Iterable[Table]:
        """See Arm."""
        return ({
            "jaw/servo_jp": Row(self._jaw_servo_jp, Ready.JAW, (1,), streams=True),
            "jaw/servo_jf": Row(self._jaw_servo_jf, Ready.JAW, (1,), streams=True),
            "jaw/move_jp": Row(self._jaw_move_jp, Ready.JAW, (1,), moves=True),
            "set_tool_type": Row(self._set_tool_type),
        },)

    def home(self) -> Array:
        """See Arm; with an instrument on it stays."""
        control = self.control
        if not control.is_played and control.joints.has_jaw:
            here: Array = self.io.setpoint.copy()
            return here
        return super().home()

    # the jaw is the last of a joint vector

    def _jaw_servo_jp(self, request: Request) -> str:
        self.control.take_goal()[-1] = request.values[0]
        return self.control.adjust()

    def _jaw_servo_jf(self, request: Request) -> str:
        control = self.control
        if control.motion.mode is not Mode.EFFORT:
            raise Refused("jaw/servo_jf: the arm is not in effort mode; send servo_jf or free first")
        control.motion.effort[-1] = request.values[0]
        return ""

    def _jaw_move_jp(self, request: Request) -> None:
        control = self.control
        control.take_target()[-1] = request.values[0]
        control.move(request, control.motion.space, JAW_MOVE)

    def _set_tool_type(self, request: Request) -> str:
        control, arm = self.control, self.control.arm
        if self.machine.moving or self.state is State.HOMING or control.motion.mode is Mode.EFFORT:
            raise Refused("set_tool_type: the arm is moving or in effort mode")
        if arm.tool_detection == "FIXED":
            raise Refused("set_tool_type: tool detection is FIXED, the instrument is the one of the arm's file")
        name = request.text.strip()
        tool = self._tool(name)
        if tool is None:
            known = ", ".join(t.name for t in arm.tools) or "none"
            raise Refused(f"set_tool_type: no instrument {name or '(empty)'}; known are: {known}"[:199])
        try:
            control.use(joints(arm, tool))
        except ValueError as error:
            raise Refused(f"set_tool_type: {error}") from None
        control.status(f"instrument {tool.name}")
        return ""

    def _tool(self, name: str) -> Tool | None:
        arm, wanted = self.control.arm, name.replace(":", "_").upper()
        known = arm.tools + ((arm.tool,) if arm.tool is not None else ())
        return next((tool for tool in known if wanted and tool.name.replace(":", "_").upper() == wanted), None)
