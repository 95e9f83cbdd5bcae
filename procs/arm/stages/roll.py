"""A master's roll: driven to its lower stop, whose position is known, and its encoder set there.

The potentiometer of the roll turns several times over the joint's range, so it cannot measure the position.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from trocar.procs.arm.motion import Mode, Space
from trocar.procs.arm.stages.homing import SETTLE_NS, Driving
from trocar.procs.arm.stages.stage import Stage
from trocar.procs.arm.states import ArmEvent
from trocar.procs.arm.supervision import Generations
from trocar.procs.tables import codes

ROLL: Final = 6  # the joint, and its actuator
LOWER_STOP: Final = math.radians(-480.0)
TRAVEL: Final = 6.5 * math.pi  # further than the whole range
LAG: Final = math.pi  # this far behind its goal, the roll is at its stop
STANDING: Final = 0.5  # rad/s: slower is standstill; a roll that is only slow has not arrived
NEAR: Final = math.radians(6.0)
SET_NS: Final = 3_000_000_000
RETRY_NS: Final = 100_000_000
CLOSE: Final = math.radians(5.0)


class FindingRoll(Driving):
    """The roll moves down until it lags behind; the other joints hold."""

    def begin(self) -> None:
        control = self.control
        control.goal[...] = control.io.setpoint
        control.goal[ROLL] -= TRAVEL
        reason = control.motion.move(control.goal, control.io.velocity, control.now_ns)
        if reason:
            self.fail(codes.ROLL_PLAN, f"finding the roll's lower limit: {reason}")

    def drive(self) -> None:
        control, motion, io = self.control, self.control.motion, self.control.io
        lag = abs(float(io.position[ROLL] - motion.goal[ROLL]))
        if lag > LAG and abs(io.velocity[ROLL]) < STANDING:
            control.status("found roll lower limit")
            control.machine.fire(ArmEvent.STOPPED)
        elif not motion.moving and lag < NEAR:
            self.fail(codes.ROLL_PASSED, "went past roll lower limit")
        elif not motion.moving and control.now_ns >= motion.end_ns + SETTLE_NS:
            self.fail(codes.ROLL_TIMEOUT, "unable to hit roll lower limit in time")


class SettingRoll(Stage):
    """io sets the encoder and confirms it; the roll is limp meanwhile, and the other joints hold."""

    def enter(self) -> None:
        control = self.control
        control.goal[...] = control.io.setpoint
        control.motion.hold(control.goal, Mode.NONE)
        control.push(Space.NONE, np.arange(control.joints.size) == ROLL).rest()
        self.within(SET_NS)
        self._order = 0
        self._next_ns = 0
        self._refusal = ""

    def run(self) -> None:
        io = self.control.io
        if self.is_late:
            why = f" (io says: {self._refusal})" if self._refusal else ""
            self.fail(codes.ROLL_ENCODER, f"unable to set the roll encoder at its lower limit{why}")
        elif io.biasing.item() or not (io.in_effort[ROLL] or io.encoder_set[ROLL]):
            return
        elif io.encoder_set[ROLL]:
            self._check()
        else:
            self._ask()

    def _ask(self) -> None:
        control = self.control
        answer = control.io_requests.outcome(self._order) if self._order else None
        if answer is not None and answer.outcome != "done":
            self._refusal, self._order = answer.text, 0
        if not self._order and control.now_ns >= self._next_ns:
            self._next_ns = control.now_ns + RETRY_NS
            self._order = control.io_requests.order("set_encoder", (float(ROLL), LOWER_STOP))

    def _check(self) -> None:
        control = self.control
        reads = float(control.io.position[ROLL])
        if abs(reads - LOWER_STOP) < CLOSE:
            control.driving = Generations.now(control.io)  # positions have a new meaning from here on
            control.motion.hold(control.io.setpoint, Mode.NONE)
            control.machine.fire(ArmEvent.SET)
        else:
            self.fail(codes.ROLL_CHECK,
                      f"the roll encoder reads {math.degrees(reads):.1f}° at its lower limit, not -480°")
