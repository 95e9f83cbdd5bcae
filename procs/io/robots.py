"""The robots of one bus as flat arrays: every actuator of every robot in the order of the document.

Drives are all motor channels in use: the actuators, then the brakes of every robot. Arrays over drives are (n + b,),
those over actuators (n,), so an actuator has the same index in both. `Robots` holds the constants (positions in the
boards' blocks, scales, limits), `Samples` turns one read of all boards into SI units with a fixed number of array
operations, whatever the number of boards.
"""

from __future__ import annotations

from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from trocar.procs.document.system import Actuator, Brake, Encoder, IoConfig, Linear
from trocar.procs.fpga import blocks, conversion, lookup, registers
from trocar.procs.fpga.blocks import Columns
from trocar.procs.fpga.velocity import FirmwareVelocity, SoftwareVelocity
from trocar.procs.io.bus.port import Port
from trocar.procs.io.record import Flags, Floats, IoRecord
from trocar.procs.io.reports import IoReports
from trocar.procs.node.fault_report import axis_titles

Places: TypeAlias = NDArray[np.intp]

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

SOFTWARE_VELOCITY: Final = 1
ACCELERATION: Final = 2
"""The values that are computed on demand."""
NO_TABLE: Final = -1
NO_ENCODER: Final = Encoder(Linear(), 0.0, 0.0, "FIRMWARE")


class Robots:
    """Constants of all robots of an io; masks show which boards each robot uses."""

    def __init__(self, io: IoConfig) -> None:
        """From the document."""
        self.io = io
        self.names = tuple(robot.name for robot in io.robots)
        self.actuators = tuple(a for robot in io.robots for a in robot.actuators)
        self.brakes = tuple(b for robot in io.robots for b in robot.brakes)
        self.all: tuple[Actuator | Brake, ...] = (*self.actuators, *self.brakes)
        self.axes, self.drives = len(self.actuators), len(self.all)
        self.count, self.brake_count = len(self.names), len(self.brakes)
        self.titles = axis_titles(io)
        """For every robot its axes, then its brakes, for messages."""
        self.kinematic = [robot.hardware == "KINEMATIC" for robot in io.robots]
        """Whether a robot has no boards; see kinematic.py."""
        self.motors_off = [io.calibration_mode and robot.hardware == "dRA1" for robot in io.robots]
        """Whether calibration mode keeps the motors of a robot off, so that only its brakes are powered."""
        self._place_drives()
        self._place_boards()
        self._take_positions()
        self._take_currents()

    def _place_drives(self) -> None:
        """Assign drives to robots."""
        rows = self.io.robots
        self.slices = [place.axes for place in self.io.places]
        of_axis = [r for r, robot in enumerate(rows) for _ in robot.actuators]
        of_brake = [r for r, robot in enumerate(rows) for _ in robot.brakes]
        self.robot_of_drive: Places = np.array([*of_axis, *of_brake], dtype=np.intp)
        self.robot_of_axis = self.robot_of_drive[: self.axes]
        self.of_robot = [np.flatnonzero(self.robot_of_drive == r) for r in range(self.count)]
        """Indices of every robot's drives, its actuators first."""

    def _place_boards(self) -> None:
        """Assign drives to boards."""
        io = self.io
        self.board_ids = tuple(sorted({each.board_id for each in (
            *self.all, *io.digital_inputs, *io.digital_outputs, *io.instrument_readers)}))
        self.board_count = len(self.board_ids)
        self.row_of = {board: row for row, board in enumerate(self.board_ids)}
        """Array rows of boards, by board id."""
        self.board_row: Places = np.array([self.row_of[d.board_id] for d in self.all], dtype=np.intp)
        self.channel: Places = np.array([d.axis_id for d in self.all], dtype=np.intp)
        self.on_board: Flags = np.zeros((self.count, self.board_count), dtype=bool)
        self.on_board[self.robot_of_drive, self.board_row] = True

    def _take_positions(self) -> None:
        """Encoders and potentiometers."""
        rows, actuators = self.io.robots, self.actuators
        encoders = [a.encoder or NO_ENCODER for a in actuators]
        self.has_encoder: Flags = np.array([a.encoder is not None for a in actuators], dtype=bool)
        self.with_encoders: Flags = np.array([any(a.encoder for a in r.actuators) for r in rows], dtype=bool)
        self.has_table: Flags = np.array([bool(r.lookup) for r in rows for _ in r.actuators], dtype=bool)
        self.has_pot: Flags = self.has_table | np.array([a.potentiometer is not None for a in actuators], dtype=bool)
        self.position_scale = np.array([e.bits_to_position.scale for e in encoders])
        self.position_offset = np.array([e.bits_to_position.offset for e in encoders])
        self.lower, self.upper = np.array([e.lower for e in encoders]), np.array([e.upper for e in encoders])
        self.software: Flags = np.array([e.velocity_source == "SOFTWARE" for e in encoders], dtype=bool)

    def _take_currents(self) -> None:
        """Motors and brakes."""
        self.maximum_current = np.array([d.maximum_current for d in self.all])
        self.effort_to_current = np.array([a.effort_to_current for a in self.actuators])
        self.current_to_effort = conversion.inverse(self.effort_to_current)
        self.maximum_effort = np.abs(self.maximum_current[: self.axes] * self.current_to_effort)
        self.dac_scale = np.array([d.current_to_bits.scale for d in self.all])
        self.dac_offset = np.array([d.current_to_bits.offset for d in self.all])

    def preload_register(self, axis: int) -> tuple[int, int]:
        """(board, address) of the preload register of an actuator's encoder."""
        address = registers.axis_register(int(self.channel[axis]), registers.ENCODER_PRELOAD)
        return self.board_ids[int(self.board_row[axis])], address

    def place(self, drive: int) -> tuple[int, int]:
        """(robot, axis within the robot) of a drive; the brakes of a robot come after its actuators."""
        robot = int(self.robot_of_drive[drive])
        return robot, int(np.searchsorted(self.of_robot[robot], drive))

    def unit(self, drive: int) -> str:
        """Unit of a position: rad or m; empty if the file does not specify it."""
        kind = self.actuators[drive].joint_type if drive < self.axes else ""
        return {"REVOLUTE": "rad", "PRISMATIC": "m"}.get(kind, "")

    def sharing(self, robot: int) -> list[int]:
        """Other robots with a drive on one of this robot's boards."""
        shared = (self.on_board & self.on_board[robot]).any(axis=1)
        return [int(r) for r in np.flatnonzero(shared) if r != robot]


