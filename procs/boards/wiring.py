"""Wiring of robots to boards, and the inverse of the host's conversions.

The host converts bits to SI values with the numbers of the site's files; here the same numbers convert SI values to the
bits that the host must receive. Boards are rows: bus after bus, ascending board id within a bus; an actuator's slot is
width · row + axis, where width is the number of axes of the system's largest controller.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from trocar.procs.boards.controllers.lines import Floats
from trocar.procs.boards.controllers.models import HARDWARE, models_of, width_of
from trocar.procs.document.emulated import ModelVariation
from trocar.procs.document.system import Actuator, Brake, EmulationConfig, Linear, Potentiometer, Robot, SystemConfig
from trocar.procs.fpga import lookup
from trocar.procs.fpga import registers as reg
from trocar.procs.fpga.conversion import are_nominal

HIDDEN_READINGS, HIDDEN_AT = 3500, 611  # of 4096 readings, in another place for each axis
UNCALIBRATED = Linear(-1.0, 3.0)  # rad/V, rad: 3 V closed, 2 V open
COMMAND_ERROR_A, MEASURED_ERROR_A = 0.004, 0.01  # at most, of amplifiers that are not calibrated
BRAKE_LETS_GO, BRAKE_HOLDS_OFF = 0.8, 0.5  # of the release current, and of the current after that: plausible
Ints = npt.NDArray[np.intp]


@dataclass(frozen=True, slots=True)
class BoardInput:
    """A digital input: its board's row, its bit, and the level it has when pressed."""

    row: int
    bit: int
    pressed: bool


@dataclass(frozen=True, slots=True)
class InverseScale:
    """x = scale · y + offset for every slot, the way back through a Linear; scale 0 where the file has none."""

    scale: Floats
    offset: Floats

    @classmethod
    def of(cls, slots: int, lines: Iterable[tuple[int, Linear]], elsewhere: float = 0.0) -> InverseScale:
        """The way back through the lines of some slots; the others have this offset."""
        inverse = cls(np.zeros(slots), np.full(slots, float(elsewhere)))
        for slot, line in lines:
            inverse.scale[slot] = 1.0 / line.scale if line.scale else 0.0
            inverse.offset[slot] = -line.offset / line.scale if line.scale else 0.0
        return inverse


@dataclass(frozen=True, slots=True)
class BrakeWiring:
    """Brakes of all robots, each on a motor channel; brake k of a robot holds its actuator k."""

    robots: tuple[tuple[str, Ints], ...]  # a robot and which of the brakes are its own
    slots: Ints
    lets_go: Floats  # A from which on a brake lets go, either sign
    holds_off: Floats  # A above which it then stays so


def _brakes(robots: list[Robot], braked: list[tuple[int, Brake]]) -> BrakeWiring:
    brakes, at, own = [brake for _, brake in braked], 0, []
    for robot in robots:
        if robot.brakes:
            own.append((robot.name, np.arange(at, at + len(robot.brakes))))
            at += len(robot.brakes)
    return BrakeWiring(tuple(own), np.array([slot for slot, _ in braked], dtype=np.intp),
                       np.array([BRAKE_LETS_GO * min(abs(b.release_current), b.maximum_current) for b in brakes]),
                       np.array([BRAKE_HOLDS_OFF * abs(b.released_current) for b in brakes]))


def _line_of(pot: Potentiometer) -> Linear:
    """A potentiometer's line; of one that is not calibrated, that of a plausible gripper."""
    line = pot.voltage_to_position
    return line if line.scale or line.offset else UNCALIBRATED


def hidden_table(robot: Robot) -> Floats:
    """The potentiometers (n, 4096) of a robot whose table is not made yet: even, from one soft limit to the other."""
    table = np.full((len(robot.actuators), lookup.ENTRIES), np.nan)
    for axis, actuator in enumerate(robot.actuators):
        if actuator.encoder is not None:
            readings = (HIDDEN_AT * (axis + 1) + np.arange(HIDDEN_READINGS)) % lookup.ENTRIES
            table[axis, readings] = np.linspace(actuator.encoder.lower, actuator.encoder.upper, HIDDEN_READINGS)
    return table


def rows_of(emulation: EmulationConfig) -> dict[tuple[str, int], int]:
    """Row of (io, board id)."""
    rows: dict[tuple[str, int], int] = {}
    for bus in emulation.buses:
        for board in sorted(c.board_id for c in bus.controllers):
            rows[bus.io, board] = len(rows)
    return rows


def slices_of(robots: Iterable[Robot]) -> dict[str, slice]:
    """Positions of each robot's actuators in arrays over those of all robots; ValueError for two robots of a name."""
    slices: dict[str, slice] = {}
    at = 0
    for robot in robots:
        if robot.name in slices:
            raise ValueError(f"{robot.name}: two robots of this name")
        slices[robot.name] = slice(at, at + len(robot.actuators))
        at += len(robot.actuators)
    return slices


