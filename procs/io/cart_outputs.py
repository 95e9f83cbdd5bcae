"""Outputs of a Classic patient cart: its lift, and the counter of its multiplexer.

The lift is a PWM and a pin that disables its amplifier while it is high. It moves while the setup joints have their
currents (joint controller on, setpoints fresh) and `lift` goes on being asked for; else its duty cycle is neutral and
its amplifier disabled. So it stops when the process that moves it dies, is held up or begins anew.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from trocar.procs.document.cart import LIFT_OUTPUTS, MULTIPLEXER_OUTPUTS
from trocar.procs.io.digital_outputs import DigitalOutputs
from trocar.procs.io.record import IoRecord
from trocar.procs.io.robots import Robots

NEUTRAL, GAIN = 0.5, 0.1  # duty cycle at rest, and what full speed adds to it
HOLD_NS: Final = 30_000_000
"""For so long a command counts that has to be repeated: `lift` and `setup_brake`."""


@dataclass(slots=True)
class Lift:
    """`duty` and `disable` are places of outputs."""

    robot: int
    duty: int
    disable: int
    velocity: float = 0.0
    until_ns: int = 0
    kept: float = math.nan  # the velocity that its outputs have


class CartOutputs:
    """Those of all carts of one io."""

    def __init__(self, robots: Robots, record: IoRecord, outputs: DigitalOutputs) -> None:
        """All lifts rest, whatever a predecessor left."""
        self._record, self._outputs = record, outputs
        self._lifts: dict[int, Lift] = {}
        self._counters: dict[int, tuple[int, int]] = {}
        for robot, name in enumerate(robots.names):
            duty, disable = (outputs.place(output, "lift", name) for output in LIFT_OUTPUTS)
            first, following = (outputs.place(output, "multiplexer", name) for output in MULTIPLEXER_OUTPUTS)
            if duty is not None and disable is not None:
                self._lifts[robot] = Lift(robot, duty, disable)
            if first is not None and following is not None:
                self._counters[robot] = first, following
        self.shutdown()

    def lift(self, robot: int, velocity: float, now_ns: int) -> str:
        """Move the lift of a robot for a moment, or stop it; returns why not, or ""."""
        lift = self._lifts.get(robot)
        if lift is None:
            return "it has no lift"
        reason = self._outputs.pwm_objection(lift.duty, NEUTRAL) if velocity else ""
        if velocity and not self._is_driven(robot):
            reason = "its setup joints are not enabled"
        if not reason:
            lift.velocity, lift.until_ns = velocity, now_ns + HOLD_NS
        return reason

    def multiplexer(self, robot: int, on: bool) -> str:
        """To the next channel, or to the first one; returns why not, or ""."""
        if robot not in self._counters:
            return "it has no multiplexer"
        first, following = self._counters[robot]
        self._outputs.set(following, on)
        if not on:
            self._outputs.set(first, False)
        return ""

    def step(self, now_ns: int) -> None:
        """Once a cycle, also after a bad read."""
        for lift in self._lifts.values():
            if lift.velocity and (now_ns > lift.until_ns or not self._is_driven(lift.robot)):
                lift.velocity = 0.0
            if lift.velocity != lift.kept:
                self._keep(lift)

    def shutdown(self) -> None:
        """All rest."""
        for lift in self._lifts.values():
            lift.velocity = 0.0
            self._keep(lift)

    def _is_driven(self, robot: int) -> bool:
        return bool(self._record.pid_enabled[robot] and not self._record.holding[robot])

    def _keep(self, lift: Lift) -> None:
        lift.kept = lift.velocity
        self._outputs.keep(lift.duty, NEUTRAL + GAIN * lift.velocity)
        self._outputs.keep(lift.disable, float(not lift.velocity))
