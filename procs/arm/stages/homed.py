"""A homed arm that follows commands, and one that is moved by hand."""

from __future__ import annotations

import numpy as np

from trocar.procs.arm.motion import EFFORT, Mode, Space
from trocar.procs.arm.stages.stage import Stage
from trocar.procs.arm.states import ArmEvent
from trocar.procs.tables.arm_types import ARM_TYPES


class Homed(Stage):
    """Commands are followed; clipping by io is reported, and the arm's attachments are updated."""

    _limited = b""

    def enter(self) -> None:
        control, io_requests = self.control, self.control.io_requests
        control.homed_generation = int(control.io.bias_generation.item())
        here = control.io.setpoint if control.motion.mode in (Mode.NONE, Mode.EFFORT) else control.motion.goal
        control.motion.hold(here, Mode.NONE)
        io_requests.limits.want(True)
        io_requests.tracking.want(self.arm.checks_tracking)
        io_requests.pots.want(not control.arm.calibration_mode)
        io_requests.velocity.want(control.arm.use_setpoint_v)
        io_requests.brakes.want(True)

    def run(self) -> None:
        control, io = self.control, self.control.io
        control.io_requests.want_no_fault(io.is_faulty and not io.problem)  # our timeout
        control.io_requests.tracking.want(self.arm.checks_tracking and control.motion.mode is not EFFORT)
        limited = io.at_limit.tobytes()
        if limited != self._limited:
            self._limited = limited
            self._say_limited()
        self.arm.look_after()

    @property
    def waits(self) -> str:
        return self.arm.misses()

    def _say_limited(self) -> None:
        joints, axes = self.control.joints, self.control.io.at_limit.nonzero()[0]
        if len(axes):
            names = (joints.name(int(i)) if i < joints.one_to_one else f"actuator {i + 1}" for i in axes)
            self.control.status(f"position limit: {', '.join(names)}")


class Manual(Stage):
    """The clutch on the arm is pressed: efforts only against gravity, so the arm can be moved by hand; released, it
    holds.

    The instrument's joints are held meanwhile: a jaw does not drop its needle.
    """

    def enter(self) -> None:
        control = self.control
        control.io_requests.tracking.want(False)
        control.push(Space.NONE, np.arange(control.joints.size) < ARM_TYPES[control.arm.type].joints).rest()

    def run(self) -> None:
        control = self.control
        if not self.arm.is_clutched():
            control.stop(control.io.setpoint, Mode.POSITION, "the clutch was released")
            control.machine.fire(ArmEvent.RELEASED)

    @property
    def waits(self) -> str:
        return "the clutch on the arm to be released"