class Pots:
    """Potentiometers: volts by a line, readings by a table, and for some robots then coupled sums over all axes."""

    def __init__(self, robots: Robots) -> None:
        """From the document."""
        n, every = robots.axes, list(zip(robots.slices, robots.io.robots, strict=True))
        lines = [a.potentiometer.voltage_to_position if a.potentiometer else Linear(0.0) for a in robots.actuators]
        self.scale, self.offset = np.array([x.scale for x in lines]), np.array([x.offset for x in lines])
        self.table_row = np.full(n, NO_TABLE)  # row in `tables`
        tables = [lookup.unpack(row.lookup, len(row.actuators)) for _, row in every if row.lookup]
        self.tables: Floats = np.concatenate([*tables, np.zeros((0, lookup.ENTRIES))])
        self.table_rows, self.entries = self.tables.shape
        self.table_row[robots.has_table] = np.arange(self.table_rows)
        self._in_tables = np.flatnonzero(robots.has_table)
        self.coupling: Floats = np.zeros((n, n))  # a column per axis
        self._coupled = []
        for axes, row in every:
            if row.joint_to_actuator_position is not None:
                self.coupling[axes, axes] = np.array(row.joint_to_actuator_position).T
                self._coupled.append((axes, self.coupling[axes, axes]))
        self.first, self.count = np.zeros(n, dtype=np.int64), np.zeros(n, dtype=np.int64)  # rows of each column
        for axes, _ in self._coupled:
            self.first[axes], self.count[axes] = axes.start, axes.stop - axes.start

    def decode(self, volts: Floats, readings: NDArray[np.uint32], out: Floats) -> None:
        """Positions (n,) of all potentiometers."""
        np.multiply(volts, self.scale, out)
        np.add(out, self.offset, out)
        if len(self._in_tables):
            places = np.minimum(readings[self._in_tables], self.entries - 1)
            out[self._in_tables] = self.tables[self.table_row[self._in_tables], places]
        for axes, matrix in self._coupled:  # row by row, in the native library's order of summation
            out[axes] = np.add.reduce(matrix * out[axes, np.newaxis], axis=0)


