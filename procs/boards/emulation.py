"""All emulated buses of a system and the robots on them, on one clock that only moves when told.

Physics runs one step ahead: at the beginning of a step the currents that flow then are applied for its whole length,
so that positions within the step are known in closed form and encoders can be asked for any tick in it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np
import numpy.typing as npt

from procs.boards.firmware import Firmware
from procs.boards.lines import Lines
from procs.boards.wiring import Wiring, bits
from procs.lib import registers as reg
from procs.lib import wire
from procs.lib.document import System

Floats = npt.NDArray[np.float64]
MOST_STEPS = 100  # physics steps made up for after a pause; what is beyond is left out


class World(Protocol):
    """What moves the robots; arrays over all actuators, SI, changed in place by each step."""

    position: Floats
    velocity: Floats
    pot_position: Floats

    def step_current(self, current: Floats) -> None:
        """One period under motor currents, A."""


def ticks_of(ns: int) -> int:
    """Whole ticks of 49.152 MHz in a time."""
    return ns * 768 // 15625


def ns_of(tick: int) -> int:
    """The time of a tick, rounded up: `ticks_of` gives the tick back."""
    return -(-tick * 15625 // 768)


def _nothing() -> None:
    pass


class Emulation:
    """The controllers of every bus of `system` and their robots."""

    def __init__(self, system: System, world: World, now_ns: int) -> None:
        """Boards powered up at `now_ns`; the first step begins at once."""
        if system.emulation is None:
            raise ValueError(f"{system.name}: no emulated boards in this system")
        self.wiring = wiring = Wiring(system, system.emulation)
        self.lines = Lines.of(len(wiring.rows))
        self.lines.inputs[:] = wiring.released()
        self.buses: list[Firmware] = []
        self._firsts: list[int] = []  # first row of each bus
        for bus in system.emulation.buses:
            self._firsts.append(sum(fw.count for fw in self.buses))
            self.buses.append(Firmware(bus.controllers, self.lines.part(self._firsts[-1], len(bus.controllers))))
        self.epoch_ns = now_ns
        self.skipped_steps = 0
        self.lose = 0  # replies to leave out
        self._world = world
        self.on_step: Callable[[], None] = _nothing  # called when a step has begun
        self._span = round(system.emulation.period_s * reg.CLOCK_HZ)
        self._noise_v = system.emulation.pot_noise_v
        self._random = np.random.default_rng(system.emulation.seed)
        self.begin = self._next = 0  # the step under way, in ticks
        axes = len(wiring.slots)
        self.position, self.velocity = world.position.copy(), world.velocity.copy()  # when the step began
        self.current = np.zeros(axes)
        self._work = np.zeros(axes)
        self._speed_scale = wiring.counts.scale / reg.CLOCK_HZ
        self._x = wiring.counts.apply(world.position, np.zeros(axes))
        self._v = world.velocity * self._speed_scale
        self._motion = np.zeros((3, 4 * len(wiring.rows)))  # x0, v, h of every slot
        self._motion[0, wiring.slots] = self._x
        self._dac, self._on, self._adc = (a.reshape(-1) for a in (self.lines.dac, self.lines.on, self.lines.adc))
        for firmware, cut in self._cuts():
            firmware.encoders.place(self._motion[0, cut])
        self._step()

    def _cuts(self) -> list[tuple[Firmware, slice]]:
        return [(bus, slice(4 * first, 4 * (first + bus.count)))
                for bus, first in zip(self.buses, self._firsts, strict=True)]

    # -- time ----------------------------------------------------------------------------------------------------------

    def answer(self, bus: int, data: wire.Buffer, receive_ns: int) -> wire.Buffer | None:
        """The reply of a bus to a datagram that arrived at `receive_ns`; None when there is none."""
        tick = ticks_of(receive_ns - self.epoch_ns)
        if tick >= self._next:
            self._until(tick)
        reply = self.buses[bus].answer(data, tick)
        if reply is not None and self.lose > 0:
            self.lose -= 1
            return None
        return reply

    def advance(self, now_ns: int) -> None:
        """Let all time up to `now_ns` pass."""
        self._until(ticks_of(now_ns - self.epoch_ns))

    def _until(self, tick: int) -> None:
        behind = (tick - self._next) // self._span - MOST_STEPS
        if behind > 0:  # we were stopped: the robots stood still meanwhile, the boards' clocks did not
            self.skipped_steps += behind
            self._next += behind * self._span
        while tick >= self._next:
            self._step()

    @property
    def board_ns(self) -> int:
        """When the step under way began."""
        return self.epoch_ns + ns_of(self.begin)

    def _step(self) -> None:
        """Begin the step at `_next`."""
        self.begin = tick = self._next
        self._next = tick + self._span
        for bus in self.buses:
            bus.step(tick)
        self._sense()
        for bus in self.buses:
            bus.check_currents(tick)
        self.position[:], self.velocity[:] = self._world.position, self._world.velocity
        self._world.step_current(self.current)
        self._move()
        self.on_step()

    def _sense(self) -> None:
        """The currents that flow, and what the converters make of them and of the potentiometers."""
        wiring, work, slots = self.wiring, self._work, self.wiring.slots
        wiring.amps.apply(self._dac[slots].astype(np.float64), self.current)
        self.current *= self._on[slots]
        wiring.pot_volts.apply(self._world.pot_position, work)
        if self._noise_v > 0.0:
            work += self._random.normal(0.0, self._noise_v, work.size)
        words = bits(wiring.pot_bits.apply(work, work)).astype(np.uint32) << 16
        self._adc[slots] = words | bits(wiring.measured.apply(self.current, work)).astype(np.uint32)

    def _move(self) -> None:
        """Motion of every encoder during the step: through both positions, with the change of speed between them."""
        slots, motion, span = self.wiring.slots, self._motion, self._span
        x = self.wiring.counts.apply(self._world.position, np.zeros_like(self._x))
        v = self._world.velocity * self._speed_scale
        h = (v - self._v) / (2.0 * span)
        motion[0, slots] = self._x
        motion[1, slots] = (x - self._x) / span - h * span
        motion[2, slots] = h
        self._x, self._v = x, v
        for bus, cut in self._cuts():
            bus.encoders.follow(self.begin, span, motion[0, cut], motion[1, cut], motion[2, cut])

    # -- what happens to boards and robots -----------------------------------------------------------------------------

    def press(self, name: str, pressed: bool) -> None:
        """Press or release a button; KeyError names what there is."""
        if name not in self.wiring.inputs:
            raise KeyError(f"{name}: no such input; there are {', '.join(self.wiring.inputs) or 'none'}")
        button = self.wiring.inputs[name]
        level = 1 << button.bit
        rest = int(self.lines.inputs[button.row]) & ~level
        self.lines.inputs[button.row] = rest | (level if pressed == button.pressed else 0)

    def fail_amplifier(self, robot: str, axis: int, failed: bool) -> None:
        """Make the amplifier of an actuator fail, or mend it."""
        bus, slot = self._slot(robot, axis)
        bus.power.fail_amplifier(slot // 4, slot % 4, failed, bus.now)

    def lose_supply(self, robot: str, lost: bool) -> None:
        """Take the motor supply of a robot's boards away, or give it back."""
        for row in self.wiring.boards_of(self._known(robot)):
            bus, local = self._bus_of(row)
            bus.power.lose_supply(local, lost, bus.now)

    def jump_encoder(self, robot: str, axis: int, counts: int) -> None:
        """Make the counter of an actuator wrong by `counts`."""
        bus, slot = self._slot(robot, axis)
        bus.encoders.jump(slot, counts)

    def _known(self, robot: str) -> str:
        if robot not in self.wiring.robots:
            raise KeyError(f"{robot}: no such robot; there are {', '.join(self.wiring.robots)}")
        return robot

    def _slot(self, robot: str, axis: int) -> tuple[Firmware, int]:
        """The bus of an actuator and its slot there."""
        slots = self.wiring.slots[self.wiring.robots[self._known(robot)]]
        if not 0 <= axis < len(slots):
            raise KeyError(f"{robot}: axis {axis}; allowed: 0 to {len(slots) - 1}")
        bus, row = self._bus_of(int(slots[axis]) // 4)
        return bus, 4 * row + int(slots[axis]) % 4

    def _bus_of(self, row: int) -> tuple[Firmware, int]:
        number = max(k for k, first in enumerate(self._firsts) if first <= row)
        return self.buses[number], row - self._firsts[number]
