"""Classic setup joints: potentiometers behind a multiplexer, brakes released by clutch buttons, one lift.

The pose of a setup arm is known three whole rounds of the multiplexer after it came to rest; it is lost as soon as the
arm is clutched, the lift moves it or the samples stop.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from trocar.procs.document.cart import Cart, CartArm
from trocar.procs.kinematics.poses import Array
from trocar.procs.node.fault_report import NO_FAULT, FaultReport
from trocar.procs.node.inputs import Fields
from trocar.procs.suj.buttons import CLUTCH_COMMAND_NS, SetupButtons
from trocar.procs.suj.interface_board import InterfaceBoard
from trocar.procs.suj.machine import SetupPower, SetupState
from trocar.procs.suj.multiplexer import INCREMENT, PLUGS, Multiplexer
from trocar.procs.suj.pots import CLASSIC_LIMITS, PotReadings
from trocar.procs.suj.setups import Setups
from trocar.procs.tables import codes
from trocar.shm.system.events import Events

ROUNDS: Final = 3  # whole ones, after the one during which the arm came to rest
MAX_ROUND_NS: Final = 5_000_000_000
POWER_NS: Final = 4_000_000_000  # io gives up by itself after 3 s
OLD_FAULT_NS: Final = 200_000_000  # by then the power-on has cleared earlier latched faults
JOINTS: Final = 6
LIFT_COMMAND_NS: Final = 1_000_000_000
LIFT_REPEAT_NS: Final = 10_000_000  # io stops the lift 30 ms after the last command
RAMP_A_S: Final = 8.0


class SetupArmBrakes:
    """A current releases the brakes of one setup arm, along a ramp of 8 A/s up and down.

    `current` (n,) is the commanded current for the brakes of each setup arm, A; they hold where `engaged`.
    """

    def __init__(self, arms: tuple[CartArm, ...]) -> None:
        """All engaged, without current."""
        release = np.array([arm.release_current for arm in arms])
        self._sign = np.where(release < 0.0, -1.0, 1.0)  # files have the ramp's sizes; the wiring may invert them
        self._release = np.abs(release)
        self._hold = np.array([arm.engaged_current for arm in arms])
        self._size: Array = np.zeros(len(arms))
        self.current: Array = np.zeros(len(arms))
        self.engaged: NDArray[np.bool_] = np.ones(len(arms), dtype=bool)

    def step(self, dt_s: float, clutched: NDArray[np.bool_]) -> None:
        """Advance by `dt_s`, releasing the brakes of clutched arms."""
        goal = np.where(clutched, self._release, self._hold)
        most = RAMP_A_S * dt_s
        self._size += np.clip(goal - self._size, -most, most)
        np.multiply(self._sign, self._size, out=self.current)
        np.equal(self._size, self._hold, out=self.engaged)
        self.engaged[clutched] = False

    def cut(self) -> None:
        """No power: the brakes hold at once."""
        self._size.fill(0.0)
        self.current.fill(0.0)
        self.engaged.fill(True)


class Classic(SetupPower):
    """The work of a Classic cart in each cycle; also its power."""

    def __init__(self, cart: Cart, setups: Setups, board: InterfaceBoard, reports: Events, field: Fields,
                 setpoint: Fields, multiplexer: Multiplexer | None = None) -> None:
        """`field` and `setpoint` give the arrays of the state record and of the setpoints."""
        n = len(cart.arms)
        self._name, self._arms, self._setups, self._board = cart.name, cart.arms, setups, board
        self._reports = reports
        self._brakes = SetupArmBrakes(cart.arms)
        self._multiplexer = multiplexer or Multiplexer()
        self._readings = PotReadings(setups, CLASSIC_LIMITS, reports)
        self._plugs = np.array([arm.plug - 1 for arm in cart.arms], dtype=np.intp)
        self._lifts = np.array([arm.lifts for arm in cart.arms], dtype=bool)
        self._rest = [-1] * n  # whole rounds at rest, from -1: one has begun before
        self.buttons = SetupButtons(cart.arms, reports, 1)  # of the arms, and of the lift
        self._lift_asked = 0.0
        self._lift_sent: float | None = None
        self._lift_sent_ns = 0
        self._is_held_back = False
        self._round_ns = self._asked_ns = self._before_ns = 0
        self._rounds = 0
        self._is_away = True
        self._driving_epoch = 0
        self._wrong: tuple[int, int] | None = None
        self._current, self._clutched = field("brake_current"), setups.clutched
        self._primary, self._secondary = field("primary_voltage"), field("secondary_voltage")
        self._extra, self._lift_shown, self._rounds_shown = field("extra_voltage"), field("lift"), field("rounds")
        self._mode, self._effort, self._in_effort = setpoint("mode"), setpoint("effort"), setpoint("in_effort")
        self._pid_generation, self._bias_generation = setpoint("pid_generation"), setpoint("bias_generation")
        setpoint("count")[...] = PLUGS
        self._in_effort[:PLUGS] = True
        self._rounds_shown[...] = 0

    # -- power ---------------------------------------------------------------------------------------------------------

    def on(self, now_ns: int) -> None:
        """Begin to power on."""
        self._asked_ns = now_ns
        self._driving_epoch = self._board.epoch
        self._board.ask("power_on")

    def off(self) -> None:
        """Power off; the brakes hold."""
        self._asked_ns = 0
        self._board.ask("power_off", 1.0)  # relays open as in the reference

    def go_on(self) -> None:
        """The previous process has powered on."""
        self._driving_epoch = self._board.epoch

    @property
    def has_io(self) -> bool:
        """Whether io has published a record since this process started."""
        return self._board.record_ns > 0

    @property
    def is_powered(self) -> bool:
        """Whether power is on, or is being switched on."""
        return self._board.power_requested and not self._board.has_fault

    def is_on(self) -> bool:
        """Whether power is on and io accepts our currents; while power comes up, the call requests that from io."""
        board = self._board
        if self._asked_ns and board.powered and board.amps_on and not board.pid_enabled and not board.has_fault:
            board.ask("pid_enable", 1.0)  # from now on io takes the currents of the brakes from our setpoints
        return board.powered and board.amps_on and board.pid_enabled

    def problem(self, now_ns: int, *, powering: bool) -> FaultReport:
        """The present problem."""
        board = self._board
        if not board.io_answers(now_ns):
            return FaultReport(codes.IO_TIMEOUT, "io does not answer")
        if board.epoch != self._driving_epoch:
            return FaultReport(codes.IO_RESTARTED, board.io_stall(board.record_ns) or codes.IO_RESTARTED.cause)
        if board.has_fault and (not powering or now_ns - self._asked_ns > OLD_FAULT_NS):
            return board.fault_report(board.fault)
        if powering:
            is_late = now_ns - self._asked_ns > POWER_NS
            return FaultReport(codes.POWER_TIMEOUT, "failed to enable power") if is_late else NO_FAULT
        if not board.powered or not board.amps_on:
            return board.power_report()
        return NO_FAULT if board.pid_enabled else FaultReport(
            codes.PID_OFF, "the current of the brakes was switched off")

    # -- commands ------------------------------------------------------------------------------------------------------

    def clutch(self, place: int, on: bool, now_ns: int) -> None:
        """Release the brakes of an arm for a minute, or engage them."""
        self.buttons.command(place, now_ns + CLUTCH_COMMAND_NS if on else 0)

    def lift(self, velocity: float, now_ns: int) -> None:
        """Move the lift for a second."""
        self.buttons.command(len(self._arms), now_ns + LIFT_COMMAND_NS if velocity else 0)
        self._lift_asked = velocity

    # -- a cycle -------------------------------------------------------------------------------------------------------

    def step(self, now_ns: int, state: SetupState) -> None:
        """One cycle: read samples, set currents."""
        dt_s, self._before_ns = min(now_ns - (self._before_ns or now_ns), 20_000_000) * 1e-9, now_ns
        if not self._board.look(self._sample):
            self._multiplexer.skip()
        enabled = state is SetupState.ENABLED and self._board.is_fresh(now_ns)
        self._look_at_buttons(enabled, now_ns)
        velocity = self._velocity() if enabled else 0.0
        if enabled:
            self._brakes.step(dt_s, self.buttons.acts[:-1])
        else:
            self._brakes.cut()
        self._move_lift(velocity, now_ns)
        moving = self._clutched | ~self._brakes.engaged | (self._lifts & (velocity != 0.0))
        for place in np.flatnonzero(moving).tolist():
            self._rest[place] = -1
            self._setups.lose(place, moved=True)
        self._follow_rounds(now_ns)
        self._publish(state is SetupState.ENABLED)

    def _sample(self, stamp_ns: int, channel: int, volts: Array) -> None:
        if self._is_away:
            self._is_away = False
            self._round_ns = stamp_ns
            self._rest = [-1] * len(self._rest)
            asked = self._multiplexer.begin(stamp_ns)
        else:
            asked = self._multiplexer.take(stamp_ns, channel, volts)
        if asked == INCREMENT:
            self._board.ask("multiplexer", 1.0)
        elif asked:
            self._board.ask("multiplexer", 0.0)

    def _look_at_buttons(self, enabled: bool, now_ns: int) -> None:
        pressed = np.append(self._board.pressed[self._plugs], self._board.up or self._board.down)
        self.buttons.step(pressed, np.full(len(pressed), enabled), now_ns)
        for place in np.flatnonzero(self.buttons.stuck).tolist():
            button = f"{self._arms[place].name}: its clutch" if place < len(self._arms) else "a button of the lift"
            text = f"{button} is already pressed; it has no effect until it is released"
            self._reports.report(codes.CLUTCH_STUCK, text, self._name)
        self._setups.clutch(self.buttons.held[:-1], self._reports)

    def _velocity(self) -> float:
        buttons = float(self._board.up) - float(self._board.down)
        if not (self._board.up or self._board.down):
            self._is_held_back = False
            return self._lift_asked if self.buttons.acts[-1] else 0.0
        if not self.buttons.acts[-1]:
            return 0.0
        if not self._board.is_authorized and not self._is_held_back:
            self._is_held_back = True
            self._reports.report(codes.IO_REFUSED, f"{self._name}: the lift stays: the process was restarted, and no "
                                 f"operator's command was given since; enable {self._name} first", self._name)
        return buttons if self._board.is_authorized else 0.0

    def _move_lift(self, velocity: float, now_ns: int) -> None:
        """Move the lift as long as the command is repeated."""
        is_due = velocity and now_ns - self._lift_sent_ns >= LIFT_REPEAT_NS
        if self._lifts.any() and (velocity != self._lift_sent or is_due):
            self._lift_sent, self._lift_sent_ns = velocity, now_ns
            self._board.ask("lift", velocity)
        self._lift_shown[...] = velocity

    def _follow_rounds(self, now_ns: int) -> None:
        multiplexer = self._multiplexer
        if multiplexer.rounds != self._rounds:
            self._rounds = multiplexer.rounds
            self._round_ns = now_ns
            for place in range(len(self._arms)):
                self._read(place)
        elif not self._is_away and (now_ns - self._round_ns > MAX_ROUND_NS or not self._board.is_fresh(now_ns)):
            self._lose_all(now_ns)
        if multiplexer.wrong != self._wrong:
            self._wrong = multiplexer.wrong
            if self._wrong is not None:
                text = f"{self._name}: the multiplexer shows channel {self._wrong[0]}, expected was {self._wrong[1]}"
                self._reports.report(codes.MULTIPLEXER_CHANNEL, text, self._name)

    def _lose_all(self, now_ns: int) -> None:
        """Old readings are void."""
        for place in range(len(self._arms)):
            self._setups.lose(place, moved=False)
        self._is_away = True
        if self._board.is_fresh(now_ns):
            text = f"{self._name}: the multiplexer does not advance; positions of the setup arms are unknown"
            self._reports.report(codes.MULTIPLEXER_STUCK, text, self._name)

    def _read(self, place: int) -> None:
        """Use the readings of a whole round."""
        plug = self._plugs[place]
        volts = self._multiplexer.volts
        self._primary[place, :JOINTS], self._secondary[place, :JOINTS] = volts[plug, :6], volts[plug, 6:12]
        self._extra[place] = volts[plug, 12:]
        self._extra[place, 2] = volts[PLUGS - 1, 15] if plug == 0 else volts[PLUGS - 1 - plug, 14]  # as it is wired
        self._rest[place] += 1
        if self._rest[place] < ROUNDS:
            return
        joints = self._arms[place].joints
        self._readings.take(place, volts[plug, :joints], volts[plug, JOINTS : JOINTS + joints])

    def _publish(self, enabled: bool) -> None:
        self._current[...] = self._brakes.current
        self._rounds_shown[...] = self._rounds
        self._mode[...] = enabled
        self._effort.fill(0.0)
        self._effort[self._plugs] = self._brakes.current
        self._pid_generation[...] = self._board.pid_generation
        self._bias_generation[...] = self._board.bias_generation
