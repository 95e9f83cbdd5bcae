"""Outputs of patient carts: lift and multiplexer of Classic carts, brakes of the setup joints that carry Si arms.

The lift is a PWM and a pin that disables its amplifier while it is high. The lift moves while the setup joints have
their currents (joint controller on, setpoints fresh) and `lift` is repeated; else its duty cycle is neutral and its
amplifier disabled. So it stops when the commanding process dies, stalls or restarts.

The brakes of Si setup joints release while a clutch button is pressed and the arm has power. Their buttons and their
brake are on the controllers of the arm, under the names of the original's files: NAME_SUJ_clutch, NAME_SUJ_clutch_2 and
NAME_SUJ_brake (high: release). I/O does this by itself, from the levels of the buttons. A repeated `setup_brake` acts
like a pressed button. Both count only after they were seen released since the arm has power: a stuck button, or a
command repeated since before, releases nothing.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from trocar.procs.document.cart import LIFT_OUTPUTS, MULTIPLEXER_OUTPUTS, SETUP_BRAKE
from trocar.procs.io.digital_outputs import DigitalOutputs
from trocar.procs.io.record import Flags
from trocar.procs.io.robots import IoData
from trocar.procs.tables import codes

NEUTRAL, GAIN = 0.5, 0.1  # duty cycle at rest, and its change for full speed
HOLD_NS: Final = 30_000_000
"""How long a command counts that must be repeated: `lift` and `setup_brake`."""
BUTTONS: Final = ("SUJ_clutch", "SUJ_clutch_2")


@dataclass(slots=True)
class Lift:
    """`duty` and `disable` are indices of outputs."""

    robot: int
    duty: int
    disable: int
    velocity: float = 0.0
    until_ns: int = 0
    kept: float = math.nan  # the velocity its outputs are set to


class CartOutputs:
    """Outputs of all carts of one io."""

    def __init__(self, data: IoData, outputs: DigitalOutputs) -> None:
        """All lifts rest, whatever the previous process left."""
        self._record, self._outputs = data.record, outputs
        self._lifts: dict[int, Lift] = {}
        self._counters: dict[int, tuple[int, int]] = {}
        for robot, name in enumerate(data.robots.names):
            duty, disable = (outputs.place(output, "lift", name) for output in LIFT_OUTPUTS)
            first, following = (outputs.place(output, "multiplexer", name) for output in MULTIPLEXER_OUTPUTS)
            if duty is not None and disable is not None:
                self._lifts[robot] = Lift(robot, duty, disable)
            if first is not None and following is not None:
                self._counters[robot] = first, following
        self.shutdown()

    def lift(self, robot: int, velocity: float, now_ns: int) -> str:
        """Move the lift of a robot for a moment, or stop it; returns the reason for a refusal, or ""."""
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
        """Switch to the next channel, or to the first one; returns the reason for a refusal, or ""."""
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
        """Stop all lifts."""
        for lift in self._lifts.values():
            lift.velocity = 0.0
            self._keep(lift)

    def _is_driven(self, robot: int) -> bool:
        return bool(self._record.pid_enabled[robot] and not self._record.holding[robot])

    def _keep(self, lift: Lift) -> None:
        lift.kept = lift.velocity
        self._outputs.keep(lift.duty, NEUTRAL + GAIN * lift.velocity)
        self._outputs.keep(lift.disable, float(not lift.velocity))


@dataclass(slots=True)
class SetupBrake:
    """The setup joints' brake under one arm; `inputs` and `output` are indices in the record."""

    inputs: Flags
    output: int
    let_go: bool = False
    pressed: bool = False
    powered: bool = False
    counts: bool = False  # since power-on, buttons and command were inactive at least once
    until_ns: int = 0  # end of a command


class SetupBrakes:
    """Setup brakes of all arms of one io."""

    def __init__(self, data: IoData, outputs: DigitalOutputs) -> None:
        """All hold, whatever the previous process left."""
        self._record, self._reports, self._outputs = data.record, data.reports, outputs
        self._robots = robots = data.robots
        buttons = [i.name for i in robots.io.digital_inputs]
        self._brakes: dict[int, SetupBrake] = {}
        for robot, name in enumerate(robots.names):
            output = outputs.place(f"{name}_{SETUP_BRAKE}", "setup_brake", name)
            if output is not None:
                inputs = np.isin(buttons, [f"{name}_{end}" for end in BUTTONS])
                self._brakes[robot] = SetupBrake(inputs, output)
        self.shutdown()

    def set(self, robot: int, on: bool, now_ns: int) -> str:
        """Release the brakes under an arm for a moment, or engage them; returns the reason for a refusal, or ""."""
        brake = self._brakes.get(robot)
        if brake is None:
            return "io controls no brakes of setup joints under it"
        brake.until_ns = now_ns + HOLD_NS if on else 0
        return "its amplifiers are not on" if on and not self._record.amps_on[robot] else ""

    def step(self, now_ns: int) -> None:
        """Once a cycle, also after a bad read: without power, the brakes hold."""
        for robot, brake in self._brakes.items():
            self._follow(robot, brake, now_ns)

    def _follow(self, robot: int, brake: SetupBrake, now_ns: int) -> None:
        record, name = self._record, self._robots.names[robot]
        pressed, powered = bool(record.input[brake.inputs].any()), bool(record.amps_on[robot])
        held = pressed or now_ns <= brake.until_ns
        # An amplifier that is off for less than io tolerates ends nothing: io reports no fault of it, either.
        brake.counts = bool(record.power_requested[robot]) and (brake.counts or (powered and not held))
        let_go = powered and held and brake.counts
        if pressed and powered and not brake.powered:
            self._reports.warn(codes.CLUTCH_STUCK, name)
        elif pressed and not powered and not brake.pressed:
            self._reports.status("the arm needs power before the brakes of its setup joints are released", name)
        brake.pressed, brake.powered = pressed, powered
        if let_go != brake.let_go:
            brake.let_go = let_go
            self._outputs.keep(brake.output, float(let_go))
            self._reports.status(f"brakes of the setup joints {'released' if let_go else 'engaged'}", name)

    def shutdown(self) -> None:
        """Engage all."""
        for brake in self._brakes.values():
            brake.let_go = False
            self._outputs.keep(brake.output, 0.0)
