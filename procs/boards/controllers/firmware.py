"""All boards of one bus: their registers, real-time samples and commands, on a tick clock.

State is kept in arrays over boards (rows by ascending board id) and axes, so that the cycle treats all boards at once.
Nothing here reads a clock or handles a datagram: every access is passed with its tick, and events due before that tick
(see `power`) must have been processed (`until`).
"""

from __future__ import annotations

import struct
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from trocar.procs.boards.controllers.differences import Differences
from trocar.procs.boards.controllers.encoder import Encoders
from trocar.procs.boards.controllers.espm import ARM, BOARD, CONTROL, NOTHING, Espm
from trocar.procs.boards.controllers.expander import Expanders
from trocar.procs.boards.controllers.interface_board import EmulatedInterfaceBoard
from trocar.procs.boards.controllers.lines import INPUTS_OPEN, Lines
from trocar.procs.boards.controllers.models import Model
from trocar.procs.boards.controllers.motors import SUPPLY_BITS, Motors
from trocar.procs.boards.controllers.power import BoardPower
from trocar.procs.boards.controllers.samples import BoardSamples
from trocar.procs.boards.controllers.testboard import Loopback
from trocar.procs.boards.devices.board import Board
from trocar.procs.document.emulated import EmulatedSetupJoints
from trocar.procs.fpga import registers as reg
from trocar.procs.native import library
from trocar.procs.native.boards_fields import SAMPLE

_MISSING = {  # registers and regions that read 0
    "DQLA": (reg.DATA_BUFFER,),
    "dRA1": (reg.DIGITAL_OUTPUT, reg.DALLAS, reg.IO_EXPANDER, reg.DALLAS_MEMORY, reg.WAVEFORM)}
FIRST, LAST = 1, 2  # halves of a sample
NO_PINS = np.uint32(~(reg.ENCODER_PIN_A | reg.ENCODER_PIN_B | reg.ENCODER_PIN_INDEX) & 0xFFFF_FFFF)


