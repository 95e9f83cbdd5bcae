"""Boards on the loop-back board, through their registers."""

from __future__ import annotations

import time

import numpy as np
import pytest

from tests.fpga import board_side
from trocar.procs.boards.controllers.bus import EmulatedBus
from trocar.procs.document.system import Controller, Quirks
from trocar.procs.fpga import registers as reg
from trocar.procs.fpga import wire

US = 49.152
MS = 49152


class BenchOfTestboard:
    """A host of one board, one microsecond or more between two requests."""

    def __init__(self, firmware: int, lag: bool = True) -> None:
        self.bus = EmulatedBus((Controller(2, firmware=firmware, quirks=Quirks(direction_lag=lag)),), testboard=True)
        self.tick = 0

    def wait(self, us: float) -> None:
        self.tick += round(us * US)

    def write(self, address: int, value: int) -> None:
        self.wait(10)
        assert self.bus.answer(wire.quadlet_write(0, address, value, 1, 1), self.tick) is None

    def read(self, address: int) -> int:
        self.wait(10)
        response = board_side.decode_response(self.bus.answer(wire.quadlet_read(0, address, 1, 1), self.tick) or b"")
        assert isinstance(response, board_side.WireResponse)
        return response.value

    def pins(self, pins: int) -> None:
        """Set the output pins; the register holds their inverse."""
        self.write(reg.DIGITAL_OUTPUT, 0xF00 | ~pins & 0xF)


@pytest.mark.parametrize("firmware", [7, 8, 9])
def test_outputs_come_back_as_encoders_index_and_switches(firmware: int) -> None:
    bench = BenchOfTestboard(firmware)
    for pins in (0b0000, 0b0101, 0b1010, 0b1111):
        bench.pins(pins)
        inputs = bench.read(reg.DIGITAL_INPUT)
        a, b, index, switches = (pins >> k & 1 for k in range(4))
        assert inputs == (a * 0xF << 24 | b * 0xF << 20 | index * 0xF << 16 | (~pins & 0xF) << 12 | switches * 0xFFF)
        position = bench.read(reg.axis_register(3, reg.ENCODER))
        shown = (a * reg.ENCODER_PIN_A | b * reg.ENCODER_PIN_B | index * reg.ENCODER_PIN_INDEX) if firmware > 7 else 0
        assert position & 0x7000_0000 == shown


def test_a_hand_moved_encoder_counts_what_the_outputs_do() -> None:
    bench = BenchOfTestboard(8)
    bench.pins(0)
    for axis in range(4):
        bench.write(reg.axis_register(axis, reg.ENCODER_PRELOAD), 0x1000 * (axis + 1))
    for _ in range(5):
        for pins in (1, 3, 2, 0):
            bench.pins(pins)
    for axis in range(4):
        counted = bench.read(reg.axis_register(axis, reg.ENCODER)) & reg.ENCODER_MASK
        assert counted - 0x1000 * (axis + 1) in (18, 20), "up to the lag after a reversal"


@pytest.mark.parametrize(("lag", "counts"), [(True, 78), (False, 80)])
def test_a_played_table_turns_the_encoders_between_two_requests(lag: bool, counts: int) -> None:
    bench = BenchOfTestboard(8, lag)
    bench.pins(0)
    bench.write(reg.axis_register(0, reg.ENCODER_PRELOAD), reg.ENCODER_ZERO)
    ticks = 4915  # about 0.1 ms an entry
    table = [1 << 31 | ticks - 1 << 8 | ~pins & 0xF for pins in (1, 3, 2, 0) * 20] + [0]
    data = np.array(table, dtype=">u4").tobytes()
    bench.wait(10)
    assert bench.bus.answer(wire.block_write(0, reg.WAVEFORM, data, 1, 1), bench.tick) is None
    before = bench.read(reg.axis_register(0, reg.ENCODER)) & reg.ENCODER_MASK
    bench.write(reg.DIGITAL_OUTPUT, 1 << 31 | 0xF00)
    assert bench.read(reg.DIGITAL_INPUT) & reg.INPUT_WAVEFORM_ACTIVE
    bench.wait(5000)
    assert bench.read(reg.axis_register(0, reg.PERIOD)) == reg.VELOCITY_DIRECTION | 4 * (ticks - 1)
    bench.wait(5000)
    assert not bench.read(reg.DIGITAL_INPUT) & reg.INPUT_WAVEFORM_ACTIVE
    after = bench.read(reg.axis_register(0, reg.ENCODER)) & reg.ENCODER_MASK
    assert after - before == counts, "with the lag, the first edge counts in the direction of power-up"