class Samples:
    """The newest good sample, decoded. `values` (ROWS, n) keeps its memory; the named rows are views of it."""

    def __init__(self, robots: Robots, port: Port, record: IoRecord) -> None:
        """Decodes the port's `blocks`; its boards are discovered."""
        n, hardware = robots.axes, np.array(port.hardware)[robots.board_row]
        self._robots, self._record, self._flat = robots, record, port.blocks.reshape(-1)
        self.values: Floats = np.zeros((ROWS, robots.drives))
        self.current, self.amp_on = self.values[CURRENT], self.values[AMP_ON]
        self.volts, self.position = self.values[VOLTAGE, :n], self.values[POSITION, :n]
        self.period_s, self.pot_error = self.values[PERIOD, :n], self.values[POT_ERROR, :n]
        self.pot_position: Floats = np.zeros(n)
        self.velocity: Floats = record.velocity
        self.words = np.zeros((ROWS, robots.drives), dtype=np.uint32)
        self.index, self.shift, self.mask = _where(robots, port.columns, hardware)
        self.bias, self.scale, self.offset = _scales(robots)
        self._counts = self.words[POSITION, :n].view(np.int32)
        self._readings = self.words[VOLTAGE, :n]
        self.pots = Pots(robots)
        columns = port.columns
        kinds = (columns.running, columns.period, columns.quarter_5, columns.quarter_1)
        self.velocity_index = np.array(
            [(robots.board_row * columns.count + kind.start + robots.channel)[:n] for kind in kinds], dtype=np.intp)
        self.any_software = int(np.any(robots.software))
        clocks = np.where(hardware[:n] == "dRA1", registers.ESPM_CLOCK_HZ, registers.CLOCK_HZ)
        self.firmware = FirmwareVelocity(n, clocks.astype(np.float64))
        self.softly = SoftwareVelocity(n)
        self.no_pot = ~robots.has_pot
        self.first_axis = np.array([s.start for s in robots.slices], dtype=np.intp)
        self.wanted = np.zeros(1, dtype=np.int64)
        """The requested ones of SOFTWARE_VELOCITY and ACCELERATION; see `want`."""
        self._blank(SOFTWARE_VELOCITY | ACCELERATION)

    def want(self, wanted: int) -> None:
        """Compute these for the record from now on; others are NaN, except those used for control."""
        before = int(self.wanted[0])
        self.wanted[0] = wanted
        self._blank(before & ~wanted)
        if wanted & ~before & SOFTWARE_VELOCITY and not self.any_software:
            self.softly.forget()  # its last sample is long ago

    def _blank(self, unwanted: int) -> None:
        if unwanted & SOFTWARE_VELOCITY and not self.any_software:
            self._record.software_velocity[...] = np.nan
        if unwanted & ACCELERATION:
            self._record.acceleration[...] = np.nan

    def decode(self) -> None:
        """The port's blocks to SI units, with velocities."""
        words, values = self.words, self.values
        self._flat.take(self.index, out=words, mode="clip")
        np.right_shift(words, self.shift, words)
        np.bitwise_and(words, self.mask, words)
        values[...] = words
        np.add(values, self.bias, values)
        np.multiply(values, self.scale, values)
        np.add(values, self.offset, values)
        self.pots.decode(self.volts, self._readings, self.pot_position)
        np.subtract(self.pot_position, self.position, self.pot_error)
        self._estimate()

    def _estimate(self) -> None:
        self._flat.take(self.velocity_index, out=self.firmware.words, mode="clip")
        np.multiply(self.firmware.update(), self._robots.position_scale, self.velocity)
        if self.any_software:
            self._estimate_softly()
            np.copyto(self.velocity, self._record.software_velocity, where=self._robots.software)

    def _estimate_softly(self) -> None:
        software = self.softly.update(self._counts, self.period_s)
        np.multiply(software, self._robots.position_scale, self._record.software_velocity)

    def encoders_were_set(self) -> None:
        """The counters were preloaded: the next difference is not motion."""
        self.softly.forget()

    def show(self) -> None:
        """Put the measured values into the record; they are not needed before the boards are written."""
        record, values = self._record, self.values
        record.position[...] = self.position
        record.current[...] = self.current
        np.multiply(self.current[: self._robots.axes], self._robots.current_to_effort, record.effort)
        record.temperature[...] = values[TEMPERATURE]
        record.pot_voltage[...] = self.volts
        record.pot_bits[...] = self._readings
        record.pot_position[...] = self.pot_position
        scale = self._robots.position_scale
        np.multiply(self.firmware.predicted, scale, record.firmware_velocity)
        self._show_wanted()
        if len(self.no_pot):
            np.putmask(record.pot_position, self.no_pot, np.nan)
        np.subtract(self._counts, registers.ENCODER_MIDRANGE, record.encoder_bits)
        np.greater(self.amp_on, 0.5, record.amp_on)
        if len(self.first_axis):
            self.period_s.take(self.first_axis, out=record.board_period, mode="clip")

    def _show_wanted(self) -> None:
        wanted, record, scale = int(self.wanted[0]), self._record, self._robots.position_scale
        if wanted & SOFTWARE_VELOCITY and not self.any_software:
            known = bool(self.softly.known[0])
            self._estimate_softly()
            if not known:  # no previous sample to compare with
                record.software_velocity[...] = np.nan
        if wanted & ACCELERATION:
            np.multiply(self.firmware.accelerations(record.acceleration), scale, record.acceleration)