class Firmware:
    """The boards of `models` (ascending id), wired to the world by `lines` (a row a board)."""

    def __init__(self, models: tuple[Model, ...], lines: Lines, *, testboard: bool = False) -> None:
        """Boards as after power-up at tick 0; `testboard`: every QLA hangs on a loop-back board."""
        self.models, self.lines = models, lines
        self.count, self.width = len(models), int(lines.dac.shape[1])
        self.ids, self.boards = tuple(model.board_id for model in models), tuple(Board(model) for model in models)
        self.power = BoardPower(models, lines.on)
        self.motors = Motors(models, lines, self.power)
        self.samples = BoardSamples(models, self.width)
        self.encoders = Encoders(self.count, self.width, tuple(model.quirks for model in models), self.samples.rows,
                                 self.samples.first_encoder)
        self._differences = Differences(models, lines, self.power, self.motors, self.samples)
        self._espms = {row: Espm(row, self.boards[row], lines, self.power, self.motors, self.samples)
                       for row, model in enumerate(models) if model.hardware.name == "dRA1"}
        self._expanders = {row: Expanders(model.hardware.name == "DQLA", model.expander)
                           for row, model in enumerate(models) if model.firmware > 7 and row not in self._espms}
        # A test board for every four outputs: a DQLA has two.
        self._loops = {row: tuple(Loopback(board.digital, first=first, quirks=board.model.quirks)
                                  for first in range(0, board.model.hardware.outputs, reg.AXES))
                       for row, board in enumerate(self.boards) if testboard and board.model.hardware.outputs}
        self._interfaces: dict[int, EmulatedInterfaceBoard] = {}
        self._motor_words = np.zeros(lines.dac.shape, dtype=np.uint32)
        self._no_control, self.outputs = np.zeros((2, self.count), dtype=np.uint32)  # bits among the inputs
        self._lively: frozenset[int] = frozenset()  # rows whose outputs or data collection change by themselves
        self.collecting = False  # some board collects data
        self.pins_shown = np.array([[0xFFFF_FFFF if model.firmware > 7 else NO_PINS] * self.width for model in models],
                                   dtype=np.uint32)
        self.expanded = self.power.traits.expander & self.power.traits.single
        self.supply_bits, self._has_expanded = SUPPLY_BITS, bool(self.expanded.any())
        (self._fill,) = library.chosen(SAMPLE, self)
        for row in range(self.count):
            self._show_quiet(row, 0)

    def fit(self, row: int, joints: EmulatedSetupJoints) -> EmulatedInterfaceBoard | None:
        """Put the interface board of setup joints on a board; None if it has a loop-back board."""
        if row in self._loops:
            return None
        board = self.boards[row]
        self._interfaces[row] = made = EmulatedInterfaceBoard(joints, board.digital, quirks=board.model.quirks)
        return made

    # -- time ----------------------------------------------------------------------------------------------------------

    def step(self, tick: int) -> None:
        """A physics step ends at `tick`: process edges up to there, and automatic events."""
        self.encoders.observe(tick)
        self.power.until(tick)
        for row in self._loops:
            self._loop_back(row, tick)
        for interface in self._interfaces.values():
            interface.until(tick)
        for row in self._lively:
            collection = self.boards[row].collection
            if collection.collecting:
                collection.measure(int(self.lines.adc[row, collection.channel - 1]) & 0xFFFF, tick)

    # -- samples -------------------------------------------------------------------------------------------------------

    def sample(self, tick: int) -> None:
        """Update the real-time block contents of all boards to `tick`; time stamps are left unchanged."""
        self.encoders.observe(tick)
        self.encoders.words(tick)
        if self._loops or self._interfaces or self._lively:
            self._fill(FIRST)
            self._let_others_in(tick)
            self._fill(LAST)
        else:
            self._fill(FIRST | LAST)
        if self._differences.there:
            self._differences.show(self.outputs)

    def fill(self, which: int) -> int:
        """Sampling for all boards at once, in two halves: inputs first, then the rest."""
        samples, power = self.samples, self.power
        if which & FIRST:
            samples.status[...] = power.status
            np.bitwise_or(self.encoders.pins, self.lines.inputs, samples.inputs)
        if which & LAST:
            np.bitwise_and(samples.positions, self.pins_shown, samples.positions)
            np.bitwise_or(samples.inputs, self.outputs, samples.inputs)
            if self._has_expanded:
                samples.inputs |= (self.motors.comparators()[:, 0] & self.expanded) * np.uint32(reg.INPUT_MOTOR_SUPPLY)
            samples.adc[...] = self.lines.adc
            np.bitwise_or(power.motor_flags, self.motors.command, self._motor_words)  # a scattered result costs twice
            samples.motor_status[...] = self._motor_words
        return 0

    def _let_others_in(self, tick: int) -> None:
        """Data that only some boards have, inserted between the halves of a sample."""
        samples = self.samples
        for row in self._loops:
            self._loop_back(row, tick)
        for row, interface in self._interfaces.items():
            samples.inputs[row] = interface.fill(tick, int(samples.inputs[row]), samples.positions[row],
                                                 samples.velocities[row])
        if self._lively:
            self._follow(tick)

    def _loop_back(self, row: int, tick: int) -> None:
        """Signals that return to a board through its loop-back boards."""
        samples, lines = self.samples, self.lines
        for half, loop in enumerate(self._loops[row]):
            axes = slice(half * reg.AXES, (half + 1) * reg.AXES)
            inputs = loop.fill(tick, samples.positions[row, axes], samples.velocities[row, :, axes])
            if half:
                lines.inputs[row] = int(lines.inputs[row]) & 0xFFFF | (inputs & INPUTS_OPEN) << reg.INPUT_FAR_SHIFT
            else:
                samples.inputs[row] = inputs
            lines.adc[row, axes] = loop.adc(lines.dac[row, axes], lines.on[row, axes])

    def _follow(self, tick: int) -> None:
        """Automatic changes on boards with active outputs or data collection."""
        for row in self._lively:
            self._show_quiet(row, tick)
        self._lively = frozenset(row for row in self._lively if self._is_lively(row, tick))

    def _is_lively(self, row: int, tick: int) -> bool:
        board = self.boards[row]
        return board.collection.collecting or board.digital.busy_until > tick

    def _show_quiet(self, row: int, tick: int) -> None:
        board, samples, name = self.boards[row], self.samples, self.models[row].hardware.name
        if name != "dRA1":
            levels, playing = board.digital.levels(tick), board.digital.playing(tick)
            self.outputs[row] = (levels & 0xF) << reg.INPUT_DOUT_SHIFT
            if name == "DQLA":  # temperatures of its second QLA where the others have the state of the collection
                self.outputs[row] |= (levels >> reg.AXES & 0xF) << reg.INPUT_DOUT_FAR_SHIFT
                self._differences.playing[row] = playing
                return
            self.outputs[row] |= playing * reg.INPUT_WAVEFORM_ACTIVE
        low = int(samples.temperatures[row]) & 0xFFFF
        samples.temperatures[row] = board.collection.status(tick) << 16 | low

    def _touched(self, row: int, tick: int) -> None:
        """The quiet side of a board was written to: update the visible state."""
        self._show_quiet(row, tick)
        if self._is_lively(row, tick):
            self._lively |= {row}

    def set_temperatures(self, row: int, word: int) -> None:
        """Set the readings of a board's sensors from now on: amplifier pair 1 << 8 | pair 2, 0.5 °C each."""
        samples, name = self.samples, self.models[row].hardware.name
        if name == "DQLA":  # both QLAs show the same
            samples.temperatures[row] = (word & 0xFFFF) * 0x1_0001
        elif name == "QLA1":
            samples.temperatures[row] = int(samples.temperatures[row]) & 0xFFFF_0000 | word & 0xFFFF

    # -- real-time commands --------------------------------------------------------------------------------------------

    def execute(self, words: npt.NDArray[np.uint32], control: npt.NDArray[np.uint32], rows: Sequence[int],
                tick: int, written: npt.NDArray[np.bool_] | None = None,
                executed: npt.NDArray[np.bool_] | None = None) -> None:
        """Motor command words (boards, width), then control words (boards,) of boards `rows`; 0 for the others.

        If not every axis gets a word, or not every board a control word, `written` and `executed` mark those that do.
        """
        if len(rows) == self.count:
            self.power.refresh_all(tick)
        else:
            for row in rows:
                self.power.refresh(row, tick)
        self.motors.execute(words, control, tick, written, executed)
        if self.motors.collects or self.collecting:
            self._collect(words, rows, written, tick)

    def _collect(self, words: npt.NDArray[np.uint32], rows: Sequence[int], written: npt.NDArray[np.bool_] | None,
                 tick: int) -> None:
        """Command words start, continue and end the collection of data."""
        for row in rows:
            model, collection = self.models[row], self.boards[row].collection
            if model.hardware.name == "DQLA":
                continue
            for axis in range(model.hardware.motors):
                word = int(words[row, axis])
                concerns = word & reg.DAC_COLLECT or (collection.collecting and collection.channel == axis + 1)
                if concerns and (written is None or written[row, axis]):
                    if not collection.collecting:
                        collection.sampled(int(self.samples.sampled[row]))
                    collection.command(axis + 1, word, tick, int(self.lines.adc[row, axis]) & 0xFFFF)
                    self._touched(row, tick)
        self.collecting = any(board.collection.collecting for board in self.boards)

    # -- registers -----------------------------------------------------------------------------------------------------

    def read(self, row: int, address: int, tick: int) -> int:
        """Value of a register of the board in `row`; 0 for a missing register."""
        self.sample(tick)
        return self._look(row, address, tick)

    def _look(self, row: int, address: int, tick: int) -> int:
        """The same, with the sample made."""
        samples, channel, model = self.samples, address >> 4, self.models[row]
        if 0 < channel <= model.hardware.motors:
            return self._look_at_axis(row, channel - 1, address & 0xF)
        if address == reg.WATCHDOG:
            return int(self.power.watchdog_counts[row]) | self.boards[row].show_watchdog
        if address in (reg.STATUS, reg.DIGITAL_INPUT):
            return int((samples.status if address == reg.STATUS else samples.inputs)[row])
        if address == reg.TEMPERATURE:
            whole = model.hardware.name == "DQLA" or (row in self._espms and model.firmware == 8)
            return int(samples.temperatures[row]) & (0xFFFF_FFFF if whole else 0xFFFF)
        if address == reg.IO_EXPANDER and row in self._expanders:
            return self._expanders[row].read(self._ports(row))
        if row in self._espms and address >> 12 in (CONTROL, ARM, BOARD):
            return self._espms[row].read(address, tick)
        missing = _MISSING.get(model.hardware.name, ())
        return 0 if address in missing or address & 0xF000 in missing else self.boards[row].read(address, tick)

    def _ports(self, row: int) -> tuple[int, int]:
        """Ports 7:0 and 9:8 of the I/O expander on the addressed QLA."""
        qla = self._expanders[row].qla
        low = self.motors.expander_outputs(row, reg.AXES * qla)
        return low, int(self.motors.comparators()[row, qla]) << 1 | int(self.power.chain_open[row])

    def _look_at_axis(self, row: int, axis: int, offset: int) -> int:
        model, samples = self.models[row], self.samples
        nothing = NOTHING if row in self._espms else 0
        if offset == reg.DAC:
            return self.motors.read_command(row, axis)
        if offset == reg.MOTOR_CONFIG:
            return nothing or self.motors.read_config(row, axis)
        if offset == reg.PWM:
            return self.boards[row].digital.control(axis) if axis < model.hardware.outputs else nothing
        if offset in (reg.ADC, reg.MOTOR_STATUS):
            if offset == reg.MOTOR_STATUS and model.firmware == 7:
                return 0
            return int((samples.adc if offset == reg.ADC else samples.motor_status)[row, axis])
        words = (reg.PERIOD, reg.QUARTER_1, reg.QUARTER_5, reg.RUNNING)
        if offset not in (reg.ENCODER_PRELOAD, reg.ENCODER, *words):
            return nothing
        if axis >= model.hardware.encoders:
            return 0
        if offset == reg.ENCODER_PRELOAD:
            return int(self.encoders.preload[self.width * row + axis])
        return int(samples.positions[row, axis] if offset == reg.ENCODER
                   else samples.velocities[row, words.index(offset), axis])

    def write(self, row: int, address: int, value: int, tick: int, relayed: bool = True) -> None:
        """Write a register of the board in `row`, restarting its watchdog; `relayed`: it arrived over FireWire."""
        self.power.refresh(row, tick)
        channel = address >> 4
        if 0 < channel <= self.models[row].hardware.motors:
            self._write_axis(row, channel - 1, address & 0xF, value, tick)
        elif address == reg.STATUS:
            self.motors.control(row, value, tick)
        elif address == reg.WATCHDOG:
            self.boards[row].show_watchdog = value & 1 << 31 if self.models[row].firmware > 7 else 0
            self.power.set_watchdog(row, value, tick)
        elif address == reg.IO_EXPANDER and row in self._expanders:
            self._expanders[row].address(value)
            self._expanders[row].write(value, self._ports(row))
        elif row in self._espms and address >> 12 in (CONTROL, ARM, BOARD):
            self._espms[row].write(address, value, tick)
        else:
            self._before_outputs_change(row, tick)
            self.boards[row].write(address, value, tick, relayed)
            self._touched(row, tick)

    def _before_outputs_change(self, row: int, tick: int) -> None:
        for loop in self._loops.get(row, ()):
            loop.until(tick)
        if row in self._interfaces:
            self._interfaces[row].before_write(tick)

    def _write_axis(self, row: int, axis: int, offset: int, value: int, tick: int) -> None:
        model = self.models[row]
        if offset == reg.PWM:
            if axis < model.hardware.outputs:
                self._before_outputs_change(row, tick)
                self.boards[row].digital.configure(axis, value, tick)
                self._touched(row, tick)
        elif offset == reg.ENCODER_PRELOAD:
            if axis < model.hardware.encoders:
                self.encoders.observe(tick)
                self.encoders.load(np.array([self.width * row + axis]), np.array([value & reg.ENCODER_MASK]))
                self.power.preload(row, tick)
                if row in self._loops:
                    self._loops[row][axis // reg.AXES].preload(axis % reg.AXES, value, tick)
                if row in self._interfaces:
                    self._interfaces[row].preload(axis, value, tick)
        elif offset == reg.DAC:
            self._command(row, axis, value, tick)
        elif offset == reg.MOTOR_CONFIG:
            self.motors.configure(row, axis, value, tick)

    def _command(self, row: int, axis: int, value: int, tick: int) -> None:
        """One motor command word by itself; Rev 7 does not look at its valid bit."""
        words = np.zeros((self.count, self.width), dtype=np.uint32)
        words[row, axis] = value | (reg.DAC_VALID if self.models[row].firmware == 7 else 0)
        written = np.zeros(words.shape, dtype=np.bool_)
        written[row, axis] = True
        self.motors.execute(words, self._no_control, tick, written)
        if self.motors.collects or self.collecting:
            self._collect(words, (row,), written, tick)

    # -- blocks --------------------------------------------------------------------------------------------------------

    def read_block(self, row: int, address: int, size: int, tick: int) -> bytes:
        """`size` bytes (a multiple of 4) of the board in `row`; a read at 0 is a real-time sample."""
        if address == reg.REAL_TIME:
            self.sample(tick)
            self.samples.stamp((row,), tick)
            self.sampled((row,), tick)
            return self.samples.block(row)[:size].ljust(size, b"\0")
        of_arm = row in self._espms and address >> 12 in (CONTROL, ARM, BOARD)
        if of_arm or address < reg.HUB:  # registers in a row: one sample for all of them
            self.sample(tick)
            region = address & 0xF000
            quads = [self._look(row, region | address + k & 0xFFF, tick) for k in range(size // 4)]
            return struct.pack(f">{size // 4}I", *quads)
        if address & 0xF000 in _MISSING.get(self.models[row].hardware.name, ()):
            return bytes(size)
        return self.boards[row].read_block(address, size, tick)

    def sampled(self, rows: Sequence[int], tick: int) -> None:
        """Boards `rows` have taken the sample just made: data collection counts from there."""
        for row in self._lively:
            if row in rows:
                self.boards[row].collection.sampled(tick)

    def write_block(self, row: int, address: int, data: bytes, tick: int) -> None:
        """Block write other than the real-time one; restarts the board's watchdog."""
        self.power.refresh(row, tick)
        if row in self._espms and address >> 12 in (CONTROL, ARM, BOARD):
            for k, (value,) in enumerate(struct.iter_unpack(">I", data[: len(data) & ~3])):
                self._espms[row].write(address + k, value, tick)
            return
        self._before_outputs_change(row, tick)
        self.boards[row].write_block(address, data, tick)
        self._touched(row, tick)

    # -- power-up ------------------------------------------------------------------------------------------------------

    def power_up(self, row: int, tick: int) -> None:
        """The FPGA of a board is reconfigured: everything except its memories is as after power-up."""
        self.power.power_up(row, tick)
        self.encoders.observe(tick)
        self.encoders.power_up(row)
        self.motors.power_up(row)
        self.samples.power_up(row, tick)
        if row in self._espms:
            self._espms[row].power_up()
        if row in self._expanders:
            self._expanders[row].power_up()
        self.boards[row].power_up(tick)
        for loop in self._loops.get(row, ()):
            loop.power_up(self.boards[row].digital, tick)
        if row in self._interfaces:
            self._interfaces[row].power_up(self.boards[row].digital, tick)
        self._touched(row, tick)