class Wiring:
    """Slots of all actuators, document order: every io, every robot, every actuator; and conversions for all slots."""

    def __init__(self, system: SystemConfig, emulation: EmulationConfig) -> None:
        """ValueError when a robot or an input names a board that its bus does not have."""
        self.rows = rows_of(emulation)
        self.width = max(width_of(models_of(bus.controllers)) for bus in emulation.buses)
        robots = [(io.name, robot) for io in system.ios for robot in io.robots]
        self.robots = slices_of(robot for _, robot in robots)
        wired = [(self._slot(io, a, robot), a) for io, robot in robots for a in robot.actuators]
        braked = [(self._slot(io, b, robot), b) for io, robot in robots for b in robot.brakes]
        self.slots: Ints = np.array([slot for slot, _ in wired], dtype=np.intp)
        self.brakes = _brakes([robot for _, robot in robots], braked)
        self._convert(wired, braked)
        self._convert_pots(wired, [robot for _, robot in robots])
        given = {one.robot: one for one in emulation.model_variations}
        for _, robot in robots:
            self._vary_currents(robot, given.get(robot.name, ModelVariation(robot.name)), emulation.seed)
        self._name_inputs(system)
        boards = [(self.rows[bus.io, c.board_id], c.hardware) for bus in emulation.buses for c in bus.controllers]
        self._open = [HARDWARE[hardware].inputs for _, hardware in sorted(boards)]
        # rows of the topic's boards (document order)
        self.topic_rows = np.array([row for row, _ in boards], dtype=np.intp)

    def _name_inputs(self, system: SystemConfig) -> None:
        """Digital inputs."""
        self.inputs = {i.name: BoardInput(self._row(io.name, i.board_id, i.name), i.bit_id, not i.pressed_value)
                       for io in system.ios for i in io.digital_inputs}

    def _convert(self, wired: list[tuple[int, Actuator]], braked: list[tuple[int, Brake]]) -> None:
        """Encoders and amplifiers."""
        count, drives = self.width * len(self.rows), dict[int, Actuator | Brake]([*wired, *braked])
        # Some files have a negative offset for brakes, which is correct in the 16 bits of a command.
        commands = [(slot, Linear(b.current_to_bits.scale, b.current_to_bits.offset % 65536)) for slot, b in braked]
        self.counts = InverseScale.of(count, ((slot, a.encoder.bits_to_position) for slot, a in wired if a.encoder))
        self.amps = InverseScale.of(count, [*((slot, a.current_to_bits) for slot, a in wired), *commands])
        self.measured = InverseScale.of(count, ((slot, drive.bits_to_current) for slot, drive in drives.items()),
                                        reg.CURRENT_ZERO)

    def _convert_pots(self, wired: list[tuple[int, Actuator]], robots: list[Robot]) -> None:
        """Potentiometers, analog and digital ones."""
        count, digital = self.width * len(self.rows), [robot for robot in robots if robot.potentiometers == "DIGITAL"]
        tables = [lookup.unpack(robot.lookup, len(robot.actuators)) if robot.lookup else hidden_table(robot)
                  for robot in digital]
        self.tables = lookup.InverseLookup(np.concatenate([np.zeros((0, lookup.ENTRIES)), *tables]))
        self.table_slots: Ints = np.concatenate(
            [np.zeros(0, dtype=np.intp), *(self.slots[self.robots[robot.name]] for robot in digital)])
        """Slots with digital potentiometers: `tables` converts their positions to readings."""
        tabled = self.table_slots.tolist()
        pots = [(slot, a.potentiometer) for slot, a in wired if a.potentiometer and slot not in tabled]
        self.pot_volts = InverseScale.of(count, [*((slot, _line_of(pot)) for slot, pot in pots),
                                                 *((slot, Linear(1.0, 0.0)) for slot in tabled)])
        self.pot_bits = InverseScale.of(count, ((slot, pot.bits_to_voltage) for slot, pot in pots))

    def _vary_currents(self, robot: Robot, one: ModelVariation, seed: int) -> None:
        """Errors of a robot's amplifiers: currents at zero command, and those measured without current.

        Amplifiers whose file has nominal offsets have small errors, as real ones do, for a rehearsal of calibration.
        """
        nominal = are_nominal([actuator.current_to_bits.offset for actuator in robot.actuators])
        if nominal and robot.hardware != "dRA1" and not (one.command_current or one.measured_current):
            shape = 2, len(robot.actuators) + len(robot.brakes)
            command, measured = np.random.default_rng(seed).uniform(-1.0, 1.0, shape)
            one = replace(one, command_current=tuple(COMMAND_ERROR_A * command),
                          measured_current=tuple(MEASURED_ERROR_A * measured))
        brakes = dict(self.brakes.robots).get(robot.name, np.zeros(0, dtype=np.intp))
        for thresholds, values in ((self.brakes.lets_go, one.brake_release), (self.brakes.holds_off, one.brake_hold)):
            if values:
                thresholds[brakes] = values
        slots = np.concatenate((self.slots[self.robots[robot.name]], self.brakes.slots[brakes]))
        if one.command_current:
            self.amps.offset[slots] += np.array(one.command_current)
        if one.measured_current:
            self.measured.offset[slots] += np.array(one.measured_current) * self.measured.scale[slots]

    def _slot(self, io: str, drive: Actuator | Brake, robot: Robot) -> int:
        return self.width * self._row(io, drive.board_id, robot.name) + drive.axis_id

    def _row(self, io: str, board: int, who: str) -> int:
        row = self.rows.get((io, board))
        if row is None:
            known = ", ".join(str(b) for name, b in self.rows if name == io)
            raise ValueError(f"{who}: board {board} is not on the emulated bus of {io}; it has {known or 'none'}")
        return row

    def released(self) -> npt.NDArray[np.uint32]:
        """Digital inputs (rows,) with nothing pressed: named inputs have their released level, the rest are open."""
        levels = self._open.copy()
        for button in self.inputs.values():
            bit = 1 << button.bit
            levels[button.row] = levels[button.row] & ~bit | (0 if button.pressed else bit)
        return np.array(levels, dtype=np.uint32)

    def count_of(self, robot: str) -> int:
        """Number of a robot's actuators."""
        cut = self.robots[robot]
        return int(cut.stop - cut.start)

    def boards_of(self, robot: str) -> list[int]:
        """Rows of the boards a robot hangs on."""
        return sorted({int(slot) // self.width for slot in self.slots[self.robots[robot]]})
