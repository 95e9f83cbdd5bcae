"""Wiring of robots to boards, and the inverse of the host's conversions.

The host converts bits to SI values with the numbers of the site's files; here the same numbers convert SI values to the
bits that the host must receive. Boards are rows: bus after bus, ascending board id within a bus; an actuator's slot is
width · row + axis, where width is the number of axes of the system's largest controller.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from trocar.procs.boards.controllers.lines import Floats
from trocar.procs.boards.controllers.models import HARDWARE, models_of, width_of
from trocar.procs.document.system import Actuator, Brake, EmulationConfig, Linear, SystemConfig
from trocar.procs.fpga import lookup

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
    """x = scale · y + offset, the way back through a Linear; scale 0 where the file has none."""

    scale: Floats
    offset: Floats

    @classmethod
    def of(cls, forward: list[Linear]) -> InverseScale:
        """The way back through each; axes without a conversion stay 0."""
        scale = np.array([1.0 / f.scale if f.scale else 0.0 for f in forward])
        return cls(scale, np.array([-f.offset / f.scale if f.scale else 0.0 for f in forward]))


@dataclass(frozen=True, slots=True)
class BrakeWiring:
    """Brakes of all robots, each on a motor channel; brake k of a robot holds its actuator k."""

    robots: tuple[tuple[str, Ints], ...]  # a robot and which of the brakes are its own
    slots: Ints
    amps: InverseScale
    measured: InverseScale
    lets_go: Floats  # A from which on a brake lets go, either sign
    holds_off: Floats  # A above which it then stays so


def rows_of(emulation: EmulationConfig) -> dict[tuple[str, int], int]:
    """Row of (io, board id)."""
    rows: dict[tuple[str, int], int] = {}
    for bus in emulation.buses:
        for board in sorted(c.board_id for c in bus.controllers):
            rows[bus.io, board] = len(rows)
    return rows


class Wiring:
    """Arrays over all actuators, document order: every io, every robot, every actuator."""

    def __init__(self, system: SystemConfig, emulation: EmulationConfig) -> None:
        """ValueError when a robot or an input names a board that its bus does not have."""
        self.rows = rows_of(emulation)
        self.width = width = max(width_of(models_of(bus.controllers)) for bus in emulation.buses)
        actuators: list[Actuator] = []
        slots: list[int] = []
        self.robots: dict[str, slice] = {}
        for io in system.ios:
            for robot in io.robots:
                self.robots[robot.name] = slice(len(slots), len(slots) + len(robot.actuators))
                actuators += robot.actuators
                slots += [width * self._row(io.name, a.board_id, robot.name) + a.axis_id for a in robot.actuators]
        self.slots: Ints = np.array(slots, dtype=np.intp)
        none, itself = Linear(), Linear(1.0, 0.0)
        has_table = [bool(robot.lookup) for io in system.ios for robot in io.robots for _ in robot.actuators]
        pots = [(none, itself) if digital else (a.potentiometer.bits_to_voltage, a.potentiometer.voltage_to_position)
                if a.potentiometer else (none, none) for a, digital in zip(actuators, has_table, strict=True)]
        tables = [lookup.unpack(robot.lookup, len(robot.actuators))
                  for io in system.ios for robot in io.robots if robot.lookup]
        self.tables = lookup.InverseLookup(np.concatenate(tables) if tables else np.zeros((0, lookup.ENTRIES)))
        self.table_slots: Ints = self.slots[np.array(has_table, dtype=np.bool_)]
        """Slots with digital potentiometers: `tables` converts their positions to readings."""
        self.counts = InverseScale.of([a.encoder.bits_to_position if a.encoder else none for a in actuators])
        self.pot_volts = InverseScale.of([position for _, position in pots])
        self.pot_bits = InverseScale.of([volts for volts, _ in pots])
        self.amps = InverseScale.of([a.current_to_bits for a in actuators])
        self.measured = InverseScale.of([a.bits_to_current for a in actuators])
        self.brakes = self._brakes(system)
        self.inputs = {i.name: BoardInput(self._row(io.name, i.board_id, i.name), i.bit_id, not i.pressed_value)
                       for io in system.ios for i in io.digital_inputs}
        hardware = {self.rows[bus.io, c.board_id]: c.hardware for bus in emulation.buses for c in bus.controllers}
        self._open = [HARDWARE[hardware[row]].inputs for row in range(len(hardware))]
        # rows of the topic's boards (document order)
        self.topic_rows = np.array([self.rows[bus.io, c.board_id] for bus in emulation.buses for c in bus.controllers],
                                   dtype=np.intp)

    def _brakes(self, system: SystemConfig) -> BrakeWiring:
        robots: list[tuple[str, Ints]] = []
        brakes: list[Brake] = []
        slots: list[int] = []
        for io in system.ios:
            for robot in io.robots:
                if robot.brakes:
                    robots.append((robot.name, np.arange(len(brakes), len(brakes) + len(robot.brakes))))
                    brakes += robot.brakes
                    slots += [self.width * self._row(io.name, b.board_id, robot.name) + b.axis_id
                              for b in robot.brakes]
        # Some files have a negative offset, which is correct in the 16 bits of a command.
        commands = [Linear(b.current_to_bits.scale, b.current_to_bits.offset % 65536) for b in brakes]
        return BrakeWiring(tuple(robots), np.array(slots, dtype=np.intp), InverseScale.of(commands),
                           InverseScale.of([b.bits_to_current for b in brakes]),
                           np.array([BRAKE_LETS_GO * min(abs(b.release_current), b.maximum_current) for b in brakes]),
                           np.array([BRAKE_HOLDS_OFF * abs(b.released_current) for b in brakes]))

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