def test_commanded_current_flows_and_analog_inputs_have_the_test_voltage() -> None:
    bench = BenchOfTestboard(8)
    bench.write(reg.WATCHDOG, 0)
    bench.write(reg.STATUS, reg.CONTROL_POWER_ON)
    bench.wait(100_000)
    bench.write(reg.STATUS, reg.CONTROL_AMPS_ON)
    bench.wait(100)
    bench.write(reg.axis_register(1, reg.DAC), 0x8000_9000)
    assert bench.read(reg.axis_register(1, reg.ADC)) & 0xFFFF == 0x9000
    assert (bench.read(reg.axis_register(1, reg.ADC)) >> 16) * 4.5 / 65535 == pytest.approx(2.25, abs=1e-3)


def test_fast_pwm_on_the_test_board_costs_the_boards_little() -> None:
    bench = BenchOfTestboard(8)
    for high_low in (0x0001_0002, 0x000A_0005, 0x0064_0064):
        bench.write(reg.axis_register(0, reg.PWM), high_low)
        bench.pins(1)
        before = time.thread_time()
        for _ in range(100):
            bench.wait(1000)
            bench.bus.step(bench.tick)
        assert time.thread_time() - before < 0.1 * 10, "in CPU time, and generously: 0.1 s of simulated time"


def test_a_dqla_has_a_loop_back_board_on_each_of_its_qlas() -> None:
    bus = EmulatedBus((Controller(3, "DQLA", 8, "V3"),), testboard=True)
    tick = 0

    def read(address: int) -> int:
        response = board_side.decode_response(bus.answer(wire.quadlet_read(0, address, 1, 1), tick) or b"")
        assert isinstance(response, board_side.WireResponse)
        return response.value

    for register, inputs, moved in ((0xF0, 0x0000_0FFF, 4), (0x0F, 0x0FFF_0000, 0), (0x00, 0x0FFF_0FFF, 0)):
        tick += MS
        bus.answer(wire.quadlet_write(0, reg.DIGITAL_OUTPUT, 0xFF00 | register, 1, 1), tick)
        tick += MS
        assert read(reg.DIGITAL_INPUT) & 0x0FFF_0FFF == inputs
        assert bool(read(reg.axis_register(moved, reg.ENCODER)) & reg.ENCODER_PIN_A) == (moved == 0 and register == 0)


def test_each_half_of_a_dqla_has_its_own_encoders_currents_and_voltages() -> None:
    bus = EmulatedBus((Controller(0, "DQLA", 9, "V3"),), testboard=True)
    tick = 0

    def write(address: int, value: int) -> None:
        nonlocal tick
        tick += round(10 * US)
        bus.answer(wire.quadlet_write(0, address, value, 1, 1), tick)

    def read(address: int) -> int:
        response = board_side.decode_response(bus.answer(wire.quadlet_read(0, address, 1, 1), tick) or b"")
        assert isinstance(response, board_side.WireResponse)
        return response.value

    write(reg.WATCHDOG, 0)
    write(reg.STATUS, reg.CONTROL_POWER_ON)
    tick += 100 * MS
    write(reg.DIGITAL_OUTPUT, 0xFFFF)
    for axis in range(8):
        write(reg.axis_register(axis, reg.ENCODER_PRELOAD), reg.ENCODER_ZERO)
        write(reg.axis_register(axis, reg.DAC), reg.DAC_VALID | reg.DAC_AMP_MASK | reg.DAC_AMP_ENABLE | 0x8100 + axis)
    for pins in (1, 3, 2, 0) * 5:
        write(reg.DIGITAL_OUTPUT, 0xFF00 | ~pins << 4 & 0xF0 | 0x0F)  # those of the second QLA
    tick += MS
    moved = [(read(reg.axis_register(axis, reg.ENCODER)) & reg.ENCODER_MASK) - reg.ENCODER_ZERO for axis in range(8)]
    assert moved[:4] == [0] * 4 and set(moved[4:]) <= {18, 20}, "up to the lag after a reversal"
    analog = [read(reg.axis_register(axis, reg.ADC)) for axis in range(8)]
    assert [word & 0xFFFF for word in analog] == [0x8100 + axis for axis in range(8)]
    assert {word >> 16 for word in analog} == {0x8000}, "2.25 V"
