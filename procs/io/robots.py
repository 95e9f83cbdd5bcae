"""The robots of one bus as flat arrays: every actuator of every robot in the order of the document.

`Robots` holds the constants (where in the boards' blocks, scales, limits), `Samples` turns one read of all boards into
SI units with a fixed number of array operations, whatever the number of boards.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from procs.io.record import Flags, Floats, Record
from procs.lib import blocks, conversion, registers
from procs.lib.document import Actuator, Encoder, Io, Linear
from procs.lib.velocity import FirmwareVelocity, SoftwareVelocity

# rows of Samples.values; the first five are what safety compares with limits
CURRENT: Final = 0
TEMPERATURE: Final = 1
OVERFLOW: Final = 2
SAFETY: Final = 3
POT_ERROR: Final = 4
AMP_ON: Final = 5
VOLTAGE: Final = 6
POSITION: Final = 7
PERIOD: Final = 8
ROWS: Final = 9
CHECKED: Final = 5

NO_ENCODER: Final = Encoder(Linear(), 0.0, 0.0, "FIRMWARE")


class Robots:
    """Constants of all robots of an io; axis arrays are (n,), robot and board masks say who shares what."""

    def __init__(self, io: Io) -> None:
        """From the document."""
        self.io = io
        self.names = tuple(robot.name for robot in io.robots)
        actuators = [a for robot in io.robots for a in robot.actuators]
        self.axes = len(actuators)
        self.board_ids = tuple(sorted({a.board_id for a in actuators} | {i.board_id for i in io.digital_inputs}))
        self.slices: list[slice] = []
        for robot in io.robots:
            first = self.slices[-1].stop if self.slices else 0
            self.slices.append(slice(first, first + len(robot.actuators)))
        self.robot_of_axis = np.array([r for r, s in enumerate(self.slices) for _ in range(s.start, s.stop)], dtype=int)
        row = {board: k for k, board in enumerate(self.board_ids)}
        self.board_row = np.array([row[a.board_id] for a in actuators], dtype=int)
        self.channel = np.array([a.axis_id for a in actuators], dtype=int)
        self.on_board: Flags = np.zeros((len(self.names), len(self.board_ids)), dtype=bool)
        self.on_board[self.robot_of_axis, self.board_row] = True
        encoders = [a.encoder or NO_ENCODER for a in actuators]
        self.has_encoder: Flags = np.array([a.encoder is not None for a in actuators], dtype=bool)
        self.has_pot: Flags = np.array([a.potentiometer is not None for a in actuators], dtype=bool)
        self.position_scale = np.array([e.bits_to_position.scale for e in encoders])
        self.position_offset = np.array([e.bits_to_position.offset for e in encoders])
        self.lower, self.upper = np.array([e.lower for e in encoders]), np.array([e.upper for e in encoders])
        self.software: Flags = np.array([e.velocity_source == "SOFTWARE" for e in encoders], dtype=bool)
        self.maximum_current = np.array([a.maximum_current for a in actuators])
        self.effort_to_current = np.array([a.effort_to_current for a in actuators])
        self.current_to_effort = conversion.inverse(self.effort_to_current)
        self.maximum_effort = np.abs(self.maximum_current * self.current_to_effort)
        self.dac_scale = np.array([a.current_to_bits.scale for a in actuators])
        self.dac_offset = np.array([a.current_to_bits.offset for a in actuators])
        self.actuators: tuple[Actuator, ...] = tuple(actuators)

    def place(self, axis: int) -> tuple[int, int]:
        """(robot, axis within the robot) of a flat axis."""
        robot = int(self.robot_of_axis[axis])
        return robot, axis - self.slices[robot].start

    def sharing(self, robot: int) -> list[int]:
        """Other robots with an actuator on one of this robot's boards."""
        shared = (self.on_board & self.on_board[robot]).any(axis=1)
        return [int(r) for r in np.flatnonzero(shared) if r != robot]


