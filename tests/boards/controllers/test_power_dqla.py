"""DQLA: two QLAs with eight axes behind one set of registers."""

from __future__ import annotations

import pytest

from tests.boards.harness import COLLECT, MASK, MS, ON, VALID, Desk, board
from trocar.procs.boards.controllers import power
from trocar.procs.fpga import registers as reg

PLAIN = 0x8300_3F00  # 8 axes, board 3; its own expanders, outputs known and bidirectional
POWERED = 0x000C_C000  # both supplies good, their sum, and wanted


def _desk(firmware: int = 8, qla: str = "1.4") -> Desk:
    return Desk(board(firmware, "DQLA", qla=qla))


def _on(firmware: int = 8) -> Desk:
    desk = _desk(firmware)
    desk.write(reg.STATUS, reg.CONTROL_POWER_ON)
    desk.group(*[ON] * 8, 0)
    desk.tick += 60 * MS
    assert desk.on() == [True] * 8
    return desk


@pytest.mark.parametrize("firmware", [8, 9])
def test_status_has_a_bit_for_each_qla_and_none_for_an_axis(firmware: int) -> None:
    assert _on(firmware).read() == PLAIN | POWERED
    desk = Desk(board(firmware, "DQLA"), watchdog=None)
    assert desk.read() == PLAIN
    desk.tick = 31 * MS
    assert desk.read() == PLAIN | reg.STATUS_WATCHDOG
    desk.write(reg.STATUS, reg.CONTROL_RELAY_ON)
    desk.tick += power.RELAY_TRAVEL
    assert desk.read() == PLAIN | reg.STATUS_WATCHDOG | reg.STATUS_RELAY, "and no feedback of the relay"


def test_expanders_show_for_both_qlas() -> None:
    desk = _desk(qla="1.5")
    assert desk.read() == PLAIN | 0x0060_00C3
    assert desk.axis(7, reg.MOTOR_CONFIG) == 0x0378_0418
    desk.write(reg.STATUS, reg.CONTROL_EXPANDER_TEST | reg.CONTROL_DOUT_TEST)
    assert desk.read() == PLAIN & ~0xF00 | 0x0060_00C0
    desk.tick += 5000
    assert desk.read() == PLAIN | 0x0060_00C3
    desk.power.open_chain(0, True, desk.tick)
    assert desk.read() == PLAIN | 0x0060_0003
    desk.power.open_chain(0, False, desk.tick)
    desk.write(reg.STATUS, reg.CONTROL_POWER_ON)
    desk.tick += power.SUPPLY_RAMP
    for axis, bits in ((3, 0x8000), (7, 0x1000)):
        desk.dac(axis, VALID | bits)
    assert desk.read() & 0x30 == 0x20, "only the second one's DAC is below its supply"
    assert not desk.read(reg.DIGITAL_INPUT) & reg.INPUT_MOTOR_SUPPLY


def test_axis_bits_of_a_control_word_mean_nothing() -> None:
    desk = _desk()
    desk.write(reg.STATUS, reg.CONTROL_POWER_ON | 0xFFFF)
    assert desk.requests() == [False] * 8
    desk.dac(7, ON)
    desk.dac(4, ON)
    desk.write(reg.STATUS, 0x0F00)
    assert desk.requests() == [False] * 4 + [True, False, False, True]
    desk.dac(4, MASK)
    assert desk.requests() == [False] * 7 + [True]


def test_requests_outlive_the_power_until_a_command_word() -> None:
    for firmware in (8, 9):
        desk = _on(firmware)
        desk.write(reg.STATUS, reg.CONTROL_POWER_OFF)
        assert (desk.on(), desk.requests()) == ([False] * 8, [True] * 8)
        assert desk.motor(5) & 0x3001_0000 == reg.MOTOR_STATUS_AMP_REQUESTED
        desk.write(reg.STATUS, reg.CONTROL_POWER_ON)
        desk.tick += 60 * MS
        assert desk.on() == [True] * 8, "and so they come back with it"
        desk.write(reg.STATUS, reg.CONTROL_POWER_OFF)
        desk.dac(2, 0)
        assert desk.requests() == [True, True, False, *[True] * 5]
        desk.group(*[0] * 8, 0)
        assert any(desk.requests()) == (firmware == 8), "Rev 8 writes no words without valid or mask bit"
        desk.group(VALID | 0x8000, *[0] * 7, 0)
        assert not any(desk.requests())


