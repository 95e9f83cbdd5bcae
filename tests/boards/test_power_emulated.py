"""DQLA, dRA1 and QLA 1.5 with robots on them: inputs at rest, voltages and digital amplifiers checked in every step."""

from __future__ import annotations

import dataclasses

import numpy as np

from tests.boards.rails import MS, START, Rails, two_buses, write
from tests.fpga import board_side
from trocar.procs.boards.emulation import Emulation, SensorErrors
from trocar.procs.document.system import Controller, SystemConfig
from trocar.procs.fpga import registers as reg
from trocar.procs.fpga import wire


def _with(*controllers: Controller) -> SystemConfig:
    """The usual two buses, the first with other controllers: ids 9 and 3."""
    system = two_buses()
    assert system.emulation is not None
    first, second = system.emulation.buses
    buses = (dataclasses.replace(first, controllers=controllers), second)
    return dataclasses.replace(system, emulation=dataclasses.replace(system.emulation, buses=buses))


def _read(world: Emulation, node: int, address: int, now: int) -> int:
    reply = board_side.decode_response(world.answer(0, wire.quadlet_read(node, address, 1, 1), now) or b"")
    assert isinstance(reply, board_side.WireResponse)
    return reply.value


def test_inputs_at_rest_are_pulled_up_but_for_buttons_that_pull_when_pressed() -> None:
    world = Emulation(_with(Controller(9, "DQLA", fpga="V3"), Controller(3, "dRA1", fpga="V3")), Rails(7), START)
    assert _read(world, 0, reg.DIGITAL_INPUT, START + 1) == 0x0FFF_0FFF, "clutch: bit 4, low when pressed"
    assert _read(world, 1, reg.DIGITAL_INPUT, START + 1) == 0x0001_FFFE, "limit: bit 0, high when pressed"


def test_a_voltage_is_held_against_the_current_limit_in_every_step() -> None:
    world = Emulation(_with(Controller(9, qla="1.5"), Controller(3)), Rails(7), START)
    write(world, 0, 0, reg.WATCHDOG, 0, START + 100)
    write(world, 0, 0, reg.STATUS, 0x000C_0F0F, START + 200)
    world.advance(START + 80 * MS)
    volts = round(45.5 * 65535 / 91) + round(3.0 * 65535 / 91)
    write(world, 0, 0, 0x11, reg.DAC_VALID | 1 << 24 | volts, START + 80 * MS + 1)
    world.advance(START + 120 * MS)
    assert _read(world, 0, reg.STATUS, START + 120 * MS) & 0xFF0 == 0xF00
    world.advance(START + 140 * MS)
    assert _read(world, 0, reg.STATUS, START + 140 * MS) & 0xFF0 == 0xE10, "0.6 A, where 0.2 A are allowed"


def test_a_deviation_on_a_digital_amplifier_is_counted_in_every_step() -> None:
    world = Emulation(_with(Controller(9, "dRA1", fpga="V3"), Controller(3)), Rails(7), START)
    for address, value in ((reg.WATCHDOG, 0), (reg.axis_register(0, reg.ENCODER_PRELOAD), 0x80_0000),
                           (reg.STATUS, reg.CONTROL_POWER_ON)):
        write(world, 0, 0, address, value, START + 100)
    write(world, 0, 0, 0x11, reg.DAC_AMP_MASK | reg.DAC_AMP_ENABLE, START + 25 * MS)
    world.advance(START + 30 * MS)
    world.sensor_errors = SensorErrors.none(world.lines.adc.size)
    world.sensor_errors.current[world.wiring.slots[0]] = 0.1  # 524 bits of the rails' files
    world.advance(START + 100 * MS)
    status = reg.axis_register(0, reg.MOTOR_STATUS)
    assert _read(world, 0, status, START + 100 * MS) >> 28 == 3
    write(world, 0, 0, 0x11, reg.DAC_AMP_MASK, START + 101 * MS)
    assert _read(world, 0, status, START + 102 * MS) == 2 << 16
    assert np.all(world.lines.dac == reg.CURRENT_ZERO)