class Samples:
    """The newest good sample, decoded. `values` (ROWS, n) keeps its memory; the named rows are views on it."""

    def __init__(self, robots: Robots, source: NDArray[np.uint32], record: Record) -> None:
        """`source` (n_boards, 32) is where the port leaves the real-time blocks."""
        n = robots.axes
        self._robots, self._record, self._flat = robots, record, source.reshape(-1)
        self.values: Floats = np.zeros((ROWS, n))
        self.current, self.volts = self.values[CURRENT], self.values[VOLTAGE]
        self.position, self.period_s = self.values[POSITION], self.values[PERIOD]
        self.pot_error = self.values[POT_ERROR]
        self.pot_position: Floats = np.zeros(n)
        self.velocity: Floats = record.velocity
        self._words = np.zeros((ROWS, n), dtype=np.uint32)
        self._index, self._shift, self._mask = _where(robots)
        self._bias, self._scale, self._offset = _scales(robots)
        self._pot_scale = np.array([a.potentiometer.voltage_to_position.scale if a.potentiometer else 0.0
                                    for a in robots.actuators])
        self._pot_offset = np.array([a.potentiometer.voltage_to_position.offset if a.potentiometer else 0.0
                                     for a in robots.actuators])
        self._couplings = [(s, np.array(r.joint_to_actuator_position).T.copy(), np.zeros(len(r.actuators)))
                           for s, r in zip(robots.slices, robots.io.robots, strict=True)
                           if r.joint_to_actuator_position is not None]
        columns = (blocks.PERIOD, blocks.QUARTER_5, blocks.QUARTER_1, blocks.RUNNING)
        self._velocity_index = np.array(
            [robots.board_row * blocks.READ_COLUMNS + c.start + robots.channel for c in columns], dtype=np.intp)
        self._any_software = bool(np.any(robots.software))
        self._firmware = FirmwareVelocity(n)
        self._softly = SoftwareVelocity(n)
        self._no_pot = ~robots.has_pot
        self._first_axis = np.array([s.start for s in robots.slices], dtype=np.intp)

    def update(self) -> None:
        """Decode the port's blocks."""
        words, values, robots = self._words, self.values, self._robots
        self._flat.take(self._index, out=words, mode="clip")
        np.right_shift(words, self._shift, words)
        np.bitwise_and(words, self._mask, words)
        values[...] = words
        np.add(values, self._bias, values)
        np.multiply(values, self._scale, values)
        np.add(values, self._offset, values)
        pots = self.pot_position
        np.multiply(self.volts, self._pot_scale, pots)
        np.add(pots, self._pot_offset, pots)
        for axes, matrix, result in self._couplings:
            np.matmul(pots[axes], matrix, out=result)
            pots[axes] = result
        np.subtract(pots, self.position, self.pot_error)
        self._flat.take(self._velocity_index, out=self._firmware.words, mode="clip")
        np.multiply(self._firmware.update(), robots.position_scale, self.velocity)
        if self._any_software:
            self._update_software()

    def _update_software(self) -> None:
        counts = (self._words[POSITION].astype(np.int64) - conversion.ENCODER_MIDRANGE)
        software = self._softly.update(counts, self.period_s) * self._scale[POSITION]
        np.copyto(self.velocity, software, where=self._robots.software)

    def amps_on(self, axes: slice) -> Flags:
        """Which amplifiers say that they are on."""
        found: Flags = self.values[AMP_ON, axes] > 0.5
        return found

    def encoders_were_set(self) -> None:
        """The counters were preloaded: the next difference is no motion."""
        self._softly = SoftwareVelocity(self._robots.axes)

    def publish(self) -> None:
        """Put the measured values into the record; nobody needs them before the boards are written."""
        record, values = self._record, self.values
        record.position[...] = self.position
        record.current[...] = self.current
        np.multiply(self.current, self._robots.current_to_effort, record.effort)
        record.temperature[...] = values[TEMPERATURE]
        record.pot_voltage[...] = self.volts
        record.pot_position[...] = self.pot_position
        if len(self._no_pot):
            np.putmask(record.pot_position, self._no_pot, np.nan)
        np.subtract(self._words[POSITION].view(np.int32), conversion.ENCODER_MIDRANGE, record.encoder_bits)
        np.greater(values[AMP_ON], 0.5, record.amp_on)
        if len(self._first_axis):
            self.period_s.take(self._first_axis, out=record.board_period, mode="clip")


def _where(robots: Robots) -> tuple[NDArray[np.intp], NDArray[np.uint32], NDArray[np.uint32]]:
    """Flat index, shift and mask of every row and axis."""
    base, channel = robots.board_row * blocks.READ_COLUMNS, robots.channel
    index = np.zeros((ROWS, robots.axes), dtype=np.intp)
    shift = np.zeros((ROWS, robots.axes), dtype=np.uint32)
    mask = np.zeros((ROWS, robots.axes), dtype=np.uint32)
    index[CURRENT] = index[VOLTAGE] = base + blocks.ADC.start + channel
    index[TEMPERATURE] = base + blocks.TEMPERATURE
    index[OVERFLOW] = index[POSITION] = base + blocks.POSITION.start + channel
    index[SAFETY] = index[AMP_ON] = base + blocks.STATUS
    index[PERIOD] = base + blocks.TIMESTAMP
    shift[VOLTAGE] = 16
    shift[TEMPERATURE] = np.where(channel < 2, 8, 0)  # the first pair of amplifiers is in the upper byte
    shift[OVERFLOW] = 24
    shift[SAFETY] = registers.STATUS_SAFETY_SHIFT + channel
    shift[AMP_ON] = registers.STATUS_AMP_ON_SHIFT + channel
    mask[CURRENT] = mask[VOLTAGE] = 0xFFFF
    mask[TEMPERATURE] = 0xFF
    mask[OVERFLOW] = mask[SAFETY] = mask[AMP_ON] = 1
    mask[POSITION] = registers.ENCODER_MASK
    mask[PERIOD] = 0xFFFF_FFFF
    return index, shift, mask


def _scales(robots: Robots) -> tuple[Floats, Floats, Floats]:
    """Bias (before), scale and offset (after) of every row and axis."""
    bias, scale, offset = (np.zeros((ROWS, robots.axes)) for _ in range(3))
    scale[OVERFLOW] = scale[SAFETY] = scale[AMP_ON] = 1.0
    scale[TEMPERATURE] = registers.TEMPERATURE_C_PER_BIT
    bias[POSITION] = -float(conversion.ENCODER_MIDRANGE)
    scale[POSITION], offset[POSITION] = robots.position_scale, robots.position_offset
    bias[PERIOD], scale[PERIOD] = 1.0, registers.TICK_S
    for axis, actuator in enumerate(robots.actuators):
        scale[CURRENT, axis] = actuator.bits_to_current.scale
        offset[CURRENT, axis] = actuator.bits_to_current.offset
        if actuator.potentiometer is not None:
            scale[VOLTAGE, axis] = actuator.potentiometer.bits_to_voltage.scale
            offset[VOLTAGE, axis] = actuator.potentiometer.bits_to_voltage.offset
    return bias, scale, offset
