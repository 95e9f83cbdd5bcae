"""All emulated buses of a system and the robots on them, on one clock that only moves when told.

Physics runs one step ahead: at the beginning of a step the currents that flow then are applied for its whole length,
so that positions within the step are known in closed form and encoders can be asked for any tick in it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from procs.boards.controllers.bus import GROUP, Bus
from procs.boards.controllers.currents import CURRENT_EXCESS
from procs.boards.controllers.lines import Lines
from procs.boards.mishaps import Mishaps
from procs.boards.setup_joints import fit
from procs.boards.wiring import Wiring
from procs.lib import registers as reg
from procs.lib import wire
from procs.lib.document import System

Floats = npt.NDArray[np.float64]
FRAME_TICKS = 33  # no two datagrams reach a board closer than the shortest frame takes at 1 Gbit/s
MOST_STEPS = 100  # physics steps made up for after a pause; what is beyond is left out


@dataclass(frozen=True, slots=True)
class SensorErrors:
    """What sensors show too much; arrays over all slots, changed in place."""

    current: Floats  # A
    pot: Floats  # V
    pot_drift: Floats  # V a step, by which `pot` grows

    @classmethod
    def none(cls, slots: int) -> SensorErrors:
        """All zero."""
        return cls(*np.zeros((3, slots)))


class World(Protocol):
    """What moves the robots; arrays over all actuators, SI, changed in place by each step."""

    position: Floats
    velocity: Floats
    pot_position: Floats

    def step_current(self, current: Floats) -> None:
        """One period under motor currents, A."""

    def brake(self, robot: str, actuators: npt.NDArray[np.bool_], engaged: bool) -> None:
        """Hold or let go of some actuators of a robot, from the next step on."""


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
        self.lines = Lines.of(len(wiring.rows), wiring.width)
        self.lines.inputs[:] = wiring.released()
        self.buses: list[Bus] = []
        self._firsts: list[int] = []  # first row of each bus
        for described in system.emulation.buses:
            self._firsts.append(sum(made.count for made in self.buses))
            part = self.lines.part(self._firsts[-1], len(described.controllers))
            self.buses.append(Bus(described.controllers, part, network=described.network,
                                  testboard=described.testboard))
        self.setup_joints = fit(system, wiring, self.buses)
        self.epoch_ns = now_ns
        self.skipped_steps = 0
        self.sensor_errors: SensorErrors | None = None  # None: they tell the truth
        self.mishaps = Mishaps(len(self.buses), system.emulation.seed)
        self._world = world
        self.on_step: Callable[[], None] = _nothing  # called when a step has begun
        self._span = round(system.emulation.period_s * reg.CLOCK_HZ)
        self._noise_v = system.emulation.pot_noise_v
        self._random = np.random.default_rng(system.emulation.seed)
        self.begin = self._next = 0  # the step under way, in ticks
        self._heard = [-FRAME_TICKS] * len(self.buses)  # tick of each bus's last datagram
        axes = len(wiring.slots)
        self._has_robots = axes > 0  # boards may be there for their own sake
        self.position, self.velocity = world.position.copy(), world.velocity.copy()  # when the step began
        self.current = np.zeros(axes)
        self._dac, self._on, self._adc = (a.reshape(-1) for a in (self.lines.dac, self.lines.on, self.lines.adc))
        self._at_slots(len(self._dac))
        self._cut = tuple(self._cuts())
        for robot, own in wiring.brakes.robots:
            engaged = np.zeros(wiring.count_of(robot), dtype=np.bool_)
            engaged[: own.size] = True
            world.brake(robot, engaged, True)
        if self._has_robots:
            for bus, cut in self._cut:
                bus.encoders.place(self._now[0, cut])
        self._step()

    def _at_slots(self, count: int) -> None:
        """What belongs to actuators, laid out by slots: no gather is needed but for what the world says and hears.

        Slots without an actuator look at the first one's values, and all their scales are 0.
        """
        wiring = self.wiring
        self._axis_of = np.zeros(count, dtype=np.intp)
        self._axis_of[wiring.slots] = np.arange(len(wiring.slots))

        def spread(values: Floats, elsewhere: float = 0.0, brakes: Floats | None = None) -> Floats:
            spread = np.full(count, float(elsewhere))
            spread[wiring.slots] = values
            if brakes is not None:
                spread[wiring.brakes.slots] = brakes
            return spread

        of_brakes = wiring.brakes
        self._let_go = np.zeros(len(of_brakes.slots), dtype=np.bool_)
        self._amps = (spread(wiring.amps.scale, 0.0, of_brakes.amps.scale),
                      spread(wiring.amps.offset, 0.0, of_brakes.amps.offset))
        self._volts = (spread(wiring.pot_volts.scale), spread(wiring.pot_volts.offset))
        counts = spread(wiring.counts.scale)
        self._counts = (np.array((counts, counts / reg.CLOCK_HZ)),
                        np.array((spread(wiring.counts.offset), np.zeros(count))))
        measured = (spread(wiring.measured.scale, 0.0, of_brakes.measured.scale),
                    spread(wiring.measured.offset, reg.CURRENT_ZERO, of_brakes.measured.offset))
        self._to_bits = (np.array((spread(wiring.pot_bits.scale), measured[0])),
                         np.array((spread(wiring.pot_bits.offset), measured[1])))
        self._flowing = np.zeros(count)
        self._bits = np.zeros((3, count))  # potentiometers, measured and commanded currents
        self._most, self._least = np.full((2, count), 65535.0), np.zeros((2, count))
        self._upper = np.full(count, 65536.0)
        self._compared = np.zeros((2, count))  # measured and commanded currents, bits from mid-range
        self._middle = np.full((2, count), 32767.5)
        self._over, self._excess = np.zeros(count, dtype=np.bool_), np.full(count, float(CURRENT_EXCESS))
        self._is_over = False
        self._now, self._end, self._change = (np.zeros((2, count)) for _ in range(3))
        self._curve = np.zeros((3, count))
        # Rows as arrays of their own: indexing makes a new one every time, which costs as much as using it.
        self._words, (self._pot_volts, self._measured, self._commanded) = self._bits[:2], self._bits
        self._currents, (self._measured_off, self._commanded_off) = self._bits[1:], self._compared
        self._start, self._rates = self._curve[0], self._curve[1:]
        span = float(self._span)  # mean velocity less half its change, and half that change over the time
        self._to_rates = np.array(((1.0 / span, -0.5), (0.0, 0.5 / span)))
        self._now_rows, self._end_rows = tuple(self._now), tuple(self._end)
        if self._has_robots:
            self._where(self._now, self._now_rows)

    def _where(self, now: Floats, rows: tuple[Floats, ...]) -> None:
        """Position, counts, and velocity, counts/tick, of every slot as the world has them now."""
        self._world.position.take(self._axis_of, None, rows[0], "clip")
        self._world.velocity.take(self._axis_of, None, rows[1], "clip")
        np.multiply(now, self._counts[0], now)
        np.add(now, self._counts[1], now)

    def _cuts(self) -> list[tuple[Bus, slice]]:
        width = self.wiring.width
        return [(bus, slice(width * first, width * (first + bus.count)))
                for bus, first in zip(self.buses, self._firsts, strict=True)]

    # -- time ----------------------------------------------------------------------------------------------------------

    def answer(self, bus: int, data: wire.Buffer, receive_ns: int, to: int = GROUP) -> wire.Buffer | None:
        """The reply of a bus to a datagram that arrived at `receive_ns`; None when there is none.

        `to` is the board whose own address it was sent to; GROUP: the bus's.
        """
        tick = max(ticks_of(receive_ns - self.epoch_ns), self._heard[bus] + FRAME_TICKS)
        if tick >= self._next:
            self._until(tick)
        wires = self.buses[bus]
        reply = wires.answer(data, tick, to)
        self._heard[bus] = wires.now
        return reply

    def board_at(self, bus: int, address: bytes) -> int | None:
        """Id of the board that was given an IP address (four bytes); None: none was."""
        return self.buses[bus].board_at(address)

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
        if self._has_robots:
            self._sense()
            self._check_currents(tick)
            if self._let_go.size:
                self._brake()
            self.position[:], self.velocity[:] = self._world.position, self._world.velocity
            self._world.step_current(self.current)
            self._move()
        self.on_step()

    def _brake(self) -> None:
        """Brakes let go and hold as their currents say."""
        brakes, before = self.wiring.brakes, self._let_go
        current = np.abs(self._flowing[brakes.slots])
        let_go = current >= np.where(before, brakes.holds_off, brakes.lets_go)
        if (let_go == before).all():
            return
        self._let_go = let_go
        for robot, own in brakes.robots:
            for engaged in (False, True):
                actuators = np.zeros(self.wiring.count_of(robot), dtype=np.bool_)
                actuators[: own.size] = let_go[own] != engaged
                self._world.brake(robot, actuators, engaged)

    def _sense(self) -> None:
        """The currents that flow, and what the converters make of them and of the potentiometers."""
        words, volts, measured, commanded = self._words, self._pot_volts, self._measured, self._commanded
        flowing = self._flowing
        np.copyto(commanded, self._dac)
        np.multiply(commanded, self._amps[0], flowing)
        np.add(flowing, self._amps[1], flowing)
        np.multiply(flowing, self._on, flowing)
        flowing.take(self.wiring.slots, None, self.current, "clip")
        self._world.pot_position.take(self._axis_of, None, volts, "clip")
        np.multiply(volts, self._volts[0], volts)
        np.add(volts, self._volts[1], volts)
        for joints in self.setup_joints.values():
            volts[joints.slots] = joints.step(flowing, self.lines.on.reshape(-1))
        if self._noise_v > 0.0:
            volts += self._random.normal(0.0, self._noise_v, self.current.size)[self._axis_of]
        measured[:] = flowing
        if self.sensor_errors is not None:
            errors = self.sensor_errors
            np.add(errors.pot, errors.pot_drift, errors.pot)
            np.add(volts, errors.pot, volts)
            np.add(measured, errors.current, measured)
        np.multiply(words, self._to_bits[0], words)
        np.add(words, self._to_bits[1], words)
        np.rint(words, words)
        np.maximum(words, self._least, out=words)
        np.minimum(words, self._most, out=words)
        np.multiply(volts, self._upper, volts)
        np.add(volts, measured, volts)
        np.copyto(self._adc, volts, casting="unsafe")

    def _check_currents(self, tick: int) -> None:
        """The boards' current check, left out while no current is near being too much and none was.

        A voltage has no commanded current to compare with, and digital amplifiers are stricter.
        """
        compared, over = self._compared, self._over
        np.subtract(self._currents, self._middle, compared)
        np.absolute(compared, compared)
        np.subtract(self._measured_off, self._commanded_off, self._measured_off)
        np.greater(self._measured_off, self._excess, over)
        is_over = bool(np.count_nonzero(over))
        for bus in self.buses:
            if is_over or self._is_over or bus.firmware.motors.checks_always:
                bus.check_currents(tick)
        self._is_over = is_over

    def _move(self) -> None:
        """Motion of every encoder during the step: through both positions, with the change of speed between them."""
        now, end, rows = self._now, self._end, self._now_rows
        self._where(end, self._end_rows)
        np.subtract(end, now, self._change)
        self._start[...] = rows[0]
        self._to_rates.dot(self._change, self._rates)
        self._now, self._end, self._now_rows, self._end_rows = end, now, self._end_rows, rows
        for bus, cut in self._cut:
            bus.encoders.follow(self.begin, self._span, self._curve[:, cut])
