"""External influences on emulated boards and robots: buttons, broken amplifiers, loss of supply, …"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from trocar.procs.boards.controllers.bus import EmulatedBus
from trocar.procs.boards.emulation import Emulation, SensorErrors
from trocar.procs.boards.robots.plant import Plant

MAX_EFFORT = 100.0  # N·m or N on a joint: above a person's push, and still stable for the physics
MAX_FACTOR = 10.0
MAX_POSITION = 10.0  # rad or m
HOTTEST = 127.5  # °C; temperatures are eight bits of 0.5 °C


class BoardFaults:
    """Done at once, between two datagrams; KeyError and ValueError name the existing items and the allowed values."""

    def __init__(self, world: Emulation, plant: Plant) -> None:
        """`plant` is the world's own."""
        self._world, self._plant, self._wiring = world, plant, world.wiring
        self._bus_of_row = [(bus, row) for bus in world.buses for row in range(bus.count)]
        self._names = tuple(dict.fromkeys(io for io, _ in world.wiring.rows))  # rows are ordered bus by bus
        self._gone: set[int] = set()  # rows of boards that were taken away

    # -- hands on buttons and robots -----------------------------------------------------------------------------------

    def press(self, name: str, pressed: bool) -> None:
        """Press or release a button, a switch or a sensor."""
        if name not in self._wiring.inputs:
            raise KeyError(f"{name}: no such input; there are {', '.join(self._wiring.inputs) or 'none'}")
        button, inputs = self._wiring.inputs[name], self._world.lines.inputs
        level = 1 << button.bit
        inputs[button.row] = int(inputs[button.row]) & ~level | (level if pressed == button.pressed else 0)

    def stop(self, pressed: bool, bus: str = "") -> None:
        """Press or release the emergency stop: it opens the safety chain of a bus, or of all."""
        for number in self.buses(bus):
            stopped = self._world.buses[number]
            for row in range(stopped.count):
                stopped.power.open_chain(row, pressed, stopped.now)

    def push(self, robot: str, efforts: npt.NDArray[np.float64]) -> None:
        """Efforts from outside on a robot's joints, N·m or N, until changed."""
        self._check(robot, efforts, "efforts", MAX_EFFORT)
        self._plant.push(robot, efforts)

    def support(self, robot: str, supported: bool) -> None:
        """Carry the weight of a robot by hand, or release it."""
        self._actuators(robot)
        self._plant.support(robot, supported)

    def place(self, robot: str, positions: npt.NDArray[np.float64], *, by_hand: bool = False) -> None:
        """Set the position of a robot's actuators, rad or m, at rest; `SUJ/PSM1`: a setup arm with released brakes.

        `by_hand`: engaged brakes hold theirs.
        """
        joints, _, arm = robot.rpartition("/")  # IO1/SUJ/PSM1, where several buses have a SUJ
        if joints and joints in self._world.setup_joints:
            self._world.setup_joints[joints].place(arm, positions.tolist())
            return
        self._check(robot, positions, "positions", MAX_POSITION)
        self._plant.place(robot, positions, by_hand)

    # -- faults of robots ----------------------------------------------------------------------------------------------

    def fail_amplifier(self, robot: str, axis: int, failed: bool) -> None:
        """Make the amplifier of an actuator fail, or repair it."""
        bus, row, place = self._place(robot, axis)
        bus.power.fail_amplifier(row, place, failed, bus.now)

    def lose_supply(self, robot: str, lost: bool) -> None:
        """Remove the motor supply of a robot's boards, or restore it."""
        self._actuators(robot)
        for row in self._wiring.boards_of(robot):
            bus, local = self._bus_of_row[row]
            bus.power.lose_supply(local, lost, bus.now)

    def jump_encoder(self, robot: str, axis: int, counts: int) -> None:
        """Make the counter of an actuator wrong by `counts`."""
        self._look_for(self._wiring.counts.scale, robot, axis, "encoder")
        bus, row, place = self._place(robot, axis)
        bus.encoders.jump(self._wiring.width * row + place, counts)

    def shift_current(self, robot: str, axis: int, amperes: float) -> None:
        """Add this error to the measured current of an actuator; 0 restores it."""
        self._look_for(self._wiring.measured.scale, robot, axis, "motor current")
        self._errors().current[self._slot(robot, axis)] = amperes

    def drift(self, robot: str, axis: int, volts_per_s: float, volts: float | None = None) -> None:
        """Let a potentiometer drift from now on, from its present value or an error of `volts`; 0, 0 restores it."""
        self._look_for(self._wiring.pot_volts.scale, robot, axis, "potentiometer")
        errors, slot = self._errors(), self._slot(robot, axis)
        errors.pot_drift[slot] = volts_per_s * self._plant.period_s
        if volts is not None:
            errors.pot[slot] = volts

    def kill_pot(self, robot: str, axis: int, dead: bool) -> None:
        """A potentiometer shows 0 V, as with a loose cable, or is mended."""
        self._look_for(self._wiring.pot_volts.scale, robot, axis, "potentiometer")
        self._errors().pot_alive[self._slot(robot, axis)] = float(not dead)

    def scale_encoder(self, robot: str, axis: int, factor: float) -> None:
        """An encoder counts `factor` times the value in its file; below 0 backwards, 1 restores it."""
        self._look_for(self._wiring.counts.scale, robot, axis, "encoder")
        if not 0.01 <= abs(factor) <= MAX_FACTOR:
            raise ValueError(f"factor {factor:g}; allowed: 0.01 to {MAX_FACTOR:g}, or below 0 the same")
        self._world.scale_encoder(self._axis(robot, axis), factor)

    def swap_motors(self, robot: str, one: int, other: int) -> None:
        """Exchange the plugs of two motors of a robot."""
        self._world.swap_motors(self._axis(robot, one), self._axis(robot, other))

    def jam(self, robot: str, axis: int, jammed: bool) -> None:
        """Block an axis, or the brake on it, or release both."""
        self._axis(robot, axis)
        self._plant.jam(robot, axis, jammed)

    # -- faults of boards and buses ------------------------------------------------------------------------------------

    def take_away(self, board: int, gone: bool, bus: str = "") -> None:
        """A board loses power and cables, or returns as after power-up; no effect if it is already in that state."""
        row = self._row(board, bus)
        if gone == (row in self._gone):
            return
        self._gone ^= {row}
        on, local = self._bus_of_row[row]
        on.take_away(local, gone)

    def reset_bus(self, bus: str = "") -> None:
        """A FireWire bus reset: another generation."""
        for number in self.buses(bus):
            self._world.buses[number].reset()

    def withhold(self, board: int, times: int, bus: str = "") -> None:
        """A board does not report to the next broadcast queries."""
        on, local = self.board(self._row(board, bus))
        on.hub_memory.withheld[local] = times

    def spoil_sequence(self, board: int, times: int, bus: str = "") -> None:
        """A board reports to the next broadcast queries with a wrong sequence number."""
        on, local = self.board(self._row(board, bus))
        on.hub_memory.spoiled[local] = times

    def heat(self, board: int, first: float, second: float, bus: str = "") -> None:
        """Temperatures that a board measures at its first and second pair of amplifiers, °C."""
        for celsius in (first, second):
            if not 0.0 <= celsius <= HOTTEST:
                raise ValueError(f"{celsius:g} °C; allowed: 0 to {HOTTEST}")
        on, local = self.board(self._row(board, bus))
        if on.power.traits.digital[local]:
            raise ValueError(f"board {board}: a dRA1 has no temperature sensors")
        on.firmware.set_temperatures(local, round(2 * first) << 8 | round(2 * second))

    def buses(self, name: str) -> range:
        """Number of the bus of an io; default: all of them."""
        if not name:
            return range(len(self._names))
        if name not in self._names:
            raise KeyError(f"{name}: no such bus; there are {', '.join(self._names)}")
        number = self._names.index(name)
        return range(number, number + 1)

    def board(self, row: int) -> tuple[EmulatedBus, int]:
        """The bus of a row, and its row there."""
        return self._bus_of_row[row]

    # -- addressees ----------------------------------------------------------------------------------------------------

    def _actuators(self, robot: str) -> int:
        """How many a robot has."""
        cut = self._wiring.robots.get(robot)
        if cut is None:
            raise KeyError(f"{robot or 'no name'}: no such robot; there are {', '.join(self._wiring.robots)}")
        return len(self._wiring.slots[cut])

    def _check(self, robot: str, values: npt.NDArray[np.float64], what: str, most: float) -> None:
        count = self._actuators(robot)
        if len(values) != count or not (np.abs(values) <= most).all():
            raise ValueError(f"{robot}: {len(values)} {what}; allowed: {count} from {-most:g} to {most:g}")

    def _axis(self, robot: str, axis: int) -> int:
        """Place of an actuator among all of them."""
        count = self._actuators(robot)
        if not 0 <= axis < count:
            raise KeyError(f"{robot}: axis {axis}; allowed: 0 to {count - 1}")
        return int(self._wiring.robots[robot].start) + axis

    def _look_for(self, scale: npt.NDArray[np.float64], robot: str, axis: int, what: str) -> None:
        if scale[self._slot(robot, axis)] == 0.0:
            raise ValueError(f"{robot}: axis {axis} has no {what}")

    def _slot(self, robot: str, axis: int) -> int:
        return int(self._wiring.slots[self._axis(robot, axis)])

    def _place(self, robot: str, axis: int) -> tuple[EmulatedBus, int, int]:
        """Where an actuator hangs: bus, row and axis there."""
        row, place = divmod(self._slot(robot, axis), self._wiring.width)
        return *self._bus_of_row[row], place

    def _row(self, board: int, bus: str) -> int:
        """Row of a board by its id; the bus may be left out where there is one only."""
        if not bus and len(self._names) > 1:
            raise KeyError(f"board {board}: specify its bus; there are {', '.join(self._names)}")
        name = self._names[self.buses(bus)[0]]
        row = self._wiring.rows.get((name, board))
        if row is None:
            known = ", ".join(str(b) for io, b in self._wiring.rows if io == name)
            raise KeyError(f"board {board}: not on the bus of {name}; there are {known}")
        return row

    def _errors(self) -> SensorErrors:
        if self._world.sensor_errors is None:
            self._world.sensor_errors = SensorErrors.none(self._world.lines.adc.size)
        return self._world.sensor_errors
