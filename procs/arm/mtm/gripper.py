"""A master's gripper: its angle, and the events "closed" and "pinch".

The gripper is a robot of its own on the arm's io, without a motor: it shows its potentiometer, which needs neither
power nor a bias. That of a KINEMATIC master stays at 0.
"""

from __future__ import annotations

import math
from typing import Final

from trocar.procs.arm.control import Control
from trocar.procs.node.inputs import LATE_NS, Fields

SMOOTH_S: Final = 0.02  # time constant of the velocity


class GripperLogic:
    """Fills its part of the arm's record and raises gripper/closed and gripper/pinch."""

    def __init__(self, control: Control, io: Fields, axis: int, own: Fields) -> None:
        """`axis` of io's record, -1: none; `own` gives the arrays of the arm's record."""
        self._control = control
        self._angle = io("pot_position")[axis : axis + 1].reshape(()) if axis >= 0 else None
        self._valid, self._position, self._velocity = (
            own("gripper_valid"), own("gripper_position"), own("gripper_velocity"))
        self._debounce_ns = round(control.arm.gripper_debounce_s * 1e9)
        self._zero = control.arm.gripper_zero
        self._closed: bool | None = None  # not known yet
        self._open_ns = self._stamp_ns = 0
        self._valid[...] = False
        self._position[...] = self._velocity[...] = 0.0

    def step(self, now_ns: int) -> None:
        """Update angle and events, once a cycle."""
        io = self._control.io
        if not io.fresh:
            self._valid[...] = False
            return
        if self._control.is_kinematic:
            self._valid[...] = True
            return
        if self._angle is None:
            return
        angle = float(self._angle)
        if not (math.isfinite(angle) and 0 <= io.age_ns.item() <= LATE_NS):
            self._valid[...] = False
            return
        self._show(angle, io.stamp_ns)
        self._judge(angle <= self._zero, now_ns)

    def _show(self, angle: float, stamp_ns: int) -> None:
        passed_s = (stamp_ns - self._stamp_ns) * 1e-9
        self._stamp_ns = stamp_ns
        if not self._valid.item():
            self._velocity[...] = 0.0
        elif passed_s > 0.0:
            newest = (angle - float(self._position)) / passed_s
            self._velocity += (newest - float(self._velocity)) * passed_s / (passed_s + SMOOTH_S)
        self._position[...] = angle
        self._valid[...] = True

    def _judge(self, low: bool, now_ns: int) -> None:
        """Closed after it has been low for the debounce time; open as soon as it is not low."""
        if not low:
            self._open_ns = now_ns
        if self._closed is None:  # the first state is reported, but is no pinch
            self._closed = low
            if low:
                self._report()
        elif low is not self._closed and (not low or now_ns - self._open_ns >= self._debounce_ns):
            self._closed = low
            self._report()
            if low:
                self._control.reports.emit("gripper/pinch")

    def _report(self) -> None:
        self._control.reports.emit("gripper/closed", value=float(bool(self._closed)))