def test_the_watchdog_cuts_all_eight_and_any_enable_clears_it() -> None:
    desk = _on()
    desk.write(reg.WATCHDOG, 2)
    desk.tick += 1000
    assert desk.read() & reg.STATUS_WATCHDOG
    assert desk.requests() == [False] * 8
    desk.write(reg.STATUS, 0x0101)
    assert desk.read() & reg.STATUS_WATCHDOG, "no enable on a DQLA"
    desk.write(reg.WATCHDOG, 0)
    desk.dac(6, ON)
    assert not desk.read() & reg.STATUS_WATCHDOG
    assert desk.on() == [False] * 6 + [True, False]


def test_the_current_check_is_that_of_a_qla_on_every_axis() -> None:
    desk = _on()
    desk.dac(6, VALID | 0x9000)
    desk.lines.adc[0, 6] = 0xA000
    desk.hold(51)
    assert desk.on() == [True] * 6 + [False, True]
    assert desk.motor(6) == 0x0012_9000
    desk.write(reg.STATUS, reg.CONTROL_POWER_ON)
    desk.lines.adc[0, 6] = 0x8000
    desk.hold(1)
    assert desk.motor(6) == 0x0010_9000


def test_inputs_are_those_of_both_qlas_without_encoder_lines() -> None:
    desk = _desk()
    desk.lines.inputs[0] = 0x0ABC_0DEF
    assert desk.read(reg.DIGITAL_INPUT) == 0x0ABC_0DEF
    desk.write(reg.DIGITAL_OUTPUT, 0xFF << 8 | 0x95)
    assert desk.read(reg.DIGITAL_INPUT) == 0x9ABC_5DEF
    assert desk.real_time()[2] == 0x9ABC_5DEF


def test_a_waveform_being_played_shows_in_the_status() -> None:
    desk = _desk()
    desk.write(0x8000, 1 << 31 | 1000 << 8 | 3)
    desk.write(reg.DIGITAL_OUTPUT, 1 << 31 | 0xF00)
    assert desk.read() & 0xF == 0x8
    desk.tick += 5000
    assert desk.read() & 0xF == 0


def test_temperatures_of_both_qlas_stand_where_others_have_the_state_of_the_collection() -> None:
    desk = _desk()
    desk.bus.firmware.set_temperatures(0, 0x4142)
    desk.dac(1, VALID | COLLECT | 0x8000)
    assert desk.read(reg.TEMPERATURE) == desk.real_time()[3] == 0x4142_4142
    assert desk.read(reg.DATA_BUFFER_STATUS) == 0, "there is no collection"


def test_its_real_time_block_has_60_quadlets() -> None:
    desk = _on()
    desk.group(*[VALID | 0x8001 + axis for axis in range(8)], 0)
    quads = desk.real_time()
    assert len(quads) == 60
    assert [quad & 0xFFFF for quad in quads[52:]] == list(range(0x8001, 0x8009))
    assert {quad >> 16 for quad in quads[52:]} == {0x3010}


def test_chips_behind_the_expander_register_are_told_apart_by_number() -> None:
    desk = _desk(qla="1.5")
    for chip, command, answer in ((1, 0x9300, 0x4000_9300), (2, 0x1377, 0x4000_0000), (2, 0x9300, 0x4000_9377),
                                  (3, 0x8900, 0x4000_89FF), (4, 0x8C00, 0x4000_8CFD), (4, 0x8400, 0x4000_8401)):
        desk.write(reg.IO_EXPANDER, chip << 16 | command)
        assert desk.read(reg.IO_EXPANDER) == answer
    desk.write(reg.IO_EXPANDER, 0x9300)
    assert desk.read(reg.IO_EXPANDER) == 0, "0 is that of a single QLA"
    desk.write(reg.IO_EXPANDER, 0x4001_0000)
    assert desk.read(reg.IO_EXPANDER) == 0, "a debug word does not say whose it is"
