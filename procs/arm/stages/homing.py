"""From power to a homed arm: encoders from potentiometers, then, by the joint controller, to the homing position."""

from __future__ import annotations

from typing import Final

from trocar.procs.arm.motion import Mode
from trocar.procs.arm.stages.stage import SWITCH_NS, Stage
from trocar.procs.arm.states import ArmEvent
from trocar.procs.arm.supervision import Generations
from trocar.procs.tables import codes

BIAS_SAMPLES: Final = 1970.0
BIAS_NS: Final = 30_000_000_000
BRAKES_NS: Final = 4_000_000_000  # those of a Classic ECM take 2 s to release
SETTLE_NS: Final = 2_000_000_000


class Calibrating(Stage):
    """io sets the encoders from the mean of potentiometer samples, or finds them preset."""

    def enter(self) -> None:
        control = self.control
        control.held = False
        control.io_requests.brakes.want(False)
        control.io_requests.pid.want(control.is_kinematic)
        self.within(BIAS_NS)
        self._asked = False

    def run(self) -> None:
        control, io_requests, arm = self.control, self.control.io_requests, self.control.arm
        if control.is_kinematic:
            self._done()
        elif self.is_late:
            self.fail(codes.BIAS_TIMEOUT, "failed to bias encoders (timeout)")
        elif self._asked:
            if io_requests.bias_done:
                self._done()
        elif io_requests.pid.settled and not control.io.biasing.item():
            again = arm.re_home or arm.calibration_mode
            if not control.must_bias and not again and control.io.biased.item():
                control.machine.fire(ArmEvent.BIASED)
                return
            io_requests.bias(BIAS_SAMPLES if again or arm.generation == "Si" else -BIAS_SAMPLES, self.arm.not_by_pots)
            self._asked = True

    @property
    def waits(self) -> str:
        return "io has not yet set the encoders from the potentiometers" if self._asked else ""

    def _done(self) -> None:
        self.control.must_bias = False
        self.control.machine.fire(ArmEvent.BIASED)


class Biased(Stage):
    """Joint values are valid; continue to homing, after the steps this arm needs before."""

    def enter(self) -> None:
        self.control.io_requests.pots.want(not self.control.arm.calibration_mode)

    def run(self) -> None:
        if self.control.machine.goes_on:
            self.control.machine.fire(self.arm.before_homing())


class Driving(Stage):
    """A stage that first has io switch the joint controller on, then release the brakes, then begins."""

    def enter(self) -> None:
        control, io_requests = self.control, self.control.io_requests
        io_requests.limits.want(False)
        io_requests.tracking.want(self.arm.checks_tracking)
        io_requests.velocity.want(control.arm.use_setpoint_v)
        io_requests.pid.want(True)
        self.within(SWITCH_NS)
        self._begun = False

    def run(self) -> None:
        if self._begun:
            self.drive()
        elif self._is_ready():
            self._begun = True
            control = self.control
            control.io_requests.pid.want(None)  # from now on a controller that goes off is a fault, not to be repaired
            control.motion.hold(control.io.setpoint, Mode.NONE)
            self.begin()
        elif self.is_late:
            self.fail(codes.IO_SWITCH, "io does not switch the joint controller on")

    @property
    def waits(self) -> str:
        if self._begun:
            return ""
        return "brakes to release" if self.control.io_requests.pid.settled else "io to switch the joint controller on"

    def _is_ready(self) -> bool:
        control, io_requests = self.control, self.control.io_requests
        if not (io_requests.pid.settled and io_requests.limits.settled and io_requests.tracking.settled):
            return False
        if control.driving is None or int(control.io.pid_generation.item()) != control.driving.pid:
            control.driving = Generations.now(control.io)
            control.motion.hold(control.io.setpoint, Mode.NONE)
            self.within(SWITCH_NS + BRAKES_NS)
        io_requests.brakes.want(True)  # only now that the joint controller holds the arm
        return io_requests.brakes.settled

    def begin(self) -> None:
        """io follows, and brakes no longer hold the arm."""

    def drive(self) -> None:
        """Called once a cycle from then on."""


class Homing(Driving):
    """Move to the homing position; homed when every joint has arrived, as in any move."""

    def begin(self) -> None:
        control = self.control
        control.goal[...] = self.arm.home()
        outside = control.joints.clip(control.goal)
        if outside.any():  # io will enforce the limits once homed: go there smoothly now
            control.status(f"moving into the joint limits: {control.joints.named(outside)}")
        reason = control.motion.move(control.goal, control.io.velocity, control.now_ns)
        if reason:
            self.fail(codes.HOMING_PLAN, f"homing: {reason}")

    def drive(self) -> None:
        control, motion = self.control, self.control.motion
        if motion.moving:
            return
        short = control.short()
        if not short:
            control.machine.fire(ArmEvent.ARRIVED)
            self.arm.report_attached()
        elif control.now_ns >= motion.end_ns + SETTLE_NS:
            self.fail(codes.HOMING_TIMEOUT, f"unable to reach home position during calibration on pots: {short}")
