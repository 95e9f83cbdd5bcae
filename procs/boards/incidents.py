"""What happens to emulated boards and robots from outside: buttons, broken amplifiers, a supply that goes, …"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from procs.boards.bus import Bus
from procs.boards.emulation import Emulation
from procs.boards.plant import Plant


class Incidents:
    """Done at once, between two datagrams; KeyError names what there is."""

    def __init__(self, world: Emulation, plant: Plant) -> None:
        """`plant` is the world's own."""
        self._world, self._plant, self._wiring = world, plant, world.wiring
        self._width = world.lines.dac.shape[1]  # slots of a row
        self._bus_of_row = [(bus, row) for bus in world.buses for row in range(bus.count)]
        self._names = tuple(dict.fromkeys(io for io, _ in world.wiring.rows))  # rows lie bus after bus

    def press(self, name: str, pressed: bool) -> None:
        """Press or release a button."""
        if name not in self._wiring.inputs:
            raise KeyError(f"{name}: no such input; there are {', '.join(self._wiring.inputs) or 'none'}")
        button, inputs = self._wiring.inputs[name], self._world.lines.inputs
        level = 1 << button.bit
        inputs[button.row] = int(inputs[button.row]) & ~level | (level if pressed == button.pressed else 0)

    def push(self, robot: str, efforts: npt.NDArray[np.float64]) -> None:
        """Efforts from outside on a robot's joints, N·m or N, until changed."""
        count = self._actuators(robot)
        if len(efforts) != count or not np.isfinite(efforts).all():
            raise ValueError(f"{robot}: {len(efforts)} efforts; allowed: {count} finite numbers")
        self._plant.push(robot, efforts)

    def fail_amplifier(self, robot: str, axis: int, failed: bool) -> None:
        """Make the amplifier of an actuator fail, or mend it."""
        bus, row, slot = self._place(robot, axis)
        bus.power.fail_amplifier(row, slot, failed, bus.now)

    def lose_supply(self, robot: str, lost: bool) -> None:
        """Take the motor supply of a robot's boards away, or give it back."""
        self._actuators(robot)
        for row in self._wiring.boards_of(robot):
            bus, local = self._bus_of_row[row]
            bus.power.lose_supply(local, lost, bus.now)

    def stop(self, pressed: bool, bus: str = "") -> None:
        """Press or release the emergency stop: it opens the safety chain of a bus, or of all."""
        for number in self.buses(bus):
            stopped = self._world.buses[number]
            for row in range(stopped.count):
                stopped.power.open_chain(row, pressed, stopped.now)

    def buses(self, name: str) -> range:
        """Number of the bus of an io; all of them when it is not named."""
        if not name:
            return range(len(self._names))
        if name not in self._names:
            raise KeyError(f"{name}: no such bus; there are {', '.join(self._names)}")
        number = self._names.index(name)
        return range(number, number + 1)

    def jump_encoder(self, robot: str, axis: int, counts: int) -> None:
        """Make the counter of an actuator wrong by `counts`."""
        bus, row, slot = self._place(robot, axis)
        bus.encoders.jump(self._width * row + slot, counts)

    def _actuators(self, robot: str) -> int:
        """How many a robot has."""
        cut = self._wiring.robots.get(robot)
        if cut is None:
            raise KeyError(f"{robot}: no such robot; there are {', '.join(self._wiring.robots)}")
        return len(self._wiring.slots[cut])

    def _place(self, robot: str, axis: int) -> tuple[Bus, int, int]:
        """Where an actuator hangs: bus, row and axis there."""
        count = self._actuators(robot)
        if not 0 <= axis < count:
            raise KeyError(f"{robot}: axis {axis}; allowed: 0 to {count - 1}")
        row, place = divmod(int(self._wiring.slots[self._wiring.robots[robot]][axis]), self._width)
        return *self._bus_of_row[row], place
