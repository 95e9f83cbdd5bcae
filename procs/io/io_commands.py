"""io's commands: one method per row of the `io` command table. A refusal gives the reason and the step to do first."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Final

import numpy as np

from trocar.procs.io.arm_requests import DesiredCommand
from trocar.procs.io.assemble import Parts
from trocar.procs.io.axis_drive import AxisDriveOrder
from trocar.procs.io.bus.transport import PortError
from trocar.procs.io.digital_outputs import DigitalOutputs
from trocar.procs.io.record import Flags
from trocar.procs.node.fault_report import fault_of
from trocar.procs.node.requests import CommandRefused, switch
from trocar.procs.tables import codes
from trocar.procs.tables.desired_state import SETTINGS, SWITCHING
from trocar.shm.commands import COMMANDS
from trocar.shm.mailbox.generations import OwnCell
from trocar.shm.mailbox.guard import unauthorized
from trocar.shm.mailbox.received import Request

ABOUT: Final = {"set_output": "output", "set_pwm": "output", "trigger_read": "instrument reader"}  # others: a robot
WITH_MORE: Final = ("set_gains",)  # whose text continues after the name
WHO: Final = "@"
UNKNOWN: Final = "another program"  # a sender without a name
EXACT: Final = "its positions are exact, and there are no encoders to set"
NOT_KINEMATIC: Final = {
    "bias_encoders": EXACT, "set_encoder": EXACT, "drive_axis": "it has no motors", "supply_on": "it has no supply",
    "brake_current": "it has no brakes",
    "lift": "it has no lift", "setup_brake": "it has no brakes", "multiplexer": "it has no multiplexer",
    "set_gains": "its positions follow the setpoints exactly, whatever its gains"}
"""Commands that KINEMATIC robots refuse, and why."""
MAX_SAMPLES: Final = 100_000
MAX_POWERING: Final = 16  # requests of one robot that wait for power at the same time


class IoCommands:
    """Carries out commands; power and bias answer again when they are finished."""

    def __init__(self, parts: Parts) -> None:
        self._parts, self._robots, self._record = parts, parts.robots, parts.record
        self._names = {"robot": parts.robots.names, "output": parts.digital_outputs.names,
                       "instrument reader": parts.instruments.names}
        self._powering: list[tuple[int, Request]] = []
        self._biasing: list[tuple[int, Flags, Request]] = []  # robot, flags that show completion, request
        self.waits = False
        """Whether an accepted command has not finished."""
        self._now_ns = 0
        self._table: dict[str, Callable[[int, Request], None]] = {
            row.name: getattr(self, f"_{row.name}") for row in COMMANDS["io"]}

    def execute(self, commands: Iterable[Request], now_ns: int) -> None:
        """Carry out received commands, then desired states. A command that switches a robot voids its arm's desired
        states.
        """
        self._now_ns = now_ns
        for command in commands:
            robot = self._carry_out(command)
            if robot >= 0 and command.name == "power_off":
                self._parts.faults[robot].void_earlier(command.origin)
            if robot >= 0 and command.name in SWITCHING:
                who = command.origin.program or UNKNOWN
                self._parts.desired.void(robot, f"{who} requested {command.name} meanwhile")
        for desired in self._parts.desired.due():
            self._carry_out(desired)

    def _carry_out(self, command: Request) -> int:
        """Returns the index of the robot, output or reader, -1 if refused."""
        try:
            action = self._table.get(command.name)
            if action is None:
                raise CommandRefused(f"io has no command {command.name}; it has: {', '.join(self._table)}")
            place = self._place(command)
            row, values = command.command, command.values
            _refuse_if(row.objection(values) or unauthorized(row, command.text, values, command.origin,
                                                             self._cell_of(place, command)))
            if command.name in NOT_KINEMATIC and self._robots.kinematic[place]:
                raise CommandRefused(f"it is KINEMATIC: {NOT_KINEMATIC[command.name]}")
            action(place, command)
        except (CommandRefused, PortError) as reason:
            command.refuse(str(reason))
            return -1
        return place

    def _cell_of(self, place: int, command: Request) -> OwnCell | None:
        """Faults that require a new command; None where a desired state sets the checks of the arm's own robot."""
        is_mode = isinstance(command, DesiredCommand) and command.name in SETTINGS
        return None if is_mode or command.name in ABOUT else self._parts.faults[place]

    def answer(self) -> None:
        """Answer the finished commands."""
        if not self.waits:
            return
        record = self._record
        for robot, command in list(self._powering):
            if record.amps_on[robot] and record.powered[robot]:
                command.done()
            elif not record.power_requested[robot]:
                command.fail(self._why(robot, "power was switched off"))
            else:
                continue
            self._powering.remove((robot, command))
        for waiting in list(self._biasing) if self._biasing else ():
            robot, shown, command = waiting
            if not record.biasing[robot]:
                self._biasing.remove(waiting)
                if shown.all():
                    command.done()
                else:
                    command.fail(self._why(robot, "the bias was aborted"))
        self.waits = bool(self._powering or self._biasing)

    def _why(self, robot: int, otherwise: str) -> str:
        fault = fault_of(int(self._record.fault[robot]))
        return f"{fault.cause}; {fault.remedy_for(self._robots.names[robot])}" if fault else otherwise

    def _place(self, command: Request) -> int:
        """Index of the robot, output or instrument reader in the command."""
        name = command.text if command.name not in WITH_MORE else command.text.partition(" ")[0]
        kind = ABOUT.get(command.name, "robot")
        names = self._names[kind]
        if name not in names:
            raise CommandRefused(f"no {kind} {name!r} here; there are: {', '.join(names) or 'none'}")
        return names.index(name)

    def _set_output(self, output: int, command: Request) -> None:
        self._need_writable(command)
        self._free_outputs(output).set(output, switch(command))
        command.done()

    def _set_pwm(self, output: int, command: Request) -> None:
        self._need_writable(command)
        _finish(command, self._free_outputs(output).set_pwm(output, float(command.values[0])))

    def _need_writable(self, command: Request) -> None:
        """Refuse to switch something on where the bus is only read."""
        if command.values.any():
            _refuse_if(self._parts.port.read_only)

    def _free_outputs(self, output: int) -> DigitalOutputs:
        """The outputs, if io does not set this one by itself."""
        outputs = self._parts.digital_outputs
        owner = outputs.owner(output)
        if owner and not self._robots.io.calibration_mode:
            raise CommandRefused(f"only io sets it: use {owner}, or start in calibration mode")
        return outputs

    def _lift(self, robot: int, command: Request) -> None:
        self._need_writable(command)
        _finish(command, self._parts.cart.lift(robot, float(command.values[0]), self._now_ns))

    def _setup_brake(self, robot: int, command: Request) -> None:
        self._need_writable(command)
        _finish(command, self._parts.setup_brakes.set(robot, switch(command), self._now_ns))

    def _multiplexer(self, robot: int, command: Request) -> None:
        self._need_writable(command)
        _finish(command, self._parts.cart.multiplexer(robot, switch(command)))

    def _power_on(self, robot: int, command: Request) -> None:
        if sum(waiting == robot for waiting, _ in self._powering) >= MAX_POWERING:
            raise CommandRefused("power-on is already pending")
        was_on = bool(self._record.power_requested[robot])
        if why := self._parts.power.on(robot, self._now_ns):
            raise CommandRefused(why)
        if not was_on:
            self._record.fault[robot] = 0
        command.accept()
        self._powering.append((robot, command))
        self.waits = True

    def _supply_on(self, robot: int, command: Request) -> None:
        _finish(command, self._parts.power.supply(robot, self._now_ns, float(command.values[0])))

    def _power_off(self, robot: int, command: Request) -> None:
        self._parts.axis_drive.stop(robot, "power was switched off")
        self._parts.brake_trials.stop(robot)
        self._parts.follow.enable(robot, False, self._now_ns)
        self._parts.power.off(robot, bool(len(command.values) and command.values[0]))
        command.done()

    def _bias_encoders(self, robot: int, command: Request) -> None:
        samples = command.values[0]
        if not 1.0 <= abs(samples) <= MAX_SAMPLES:
            raise CommandRefused(f"samples {samples}; allowed: 1 to {MAX_SAMPLES}, or negative")
        axes = self._robots.slices[robot]
        left_out = np.zeros(axes.stop - axes.start, dtype=bool)
        for value in command.values[1:]:
            left_out[self._axis(robot, float(value))] = True
        bias = self._parts.bias
        _refuse_if(bias.objection(robot, int(samples), left_out))
        self._need_off(robot)
        self._need_rest(robot)
        bias.begin(robot, int(samples), left_out)
        command.accept()
        self._biasing.append((robot, self._record.biased[robot : robot + 1], command))
        self.waits = True

    def _set_encoder(self, robot: int, command: Request) -> None:
        axis, position = self._axis(robot, float(command.values[0])), float(command.values[1])
        bias = self._parts.bias
        _refuse_if(bias.set_objection(robot, axis, position))
        place = self._robots.slices[robot].start + axis
        if not self._record.effort_mode[place]:  # no controller uses its position then, and the other axes keep holding
            self._need_off(robot)
        self._need_rest(robot)
        bias.set_one(robot, axis, position)
        command.accept()
        self._biasing.append((robot, self._record.encoder_set[place : place + 1], command))
        self.waits = True

    def _axis(self, robot: int, value: float) -> int:
        axes = self._robots.slices[robot]
        count = axes.stop - axes.start
        if not (0.0 <= value < count and value.is_integer()):
            raise CommandRefused(f"axis {value:g}; allowed: 0 to {count - 1}")
        return int(value)

    def _need_off(self, robot: int) -> None:
        """Encoders are set only while no controller uses them."""
        if self._record.pid_enabled[robot]:
            raise CommandRefused("the joint controller is on; switch it off first")

    def _need_rest(self, robot: int) -> None:
        """And only while they are sampled."""
        record = self._record
        if record.biasing[robot]:
            raise CommandRefused("a bias is under way")
        if not record.robot_valid[robot]:
            raise CommandRefused("there is no good sample of its controllers")

    def _drive_axis(self, robot: int, command: Request) -> None:
        record = self._record
        axis, current_a, rise_s, travel, release = (float(value) for value in command.values)
        order = AxisDriveOrder(self._axis(robot, axis), current_a, rise_s, travel, bool(release))
        _refuse_if(self._parts.axis_drive.objection(robot, order))
        self._need_off(robot)
        self._need_rest(robot)
        if not (record.powered[robot] and record.amps_on[robot]):
            raise CommandRefused("its amplifiers are not on")
        if robot in self._parts.brake_trials.running:
            raise CommandRefused("a brake is being tried")
        if order.release:
            self._need_brakes(robot)
        command.accept()
        self._parts.axis_drive.begin(robot, order, command, self._now_ns)

    def _brake_current(self, robot: int, command: Request) -> None:
        axis, current_a = self._axis(robot, float(command.values[0])), float(command.values[1])
        self._need_off(robot)
        self._need_rest(robot)
        if not self._record.amps_on[robot]:
            raise CommandRefused("its amplifiers are not on")
        if robot in self._parts.axis_drive.running or self._record.brakes_released[robot]:
            raise CommandRefused("an axis is being driven, or its brakes are released")
        _finish(command, self._parts.brake_trials.give(robot, axis, current_a, self._now_ns))

    def _brake_release(self, robot: int, command: Request) -> None:
        self._need_brakes(robot)
        if not self._record.amps_on[robot]:
            raise CommandRefused("its amplifiers are not on")
        held = self._record.pid_enabled[robot] or not self._parts.follow.controlled(robot)
        if not (held or self._robots.io.calibration_mode):
            raise CommandRefused("its joint controller is off, and nothing else would hold it; switch that on first")
        self._parts.brake_trials.stop(robot)
        self._parts.brakes.release(robot)
        command.done()

    def _brake_engage(self, robot: int, command: Request) -> None:
        self._need_brakes(robot)
        self._parts.axis_drive.stop(robot, "the brakes were engaged")
        self._parts.brake_trials.stop(robot)
        self._parts.brakes.engage(robot)
        command.done()

    def _need_brakes(self, robot: int) -> None:
        if not self._parts.brakes.has(robot):
            raise CommandRefused("it has no brakes")

    def _pid_enable(self, robot: int, command: Request) -> None:
        record, on, gains = self._record, switch(command), self._parts.gains
        if on and not record.pid_enabled[robot]:
            if not self._parts.follow.controlled(robot):
                raise CommandRefused("it has no joint controller")
            if self._robots.motors_off[robot]:
                raise CommandRefused(codes.CALIBRATION_MOTORS.cause)
            biased = record.biased | ~self._robots.with_encoders  # without encoders there is nothing to bias
            for flag, what in ((record.powered, "it is not powered"), (record.amps_on, "its amplifiers are not on"),
                               (biased, "its encoders are not biased")):
                if not flag[robot]:
                    raise CommandRefused(what)
            if record.biasing[robot]:
                raise CommandRefused("a bias is under way")
            if record.fault[robot]:
                raise CommandRefused(self._why(robot, "a fault is latched"))
            if not record.robot_valid[robot]:
                raise CommandRefused("there is no good sample of its controllers")
            _refuse_if(gains.objection(robot))
            self._parts.follow.enable(robot, True, self._now_ns)
            gains.switched_on(robot)
        elif not on and record.pid_enabled[robot]:
            self._let_off(robot)
        command.done()

    def _servo_zero(self, robot: int, command: Request) -> None:
        self._parts.axis_drive.stop(robot, "servo_zero")
        self._let_off(robot)
        command.done()

    def _let_off(self, robot: int) -> None:
        """Joint controller off; brakes hold the axes it no longer holds."""
        self._parts.follow.enable(robot, False, self._now_ns)
        self._parts.brakes.engage(robot)

    def _enforce_limits(self, robot: int, command: Request) -> None:
        self._need_agreement(robot, command)
        _finish(command, self._parts.follow.enforce_limits(robot, switch(command)))

    def _tracking_check(self, robot: int, command: Request) -> None:
        self._need_agreement(robot, command)
        self._record.tracking_check[robot] = switch(command)
        self._parts.pid.check_tracking(self._robots.slices[robot], switch(command))
        command.done()

    def _pot_check(self, robot: int, command: Request) -> None:
        on = switch(command)
        self._need_agreement(robot, command)
        calibrating = on and self._robots.io.calibration_mode
        self._record.pot_check[robot] = on and not calibrating
        self._parts.safety.forget_pots(self._robots.slices[robot])
        self._parts.power.changed = True
        command.done(codes.CALIBRATION_MODE.cause if calibrating else "")

    def _need_agreement(self, robot: int, command: Request) -> None:
        """Refuse a command against the check setting that the robot's arm requires, except in calibration mode; other
        senders that relax a check are reported.
        """
        if isinstance(command, DesiredCommand):
            return
        on = switch(command)
        arm = self._parts.desired.wants(robot, command.name, not on)
        if arm and not self._robots.io.calibration_mode:
            raise CommandRefused(f"{arm} needs it {'off' if on else 'on'}; disable {arm} first")
        if not on:
            self._parts.reports.status(f"{command.name} is off: {command.origin.program or UNKNOWN} switched it off",
                                 self._robots.names[robot])

    def _use_setpoint_v(self, robot: int, command: Request) -> None:
        self._parts.follow.use_velocity(robot, switch(command))
        command.done()

    def _set_gains(self, robot: int, command: Request) -> None:
        words = command.text.split()[1:]
        who = [word[1:] for word in words if word.startswith(WHO)]
        keys = [word for word in words if not word.startswith(WHO)]
        values = [float(value) for value in command.values]
        gains = self._parts.gains
        _refuse_if(gains.change(robot, int(values[0]), keys, values[1:], who[0] if who else "another program"))
        command.done(gains.objection(robot))

    def _trigger_read(self, reader: int, command: Request) -> None:
        _refuse_if(self._parts.instruments.begin(reader, command, self._now_ns))

    def _clear_fault(self, robot: int, command: Request) -> None:
        self._record.fault[robot] = 0
        command.done()


def _refuse_if(reason: str) -> None:
    if reason:
        raise CommandRefused(reason)


def _finish(command: Request, reason: str) -> None:
    _refuse_if(reason)
    command.done()
