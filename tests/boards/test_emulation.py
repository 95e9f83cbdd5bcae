"""Two buses with robots on a fake world: the host's own conversions get the world's values back."""

from __future__ import annotations

import dataclasses
import itertools
import math

import pytest

from tests.boards.rails import MS, START, Rails, real_time, two_buses, write
from trocar.procs.boards.emulation import FRAME_TICKS, MAX_STEPS, Emulation, ns_of, ticks_of
from trocar.procs.boards.wiring import Wiring
from trocar.procs.document.system import BusConfig, Controller, Linear
from trocar.procs.document.system import EmulationConfig as EmulationRow
from trocar.procs.fpga import blocks, wire
from trocar.procs.fpga import registers as reg


def test_ticks_and_nanoseconds_give_each_other_back() -> None:
    assert ticks_of(10**9) == reg.CLOCK_HZ
    assert all(ticks_of(ns_of(tick)) == tick for tick in (0, 1, 767, 49152, 10**12 + 7))


def test_host_conversions_recover_the_positions() -> None:
    system, rails = two_buses(), Rails(7)
    world = Emulation(system, rails, START)
    actuator = system.ios[0].robots[0].actuators[1]  # board 9 (node 0), axis 1, negative scales
    assert actuator.encoder is not None and actuator.potentiometer is not None
    pot = actuator.potentiometer
    block = real_time(world, 0, 0, START + 1000)
    volts = (block[blocks.ADC][1] >> 16) * pot.bits_to_voltage.scale
    position = volts * pot.voltage_to_position.scale + pot.voltage_to_position.offset
    assert position == pytest.approx(rails.position[1], abs=4e-5)
    assert block[blocks.POSITION][1] & reg.ENCODER_MASK == reg.ENCODER_ZERO
    scale = actuator.encoder.bits_to_position
    counts = math.floor((rails.position[1] - scale.offset) / scale.scale)
    write(world, 0, 0, reg.axis_register(1, reg.ENCODER_PRELOAD), counts + reg.ENCODER_ZERO, START + 2000)
    rails.velocity[:] = 0.5
    at = START
    for k in range(40):
        at = START + k * MS
        world.advance(at)
    block = real_time(world, 0, 0, at + MS // 2)
    counts = (int(block[blocks.POSITION][1]) & reg.ENCODER_MASK) - reg.ENCODER_ZERO
    expected = world.position[1] + 0.5 * 0.5e-3
    assert counts * scale.scale + scale.offset == pytest.approx(expected, abs=abs(scale.scale))
    period = int(block[blocks.PERIOD][1])
    sign = 1.0 if period & reg.VELOCITY_DIRECTION else -1.0
    speed = sign * 4.0 / ((period & reg.VELOCITY_TICKS_MASK) * reg.TICK_S) * scale.scale
    assert speed == pytest.approx(0.5, rel=0.01)


def test_commanded_current_flows_only_through_amplifiers_that_are_on() -> None:
    rails = Rails(7)
    world = Emulation(two_buses(), rails, START)
    now = START
    write(world, 0, 1, reg.WATCHDOG, 0, now)
    write(world, 0, 1, reg.axis_register(2, reg.DAC), 0x8000_0000 | round(0.2 * 5242.88 + 32788), now)
    write(world, 0, 1, reg.STATUS, 0x000C0F0F, now)
    world.advance(now + 59 * MS)
    assert not rails.currents[-1].any()
    world.advance(now + 65 * MS)
    assert rails.currents[-1] == pytest.approx([0, 0, 0, rails.currents[-1][3], 0.2, 0, 0], abs=2e-4)
    block = real_time(world, 0, 1, now + 66 * MS)
    assert (block[blocks.ADC][2] & 0xFFFF) / 5242.88 - 6.25 == pytest.approx(0.2, abs=2e-4)
    world.advance(now + 66 * MS)
    write(world, 0, 1, reg.STATUS, reg.CONTROL_AMPS_OFF, now + 66 * MS)
    world.advance(now + 68 * MS)
    assert not rails.currents[-1].any()


def test_current_far_from_its_command_trips_the_boards_check() -> None:
    system = two_buses()
    first, *others = system.ios[0].robots[0].actuators  # board 9, axis 0: measures half as much again
    wrong = dataclasses.replace(first, bits_to_current=Linear(1 / 5242.88 / 1.5, -6.25 / 1.5))
    robot = dataclasses.replace(system.ios[0].robots[0], actuators=(wrong, *others))
    io = dataclasses.replace(system.ios[0], robots=(robot,))
    rails = Rails(7)
    world = Emulation(dataclasses.replace(system, ios=(io, system.ios[1])), rails, START)
    power = world.buses[0].power
    write(world, 0, 0, reg.WATCHDOG, 0, START)
    write(world, 0, 0, reg.STATUS, 0x000C0F0F, START)
    world.advance(START + 70 * MS)
    for amps in (1.5, 0.0, 1.5):  # the pause starts the 50 ms anew
        at = world.board_ns
        write(world, 0, 0, reg.axis_register(0, reg.DAC), 0x8000_0000 | round(amps * 5242.88 + 32768), at)
        world.advance(at + 49 * MS)
        assert not power.safety.any()
    world.advance(at + 60 * MS)
    assert power.safety.tolist() == [[False] * 4, [True, False, False, False]]
    assert rails.currents[-1][0] == 0.0


def test_watchdog_expires_by_arrival_times_whenever_polled() -> None:
    cut = []
    for stride in (1, 5, 90):
        world = Emulation(two_buses(), Rails(7), START)
        write(world, 0, wire.BROADCAST, reg.STATUS, 0x000C0F0F, START + 500)
        for k in range(1, 20):
            write(world, 0, wire.BROADCAST, reg.DIGITAL_OUTPUT, 0, START + k * 4 * MS)
        for k in range(0, 200, stride):
            world.advance(START + (76 + k) * MS)
        power = world.buses[0].power
        cut.append((int(power.watchdog_tick[0]), int(power.cut_tick[0])))
    assert len(set(cut)) == 1
    assert cut[0][0] == cut[0][1] == ticks_of(76 * MS) + 0x1680 * 256 + 1


def test_after_a_long_stop_the_robots_have_stood_still() -> None:
    rails = Rails(7)
    world = Emulation(two_buses(), rails, START)
    rails.velocity[:] = 0.1
    world.advance(START + 10 * MS)
    steps = len(rails.currents)
    world.advance(START + 5000 * MS)
    assert len(rails.currents) - steps == MAX_STEPS + 1
    assert world.skipped_steps == 4990 - MAX_STEPS - 1
    assert START + 4999 * MS <= world.board_ns <= START + 5000 * MS


def test_potentiometer_noise_follows_the_seed() -> None:
    words = []
    for _ in range(2):
        world = Emulation(two_buses(noise=0.01), Rails(7), START)
        world.advance(START + 5 * MS)
        words.append(real_time(world, 0, 0, START + 5 * MS)[blocks.ADC].tolist())
    quiet = Emulation(two_buses(), Rails(7), START)
    quiet.advance(START + 5 * MS)
    assert words[0] == words[1] != real_time(quiet, 0, 0, START + 5 * MS)[blocks.ADC].tolist()


def test_robots_on_boards_that_are_not_there_are_refused() -> None:
    system = two_buses()
    assert system.emulation is not None
    with pytest.raises(ValueError, match="PSM1: board 3 is not on the emulated bus of IO1; it has 9"):
        Wiring(system, EmulationRow(1e-3, (BusConfig("IO1", "127.0.0.1", (Controller(9),)),)))


def test_datagrams_that_were_read_late_still_reach_the_boards_one_after_the_other() -> None:
    world = Emulation(two_buses(), Rails(7), START)
    world.advance(START + 8 * MS)
    ticks = []
    for late_ns in (9000, 6000, 3000, 0):
        world.answer(0, wire.quadlet_read(0, reg.STATUS, 1, 1), START + 8 * MS - late_ns)
        ticks.append(world.buses[0].now)
    assert all(after - before >= FRAME_TICKS for before, after in itertools.pairwise(ticks))