class IoData:
    """What the parts of an io share: constants of its robots, its boards, their newest sample, record and reports."""

    def __init__(self, io: IoConfig, port: Port, record: IoRecord) -> None:
        """For robots on the boards of `port`, which are discovered. ValueError if these are not the robots' boards."""
        self.robots = robots = Robots(io)
        if robots.board_ids != tuple(port.board_ids):
            raise ValueError(f"port has boards {port.board_ids}, the robots are on {robots.board_ids}")
        record.restart()
        self.port, self.record, self.reports = port, record, IoReports()
        self.samples = Samples(robots, port, record)


def _where(robots: Robots, columns: Columns,
           hardware: NDArray[np.str_]) -> tuple[Places, NDArray[np.uint32], NDArray[np.uint32]]:
    """Flat index, shift and mask of every row and drive; a row of zeros where the controller lacks the value."""
    base, channel = robots.board_row * columns.count, robots.channel
    plain, dual, digital = (hardware == name for name in ("QLA1", "DQLA", "dRA1"))
    index = np.zeros((ROWS, robots.drives), dtype=np.intp)
    shift = np.zeros((ROWS, robots.drives), dtype=np.uint32)
    mask = np.zeros((ROWS, robots.drives), dtype=np.uint32)
    index[CURRENT] = index[VOLTAGE] = base + columns.adc.start + channel
    index[TEMPERATURE] = base + blocks.TEMPERATURE
    index[OVERFLOW] = index[POSITION] = base + columns.position.start + channel
    index[SAFETY] = index[AMP_ON] = np.where(plain, base + blocks.STATUS, base + columns.motor_status.start + channel)
    index[PERIOD] = base + blocks.TIMESTAMP
    shift[VOLTAGE] = 16
    # a byte for each pair of amplifiers: 15:8, 7:0, and of a DQLA's second QLA 31:24, 23:16
    shift[TEMPERATURE] = np.array([8, 0, 24, 16])[channel // 2 % 4]
    shift[OVERFLOW] = 24
    shift[SAFETY] = np.where(plain, registers.STATUS_SAFETY_SHIFT + channel, registers.MOTOR_STATUS_SAFETY_SHIFT)
    shift[AMP_ON] = np.where(plain, registers.STATUS_AMP_ON_SHIFT + channel, registers.MOTOR_STATUS_AMP_ON_SHIFT)
    mask[CURRENT] = 0xFFFF
    mask[VOLTAGE] = np.where(digital, registers.DIGITAL_POT_MASK, 0xFFFF)
    mask[TEMPERATURE] = np.where(digital, 0, 0xFF)
    mask[OVERFLOW] = np.where(digital, 0, 1)
    mask[SAFETY] = np.where(plain | dual, 1, 0)
    mask[AMP_ON] = 1
    mask[POSITION] = registers.ENCODER_MASK
    mask[PERIOD] = 0xFFFF_FFFF
    return index, shift, mask


def _scales(robots: Robots) -> tuple[Floats, Floats, Floats]:
    """Bias (applied before), scale and offset (after) of every row and drive."""
    n = robots.axes
    bias, scale, offset = (np.zeros((ROWS, robots.drives)) for _ in range(3))
    scale[OVERFLOW] = scale[SAFETY] = scale[AMP_ON] = 1.0
    scale[TEMPERATURE] = registers.TEMPERATURE_C_PER_BIT
    bias[POSITION] = -float(registers.ENCODER_MIDRANGE)
    scale[POSITION, :n], offset[POSITION, :n] = robots.position_scale, robots.position_offset
    bias[PERIOD], scale[PERIOD] = 1.0, registers.TICK_S
    for place, drive in enumerate(robots.all):
        scale[CURRENT, place] = drive.bits_to_current.scale
        offset[CURRENT, place] = drive.bits_to_current.offset
    for axis, actuator in enumerate(robots.actuators):
        if actuator.potentiometer is not None:
            scale[VOLTAGE, axis] = actuator.potentiometer.bits_to_voltage.scale
            offset[VOLTAGE, axis] = actuator.potentiometer.bits_to_voltage.offset
    return bias, scale, offset
