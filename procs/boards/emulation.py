"""All emulated buses of a system and the robots on them, on one clock that only the caller advances.

Physics runs one step ahead: the currents at the beginning of a step are applied for its whole length, so that positions
within the step are known in closed form and encoders can be read at any tick in it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from trocar.procs.boards.controllers.bus import GROUP, EmulatedBus
from trocar.procs.boards.controllers.lines import Floats, Lines
from trocar.procs.boards.packet_faults import PacketFaults
from trocar.procs.boards.robots.plant import Plant
from trocar.procs.boards.setup_joints import fit
from trocar.procs.boards.wiring import Wiring
from trocar.procs.document.system import SystemConfig
from trocar.procs.fpga import registers as reg
from trocar.procs.fpga import wire
from trocar.procs.native import library
from trocar.procs.native.boards_fields import WORLD

FRAME_TICKS = 33  # no two datagrams reach a board closer than the shortest frame takes at 1 Gbit/s
MIDDLE = (0x7FFF, 0x8000)  # commands on either side of no current
FIRST, LAST, ERRORS, COMPARE = 1, 2, 4, 8  # the work of `sense`: its two halves, and with which options
TOO_MUCH, BRAKES = 1, 2  # its findings
MAX_STEPS = 100  # physics steps caught up after a pause; the rest is skipped


@dataclass(frozen=True, slots=True)
class SensorErrors:
    """Errors of the sensors; arrays over all slots, changed in place."""

    current: Floats  # A
    pot: Floats  # V
    pot_drift: Floats  # V a step, by which `pot` grows
    pot_alive: Floats  # 1; 0 for a failed potentiometer: it shows 0 V

    @classmethod
    def none(cls, slots: int) -> SensorErrors:
        """All zero."""
        return cls(np.zeros(slots), np.zeros(slots), np.zeros(slots), np.ones(slots))


def ticks_of(ns: int) -> int:
    """Whole ticks of 49.152 MHz in a time."""
    return ns * 768 // 15625


def ns_of(tick: int) -> int:
    """The time of a tick, rounded up: `ticks_of` returns the tick."""
    return -(-tick * 15625 // 768)


def _too_much(measured: Floats, commanded: Floats | npt.NDArray[np.uint32]) -> Floats:
    """Excess of measured currents (offset binary) over the limits of the boards, bits."""
    middle = 0.5 * reg.DAC_VALUE_MASK
    excess: Floats = np.abs(measured - middle) - np.abs(commanded - middle) - reg.CURRENT_EXCESS
    return excess


def _nothing() -> None:
    pass


class Emulation:
    """The controllers of every bus of `system` and their robots."""

    def __init__(self, system: SystemConfig, world: Plant, now_ns: int) -> None:
        """Boards powered up at `now_ns`; `world` moves the robots. The first step begins at once."""
        if system.emulation is None:
            raise ValueError(f"{system.name}: no emulated boards in this system")
        self.wiring = wiring = Wiring(system, system.emulation)
        self.lines = Lines.of(len(wiring.rows), wiring.width)
        self.lines.inputs[:] = wiring.released()
        self.buses: list[EmulatedBus] = []
        self._firsts: list[int] = []  # first row of each bus
        for described in system.emulation.buses:
            self._firsts.append(sum(made.count for made in self.buses))
            part = self.lines.part(self._firsts[-1], len(described.controllers))
            self.buses.append(EmulatedBus(described.controllers, part, network=described.network,
                                          testboard=described.testboard))
        self.setup_joints = fit(system, wiring, self.buses)
        self.epoch_ns = now_ns
        self.skipped_steps = 0
        self.sensor_errors: SensorErrors | None = None  # None: no errors
        self.packet_faults = PacketFaults(len(self.buses), system.emulation.seed)
        self._world = world
        self.on_step: Callable[[], None] = _nothing  # called when a step has begun
        self._span = round(system.emulation.period_s * reg.CLOCK_HZ)
        self._noise_v = system.emulation.pot_noise_v
        self._random = np.random.default_rng(system.emulation.seed)
        self.begin = self._next = 0  # the step under way, in ticks
        self._heard = [-FRAME_TICKS] * len(self.buses)  # tick of each bus's last datagram
        axes = len(wiring.slots)
        self._has_robots = axes > 0  # boards may be there for their own sake
        self._has_tables = wiring.table_slots.size > 0
        self.position, self.velocity = world.position.copy(), world.velocity.copy()  # start of the step
        self.current = np.zeros(axes)
        self.dac, self.on = self.lines.dac.reshape(-1), self.lines.on.reshape(-1)
        self.converted = self.lines.adc.reshape(-1).view(np.uint16).reshape(-1, 2)
        self._adc = self.converted.T  # measured currents, potentiometers
        self.axes, self.slots = axes, len(self.dac)
        self._at_slots(self.slots)
        self._cut = tuple(self._cuts())
        for robot, own in wiring.brakes.robots:
            engaged = np.zeros(wiring.count_of(robot), dtype=np.bool_)
            engaged[: own.size] = True
            world.brake(robot, engaged, True)
        if self._has_robots:
            for bus, cut in self._cut:
                bus.encoders.place(self.now[0, cut])
            self._sense, self._move = library.chosen(WORLD, self)
        self.step()

    def _at_slots(self, count: int) -> None:
        """Data of actuators, laid out by slots: no gather is needed except for input and output of the world.

        Slots without an actuator use the first one's values, and all their scales are 0.
        """
        wiring = self.wiring
        self.axis_of = np.zeros(count, dtype=np.int64)
        self.axis_of[wiring.slots] = np.arange(len(wiring.slots))
        self.motor_of = wiring.slots.astype(np.int64)  # the slot whose current drives each motor
        self.brakes = len(wiring.brakes.slots)
        self.let_go = np.zeros(self.brakes, dtype=np.bool_)
        self.amps = np.array((wiring.amps.scale, wiring.amps.offset))
        self._on_bytes = b""
        self.counts_scale = np.array((wiring.counts.scale, wiring.counts.scale / reg.CLOCK_HZ))
        self.counts_offset = np.array((wiring.counts.offset, np.zeros(count)))
        # Rows: motor currents, A, and potentiometers, V; scales and offsets that make them of commands and positions.
        self.scales = np.array((np.zeros(count), wiring.pot_volts.scale))
        self.offsets = np.array((np.zeros(count), wiring.pot_volts.offset))
        self.to_bits = np.array(((wiring.measured.scale, wiring.pot_bits.scale),
                                 (wiring.measured.offset, wiring.pot_bits.offset)))
        self.truth, self.bits, self.seen = (np.zeros((2, count)) for _ in range(3))
        self._flowing, self._volts = self.truth
        self._is_over, self._may_be_over = False, self._may_exceed()
        self.now, self.curve = np.zeros((2, count)), np.zeros((3, count))
        self.per_tick = 1.0 / self._span
        if self._has_robots:
            self.now[...] = self._where()

    def _where(self) -> Floats:
        """(2, slots): position, counts, and velocity, counts/tick, of every slot as the world has them now."""
        here = np.array((self._world.position.take(self.axis_of), self._world.velocity.take(self.axis_of)))
        where: Floats = here * self.counts_scale + self.counts_offset
        return where

    def _cuts(self) -> list[tuple[EmulatedBus, slice]]:
        width = self.wiring.width
        return [(bus, slice(width * first, width * (first + bus.count)))
                for bus, first in zip(self.buses, self._firsts, strict=True)]

    # -- faults of cables and sensors ----------------------------------------------------------------------------------

    def scale_encoder(self, axis: int, factor: float) -> None:
        """Scale an actuator's encoder counts by `factor` from its current position; 1 restores the file's value."""
        slot = self.wiring.slots[axis]
        scale = self.wiring.counts.scale[slot] * factor
        self.counts_scale[:, slot] = scale, scale / reg.CLOCK_HZ
        self.counts_offset[0, slot] = self.now[0, slot] - scale * self._world.position[axis]
        self.now[...] = self._where()

    def swap_motors(self, one: int, other: int) -> None:
        """Exchange the plugs of two motors: each gets the other's current."""
        self.motor_of[[one, other]] = self.motor_of[[other, one]]

    def seed(self, seed: int) -> None:
        """Restart sensor noise and packet chance with another seed than the system's."""
        self._random = np.random.default_rng(seed)
        self.packet_faults.seed(seed, len(self.buses))

    # -- time ----------------------------------------------------------------------------------------------------------

    def answer(self, bus: int, data: wire.Buffer, receive_ns: int, to: int = GROUP) -> wire.Buffer | None:
        """The reply of a bus to a datagram that arrived at `receive_ns`; None if there is none.

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
        """Id of the board that has this IP address (four bytes); None: no board has it."""
        return self.buses[bus].board_at(address)

    def advance(self, now_ns: int) -> None:
        """Advance time to `now_ns`."""
        self._until(ticks_of(now_ns - self.epoch_ns))

    def _until(self, tick: int) -> None:
        behind = (tick - self._next) // self._span - MAX_STEPS
        if behind > 0:  # the process was stopped: the robots stayed at rest meanwhile, the boards' clocks ran
            self.skipped_steps += behind
            self._next += behind * self._span
        while tick >= self._next:
            self.step()

    @property
    def board_ns(self) -> int:
        """Start of the current step."""
        return self.epoch_ns + ns_of(self.begin)

    def step(self) -> None:
        """Begin the step at `_next`."""
        self.begin = tick = self._next
        self._next = tick + self._span
        for bus in self.buses:
            bus.step(tick)
        if self._has_robots:
            news = self._feel()
            self._check_currents(tick, bool(news & TOO_MUCH))
            if news & BRAKES:
                self._brake()
            self._world.step_current(self.current)
            self._move()
            for bus, cut in self._cut:
                bus.encoders.follow(tick, self._span, self.curve[:, cut])
        self.on_step()

    def _brake(self) -> None:
        """Release and engage brakes according to their currents."""
        brakes, let_go = self.wiring.brakes, self.let_go
        let_go[...] = self._lets_go_now()
        for robot, own in brakes.robots:
            for engaged in (False, True):
                actuators = np.zeros(self.wiring.count_of(robot), dtype=np.bool_)
                actuators[: own.size] = let_go[own] != engaged
                self._world.brake(robot, actuators, engaged)

    def _lets_go_now(self) -> npt.NDArray[np.bool_]:
        brakes = self.wiring.brakes
        lets_go: npt.NDArray[np.bool_] = (np.abs(self._flowing[brakes.slots])
                                          >= np.where(self.let_go, brakes.holds_off, brakes.lets_go))
        return lets_go

    def _feel(self) -> int:
        """`sense`, and additions that only some systems have between its halves or after them."""
        compare = COMPARE if self._may_be_over or self.sensor_errors is not None else 0
        if self.setup_joints or self._noise_v > 0.0 or self.sensor_errors is not None:
            self._sense(FIRST)
            for joints in self.setup_joints.values():
                self._volts[joints.slots] = joints.step(self._flowing, self.on)
            if self._noise_v > 0.0:
                self._volts += self._random.normal(0.0, self._noise_v, self.axes)[self.axis_of]
            if self.sensor_errors is not None:
                self._with_errors(self.sensor_errors)
            news = self._sense(LAST | compare | (ERRORS if self.sensor_errors is not None else 0))
        else:
            news = self._sense(FIRST | LAST | compare)
        if self._has_tables:
            volts = self._volts if self.sensor_errors is None else self.seen[1]
            slots = self.wiring.table_slots
            self._adc[1, slots] = np.clip(self.wiring.tables.readings(volts[slots]), 0.0, 65535.0)
        return news

    def sense(self, which: int) -> int:
        """Currents that flow; then the converter readings of them and of the potentiometers.

        With ERRORS these are of `seen`. TOO_MUCH: with COMPARE, a current may be too high; BRAKES: some switch.
        """
        truth, flowing, volts, bits, news = self.truth, self._flowing, self._volts, self.bits, 0
        if which & FIRST:
            self.position[...], self.velocity[...] = self._world.position, self._world.velocity
            on = self.on.tobytes()
            if on != self._on_bytes:
                self._on_bytes = on
                self.scales[0], self.offsets[0] = self.amps * self.on
            flowing[...] = self.dac
            volts[...] = self._world.pot_position.take(self.axis_of)
            truth[...] = truth * self.scales + self.offsets
            flowing.take(self.motor_of, None, self.current, "clip")
        if which & LAST:
            exact = (self.seen if which & ERRORS else truth) * self.to_bits[0] + self.to_bits[1]
            self._adc[...] = bits[...] = np.minimum(np.maximum(np.rint(exact), 0.0), 65535.0)
            if which & COMPARE and (_too_much(bits[0], self.dac) > 0.0).any():
                news |= TOO_MUCH
            if self.brakes and (self._lets_go_now() != self.let_go).any():
                news |= BRAKES
        return news

    def _with_errors(self, errors: SensorErrors) -> None:
        """Sensor readings with errors instead of the true values."""
        np.add(errors.pot, errors.pot_drift, errors.pot)
        np.add(self.truth, (errors.current, errors.pot), self.seen)
        np.multiply(self.seen[1], errors.pot_alive, self.seen[1])

    def _may_exceed(self) -> bool:
        """Whether a measured current can be too high, by the files, with ideal amplifiers and sensors.

        It is a straight line over the commanded one: no command exceeds more than one at an end or in the middle.
        """
        for on in (0.0, 1.0):
            for command in (0.0, *MIDDLE, reg.DAC_VALUE_MASK):
                flowing = (command * self.amps[0] + self.amps[1]) * on
                measured = flowing * self.to_bits[0, 0] + self.to_bits[1, 0]
                if (_too_much(measured, np.full_like(measured, command)) > -1.0).any():  # less than that is rounded
                    return True
        return False

    def _check_currents(self, tick: int, is_over: bool) -> None:
        """The boards' current check, left out while no current is near being too much and none was.

        A voltage has no commanded current to compare with, and digital amplifiers are stricter.
        """
        for bus in self.buses:
            if is_over or self._is_over or bus.firmware.motors.checks_always:
                bus.firmware.motors.check_currents(tick)
        self._is_over = is_over

    def move(self) -> int:
        """Motion of every encoder during the step: through both positions, with the change of speed between them."""
        now, end = self.now, self._where()
        mean, faster = (end[0] - now[0]) * self.per_tick, (end[1] - now[1]) * 0.5
        self.curve[...] = now[0], mean - faster, faster * self.per_tick
        now[...] = end
        return 0
