"""Motor command words and motor configuration of all boards of a bus.

A command is a current, offset binary; `lines.dac` is the current that an amplifier drives. Only QLAs with an I/O
expander and dRA1s also have voltage commands. The motors of the emulated arms have currents only, so that a voltage
drives the current through the winding of a motor at rest: V / R, with one resistance for all.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from trocar.procs.boards.controllers.lines import Flags, Lines, Quads
from trocar.procs.boards.controllers.models import Model
from trocar.procs.boards.controllers.power import BoardPower
from trocar.procs.fpga import registers as reg

WINDING_OHMS = 5.0  # small servo motors have 2 to 8
QLA_VOLTS, QLA_VOLTS_LEAST = 91.0, -45.5  # full scale of a voltage command
SUPPLY_VOLTS = 24.0  # of the motors on QLAs
COMPARATOR_VOLTS = 2.5 * 21  # full scale of the last DAC of a QLA, where it is held against the motor supply
SUPPLY_BITS = SUPPLY_VOLTS / COMPARATOR_VOLTS * reg.DAC_VALUE_MASK
COMPARED_AXES = (3, 7)  # board of that DAC
DIGITAL_VOLTS = 48.0  # supply of a dRA1
DIGITAL_BITS_PER_A = (4800.0, 16000.0)  # of its first two motors, of the others
DUTY_FULL = 1023  # eleven bits with sign
_LARGE_MOTORS = 2
_DUTY_SHIFT, _DUTY_SIGN, _DUTY_MASK = 13, 0x400, 0x7FF  # in a voltage command of a dRA1
_STATUS_DUTY_SHIFT = 5
TOP_SHIFT, _VALID, _ENABLE, _COLLECT, _MODE = 24, 0x80, 0x10, 0x40, 0x0F  # in the top byte of a command word


class Motors:
    """Arrays (boards, width); enables go to `power`."""

    def __init__(self, models: Sequence[Model], lines: Lines, power: BoardPower) -> None:
        """As after power-up."""
        self._lines, self._power = lines, power
        self._traits = traits = power.traits
        shape = lines.dac.shape
        self.config = np.full(shape, reg.MOTOR_CONFIG_POWER_UP, dtype=np.uint32)
        self.unchecked: Flags = np.broadcast_to(traits.old[:, None], shape).copy()  # Rev 7: until there is a command
        self.collects = False  # the last command words have a collection bit among them
        self.rebooting: set[int] = set()  # rows of boards that a block ordered to reboot; the caller clears it
        self._knows_voltage = bool((traits.expander | traits.digital).any())
        # The last command: the current that is driven, unless the boards have other modes than current.
        self.command = lines.dac.copy() if self._knows_voltage else lines.dac
        self.written: Flags = np.zeros(shape, dtype=np.bool_)  # Rev 7: there has been a command
        self._mode, self._has_modes = np.zeros(shape, dtype=np.uint32), False  # some motor is not in current mode
        self._duty = np.zeros(shape, dtype=np.int64)  # dRA1, voltage mode
        bits = np.where(np.arange(shape[1]) < _LARGE_MOTORS, *DIGITAL_BITS_PER_A)
        self._bits_per_a = np.where(traits.digital[:, None], bits, reg.CURRENT_BITS_PER_A)
        self._any_old = bool(traits.old.any())
        self.last_top = np.zeros(shape, dtype=np.uint32)  # top bytes and written axes of the last command words
        self._last_mask = b""
        self.accept = np.zeros(shape, dtype=np.bool_)
        self._settled, self._forgives = -1, False  # the last command words forgave faults of dRA1s
        power.when_cut = self._forget

    # -- command words -------------------------------------------------------------------------------------------------

    def execute(self, words: Quads, control: Quads, tick: int, written: Flags | None = None,
                executed: Flags | None = None) -> None:
        """Motor command words (boards, width), then control words (boards,); all 0 for boards not addressed.

        `written`: the axes that get a word, default all; `executed`: the boards that get a control word, default those
        with one that is not 0.
        """
        power = self._power
        top, busy = words >> np.uint32(TOP_SHIFT), power.heeds(control)
        mask = b"" if written is None else written.tobytes()
        if (busy or executed is not None or not self._is_settled or mask != self._last_mask
                or top.tobytes() != self.last_top.tobytes()):
            # The same enables in the same state change nothing; a running host sends these every cycle.
            self._heed(top, tick, written)
            if busy or executed is not None:  # counts as a change: the same enables may mean something else with power
                self._control(control, tick, executed)
            self.last_top[...], self._last_mask = top, mask
        np.copyto(self.command, words & reg.DAC_VALUE_MASK, where=self.accept)
        if self._knows_voltage:
            self._drive(words)

    @property
    def only_values_count(self) -> bool:
        """Whether command words for all axes, with the same top bytes as the last, would change currents alone."""
        return self._is_settled and not (self._last_mask or self.collects or self._has_modes)

    @property
    def _is_settled(self) -> bool:
        power = self._power
        forgiven = not self._forgives or power.digital is None or power.digital.forgiven
        return self._settled == power.changes and forgiven

    def _heed(self, top: Quads, tick: int, written: Flags | None) -> None:
        """Everything in command words but the values."""
        power, traits = self._power, self._traits
        taken = (top & traits.considered) == _VALID
        accept = taken if written is None else taken & written
        if self._knows_voltage:
            mode = np.where(accept & ~traits.old[:, None], top & _MODE, self._mode)
            if (mode != self._mode).any():
                self._mode, self._has_modes = mode, bool((mode != reg.MODE_CURRENT).any())
                power.set_modes(mode, tick)
            # A disabled amplifier loses its command at once, even the command of the enabling word.
            accept &= ~traits.digital[:, None] | power.on & (mode == reg.MODE_CURRENT)
        self.accept[...] = accept
        if self._any_old:
            new = accept & traits.old[:, None]
            self.written |= new
            self.unchecked &= ~new
        self.collects = bool((top & _COLLECT).any())
        mask, value = (top & traits.amp_mask) != 0, (top & _ENABLE) != 0
        on = power.on.tobytes()
        power.enable(mask, value, tick, written)
        # Whether a dRA1 takes a command depends on its amplifier, which this very word may have switched; and each
        # enable it is sent forgives its faults.
        again = power.digital is not None and on != power.on.tobytes()
        self._forgives = bool((mask & value & traits.digital[:, None]).any())
        self._settled = -1 if again else power.changes

    def _control(self, control: Quads, tick: int, executed: Flags | None) -> None:
        words = control & self._traits.real_time_bits
        reboots = (words & reg.CONTROL_REBOOT) == reg.CONTROL_REBOOT
        if reboots.any():
            self.rebooting.update(np.flatnonzero(reboots).tolist())
        self._power.control(words, tick, executed)

    def control(self, row: int, value: int, tick: int) -> None:
        """The control register of a board is written."""
        control = np.zeros(len(self._traits.ids), dtype=np.uint32)
        control[row] = value
        executed = np.zeros(len(control), dtype=np.bool_)
        executed[row] = True
        self._power.control(control, tick, executed)

    # -- voltages ------------------------------------------------------------------------------------------------------

    def _drive(self, words: Quads | None) -> None:
        """The currents that result from the commands."""
        if not self._has_modes:
            np.copyto(self._lines.dac, self.command)
            return
        digital, voltage = self._traits.digital[:, None], self._mode == reg.MODE_VOLTAGE
        if words is not None:
            taken = digital & voltage & (words & reg.DAC_VALID != 0)
            duty = (words >> _DUTY_SHIFT & _DUTY_MASK).astype(np.int64)
            np.copyto(self._duty, (duty ^ _DUTY_SIGN) - _DUTY_SIGN, where=taken)
        volts = np.where(digital, self._duty * (DIGITAL_VOLTS / DUTY_FULL),
                         self.command * (QLA_VOLTS / reg.DAC_VALUE_MASK) + QLA_VOLTS_LEAST)
        bits = np.rint(volts / WINDING_OHMS * self._bits_per_a + reg.CURRENT_ZERO)
        bits = np.where(voltage, np.clip(bits, 0, reg.DAC_VALUE_MASK), self.command)
        bits[digital & (self._mode > reg.MODE_VOLTAGE)] = reg.CURRENT_ZERO
        np.copyto(self._lines.dac, bits, casting="unsafe")

    def _forget(self, axes: Flags) -> None:
        """Amplifiers of dRA1s went off."""
        self.command[axes] = reg.CURRENT_ZERO
        self._settled = -1
        self._drive(None)

    def io_requests(self) -> Quads:
        """Bits 15:0 of the motor status of a dRA1 (boards, width): the duty cycle, 1023 full, in eleven bits."""
        amperes = (self._lines.dac.astype(np.float64) - reg.CURRENT_ZERO) / self._bits_per_a
        duty = np.where(self._mode == reg.MODE_VOLTAGE, self._duty,
                        np.rint(amperes * (WINDING_OHMS * DUTY_FULL / DIGITAL_VOLTS)))
        duty = np.clip(duty, -DUTY_FULL, DUTY_FULL).astype(np.int64) * self._power.on
        return ((duty & _DUTY_MASK) << _STATUS_DUTY_SHIFT).astype(np.uint32)

    def comparators(self) -> Flags:
        """Whether the last DAC of a QLA is below its motor supply: (boards, 2), the second one's is that of a DQLA."""
        supply = self._power.good * SUPPLY_BITS
        axes = [min(axis, self.command.shape[1] - 1) for axis in COMPARED_AXES]
        below: Flags = self.command[:, axes] < supply[:, None]
        return below & self._traits.expander[:, None]

    def expander_outputs(self, row: int, first: int) -> int:
        """Outputs 7:0 of the I/O expander on the QLA with axes `first` on: follower disabled, current control."""
        power, outputs = self._power, 0
        for place in range(reg.AXES):
            axis = (row, first + place)
            forced = int(self.config[axis]) & reg.MOTOR_CONFIG_FOLLOWER_ON
            disabled = not power.awake[axis] and not forced
            outputs |= (disabled << reg.AXES | (self._mode[axis] != reg.MODE_VOLTAGE)) << reg.AXES - 1 - place
        return outputs

    # -- registers -----------------------------------------------------------------------------------------------------

    def read_command(self, row: int, axis: int) -> int:
        """Content of the command register of an axis."""
        if self._traits.old[row]:
            return (reg.DAC_READ_REV_7 | int(self.command[row, axis])) if self.written[row, axis] else 0
        return int(self.command[row, axis])

    def read_config(self, row: int, axis: int) -> int:
        """Motor configuration; only QLAs from Rev 8 on have one."""
        if self._traits.old[row] or self._traits.digital[row]:
            return 0
        return int(self.config[row, axis]) | bool(self._power.expander_known[row]) * reg.MOTOR_CONFIG_VOLTAGE

    def configure(self, row: int, axis: int, value: int, tick: int) -> None:
        """Motor configuration: bits 31 and 30 always, delay and current limit where their set bit is 1."""
        if self._traits.old[row] or self._traits.digital[row]:
            return
        old = int(self.config[row, axis])
        delay = value if value & reg.MOTOR_CONFIG_VOLTAGE else old
        limit = value if value & reg.MOTOR_CONFIG_CURRENT else old
        self.config[row, axis] = (value & 0xC000_0000 | reg.MOTOR_CONFIG_CURRENT | delay & 0x00FF_0000
                                  | limit & reg.MOTOR_CONFIG_LIMIT_MASK)
        self.unchecked[row, axis] = bool(value & reg.MOTOR_CONFIG_NO_SAFETY_CHECK)
        if self._traits.expander[row]:
            self._power.set_delay(row, axis, delay >> reg.MOTOR_CONFIG_DELAY_SHIFT & 0xFF, tick)

    # -- currents ------------------------------------------------------------------------------------------------------

    @property
    def checks_always(self) -> bool:
        """Whether currents are to be compared however little they exceed the commanded ones."""
        return self._knows_voltage and bool((self._mode == reg.MODE_VOLTAGE).any() or self._traits.digital.any())

    def check_currents(self, tick: int) -> None:
        """Currents and commands as they are hold from `tick` on: compare them."""
        measured = self._lines.adc.astype(np.int64) & 0xFFFF
        limits = None
        if self._knows_voltage:
            voltage = (self._mode == reg.MODE_VOLTAGE) & self._power.expander_known[:, None]
            if voltage.any():
                limits = np.where(voltage, self.config.astype(np.int64) & reg.MOTOR_CONFIG_LIMIT_MASK, -1)
        self._power.check_currents(tick, self.command.astype(np.int64), measured, self.unchecked, limits)

    def power_up(self, row: int) -> None:
        """The FPGA of a board is reconfigured."""
        self.command[row] = self._lines.dac[row] = reg.CURRENT_ZERO
        self.config[row] = reg.MOTOR_CONFIG_POWER_UP
        self.written[row] = False
        self.unchecked[row] = self._traits.old[row]
        self._mode[row] = reg.MODE_CURRENT
        self._duty[row] = 0
        self._settled = -1
