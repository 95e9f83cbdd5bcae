"""QLA from 1.5 on: I/O expander, safety line, motor supply comparator, voltage mode, delayed enables."""

from __future__ import annotations

import pytest

from tests.boards.harness import MASK, MS, ON, VALID, Desk, board
from tests.cases import cases
from trocar.procs.boards.controllers import power
from trocar.procs.boards.controllers.motors import COMPARATOR_VOLTS, SUPPLY_VOLTS, WINDING_OHMS
from trocar.procs.fpga import registers as reg

VOLTAGE = 1 << 24
CONFIG = reg.axis_register(0, reg.MOTOR_CONFIG)
PRESENT = 0x0040_5000  # quad DAC, voltage on the safety line, expander


def _desk(firmware: int = 8) -> Desk:
    return Desk(board(firmware, qla="1.5"))


def _on(firmware: int = 8) -> Desk:
    desk = _desk(firmware)
    desk.write(reg.STATUS, reg.CONTROL_POWER_ON | reg.CONTROL_AMPS_ON)
    desk.tick += 70 * MS
    assert desk.on() == [True] * 4
    return desk


def _bits(volts: float) -> int:
    """As the original library makes a voltage command."""
    return int((volts + 45.5) * 65535 / 91 + 0.5)


@pytest.mark.parametrize("firmware", [8, 9])
def test_an_expander_shows_in_status_and_motor_configuration(firmware: int) -> None:
    desk = _desk(firmware)
    assert desk.read() & 0x0040_7000 == PRESENT
    assert desk.read(CONFIG) == 0x0378_0418
    plain = Desk(board(firmware))
    assert plain.read() & 0x0040_7000 == 0
    assert plain.read(CONFIG) == 0x0178_0418
    assert Desk(board(7, qla="1.5")).read() & 0x0040_7000 == 0, "Rev 7 does not know of it"


def test_no_voltage_on_the_safety_line_of_an_open_chain() -> None:
    desk = _desk()
    desk.power.open_chain(0, True, desk.tick)
    assert desk.read() & 0x7000 == 0x1000
    desk.power.open_chain(0, False, desk.tick)
    assert desk.read() & 0x7000 == 0x5000


def test_the_expander_is_found_again_80_ticks_after_it_was_asked_for() -> None:
    desk = _desk()
    desk.tick = 500
    desk.write(reg.STATUS, reg.CONTROL_EXPANDER_TEST)
    desk.tick += 79
    assert (desk.read() & 0x1000, desk.read(CONFIG)) == (0, 0x0178_0418)
    desk.tick += 1
    assert (desk.read() & 0x1000, desk.read(CONFIG)) == (0x1000, 0x0378_0418)


def test_repeating_the_test_of_the_dac_changes_nothing() -> None:
    desk = _desk()
    before = desk.read()
    desk.write(reg.STATUS, 1 << 22)
    assert desk.read() == before


# -- the comparator ----------------------------------------------------------------------------------------------------


def test_the_motor_supply_is_measured_by_the_last_dac() -> None:
    """The way of the original test program: up until the comparator tips, then in ever smaller steps."""
    desk = _desk()
    desk.write(reg.STATUS, reg.CONTROL_POWER_ON)
    desk.tick += power.SUPPLY_RAMP
    bits, step = 0, 0x1000
    while step:
        desk.dac(3, VALID | bits)
        if desk.read(reg.DIGITAL_INPUT) & reg.INPUT_MOTOR_SUPPLY:
            bits += step
        else:
            bits -= step
            step >>= 1
            bits += step
    assert bits * COMPARATOR_VOLTS / 65535 == pytest.approx(SUPPLY_VOLTS, abs=0.002)


def test_without_motor_power_no_dac_is_below_the_supply() -> None:
    desk = _desk()
    desk.dac(3, VALID)
    assert not desk.read(reg.DIGITAL_INPUT) & reg.INPUT_MOTOR_SUPPLY
    plain = Desk(board())
    plain.write(reg.STATUS, reg.CONTROL_POWER_ON)
    plain.tick += power.SUPPLY_RAMP
    plain.dac(3, VALID)
    assert not plain.read(reg.DIGITAL_INPUT) & reg.INPUT_MOTOR_SUPPLY


# -- delayed enables ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("began", [0, 511, 513, 514, 9000])
def test_enables_are_delayed_by_120_edges_of_48_khz(began: int) -> None:
    desk = _desk()
    desk.write(reg.STATUS, reg.CONTROL_POWER_ON)
    desk.tick = 100 * MS // 1024 * 1024 + began
    desk.dac(0, ON)
    last = desk.tick - (desk.tick - 513) % 1024
    desk.tick = last + 120 * 1024 - 1
    assert desk.motor() & 0x3001_0000 == reg.MOTOR_STATUS_AMP_REQUESTED | reg.MOTOR_STATUS_AMP_FAULT
    desk.tick += 1
    assert desk.motor() & 0x3001_0000 == reg.MOTOR_STATUS_AMP_REQUESTED | reg.MOTOR_STATUS_AMP_ON


def test_the_delay_begins_when_the_hold_off_ends_and_again_with_every_enable() -> None:
    desk = _desk()
    desk.write(reg.STATUS, reg.CONTROL_POWER_ON | reg.CONTROL_AMPS_ON)
    desk.tick = power.SUPPLY_RAMP + power.AMP_HOLD + 119 * 1024
    assert desk.read() & 0xF00 == 0
    desk.tick += 1024
    assert desk.read() & 0xF00 == 0xF00
    desk.dac(0, MASK)
    desk.dac(0, ON)
    assert desk.read() & 0xF00 == 0xE00


def test_the_delay_may_be_set_and_a_change_while_on_counts_on_round_its_end() -> None:
    desk = _on()
    desk.write(CONFIG, 1 << 25 | 0 << 16)
    assert desk.read(CONFIG) == 0x0300_0418
    assert desk.read() & 0x100 == 0, "from 120 on to 256"
    desk.tick += 137 * 1024
    assert desk.read() & 0x100 == 0x100
    desk.dac(0, MASK)
    desk.dac(0, ON)
    assert desk.read() & 0x100 == 0x100, "no delay any more"
    desk.write(CONFIG, 1 << 25 | 10 << 16)
    assert desk.read() & 0x100 == 0
    desk.tick += 10 * 1024
    assert desk.read() & 0x100 == 0x100
    desk.write(CONFIG, 255 << 16)
    assert desk.read(CONFIG) == 0x030A_0418, "without the set bit the delay stays"


def test_a_qla_without_expander_has_no_delay() -> None:
    desk = Desk(board())
    desk.write(reg.STATUS, reg.CONTROL_POWER_ON)
    desk.tick += 70 * MS
    desk.dac(0, ON)
    assert desk.read() & 0x100


# -- voltage mode ------------------------------------------------------------------------------------------------------


def test_a_voltage_command_drives_what_its_winding_lets_through() -> None:
    desk = _on()
    desk.dac(0, VALID | VOLTAGE | _bits(5.0))
    assert desk.motor() == 0x3100_0000 | _bits(5.0), "mode 1, no current control, the command"
    assert desk.axis(0, reg.DAC) == _bits(5.0)
    amperes = (int(desk.lines.dac[0, 0]) - 0x8000) / reg.CURRENT_BITS_PER_A
    assert amperes == pytest.approx(5.0 / WINDING_OHMS, abs=0.001)
    desk.group(VALID | VOLTAGE | _bits(-2.5), VALID | 0x9000, 0, 0, 0)
    amperes = (int(desk.lines.dac[0, 0]) - 0x8000) / reg.CURRENT_BITS_PER_A
    assert amperes == pytest.approx(-2.5 / WINDING_OHMS, abs=0.001)
    assert int(desk.lines.dac[0, 1]) == 0x9000
    desk.group(VALID | 0x8100, 0, 0, 0, 0)
    assert (desk.motor(), int(desk.lines.dac[0, 0])) == (0x3010_8100, 0x8100)


def test_voltages_beyond_what_an_amplifier_drives_end_at_full_current() -> None:
    desk = _on()
    desk.dac(0, VALID | VOLTAGE | 0xFFFF)
    desk.dac(1, VALID | VOLTAGE)
    assert [int(bits) for bits in desk.lines.dac[0, :2]] == [0xFFFF, 0]


@cases("mode", range(2, 16))
def test_other_modes_are_ignored_with_their_value(mode: int) -> None:
    desk = _on()
    desk.dac(0, VALID | ON | mode << 24 | 0x9000)
    assert desk.motor() == 0x3010_8000


def test_without_expander_a_voltage_is_ignored() -> None:
    desk = Desk(board())
    desk.dac(0, VALID | VOLTAGE | 0x9000)
    assert desk.motor() == 0x0010_8000


@pytest.mark.parametrize(("measured", "trips"), [(0x8418, False), (0x8419, True), (0x7BE8, False), (0x7BE7, True)])
def test_in_voltage_mode_the_current_limit_counts(measured: int, trips: bool) -> None:
    desk = _on()
    desk.dac(0, VALID | VOLTAGE | _bits(1.0))
    desk.lines.adc[0, 0] = measured
    desk.hold(49)
    assert not desk.read() & 0xF0
    desk.hold(2)
    assert bool(desk.read() & 0x10) == trips


def test_the_current_limit_may_be_set_and_counts_even_where_nothing_else_is_checked() -> None:
    desk = _on()
    desk.write(CONFIG, reg.MOTOR_CONFIG_NO_SAFETY_CHECK | 1 << 24 | 0xA000)
    assert desk.read(CONFIG) == 0x8378_2000, "bit 15 of a limit is no part of it"
    desk.dac(0, VALID | VOLTAGE | _bits(1.0))
    desk.lines.adc[0, 0] = 0x8000 + 0x2000
    desk.hold(60)
    assert not desk.read() & 0xF0
    desk.lines.adc[0, 0] += 1
    desk.hold(60)
    assert desk.read() & 0xF0 == 0x10
    desk.lines.adc[0, 0] = 0x8000
    desk.hold(1)
    desk.dac(0, ON | VALID | 0x8000)
    desk.lines.adc[0, 0] = 0xB000
    desk.hold(60)
    assert not desk.read() & 0xF0, "back in current mode it is not checked"


def test_power_up_brings_back_current_mode_and_the_delay() -> None:
    desk = _on()
    desk.dac(0, VALID | VOLTAGE | 0x9000)
    desk.write(CONFIG, 0xC000_0000 | 3 << 24 | 5 << 16 | 0x123)
    assert desk.read(CONFIG) == 0xC305_0123
    desk.bus.take_away(0, True)
    desk.bus.take_away(0, False)
    assert (desk.read(CONFIG), desk.motor()) == (0x0378_0418, 0x0010_8000)
    assert int(desk.lines.dac[0, 0]) == 0x8000


# -- register 0x0E -----------------------------------------------------------------------------------------------------


def test_the_expanders_memory_is_written_and_read_as_the_original_test_does() -> None:
    desk = _desk()
    assert desk.read(reg.IO_EXPANDER) == 0, "not addressed yet"
    for data in (0x45, 0x00, 0xFF):
        desk.write(reg.IO_EXPANDER, 0x1300 | data)
        desk.write(reg.IO_EXPANDER, 0x9300)
        assert desk.read(reg.IO_EXPANDER) == 0x4000_9300 | data
    desk.write(reg.IO_EXPANDER, 0x0001_9300)
    assert desk.read(reg.IO_EXPANDER) == 0, "another chip, which a QLA does not have"


def test_the_expanders_ports_show_disabled_followers_current_control_and_the_safety_line() -> None:
    desk = _on()

    def ports(command: int) -> int:
        desk.write(reg.IO_EXPANDER, command)
        return desk.read(reg.IO_EXPANDER) & 0xFF

    assert ports(0x8E00) == 0x0F
    desk.dac(0, VALID | VOLTAGE | 0x8000)
    desk.dac(3, MASK)
    assert ports(0x8E00) == 0x17, "axis 1 on top"
    desk.write(reg.axis_register(3, reg.MOTOR_CONFIG), 1 << 30)
    assert ports(0x8E00) == 0x07, "the follower is never disabled"
    assert ports(0x8F00) == 0, "voltage on the safety line; the last DAC in mid-range is above the supply"
    desk.power.open_chain(0, True, desk.tick)
    assert ports(0x8F00) == 1
    desk.write(reg.IO_EXPANDER, 0x4000_0000)
    assert desk.read(reg.IO_EXPANDER) == 0xE7E7, "read back and wanted: without the supply all but the forced one"


def test_an_expander_that_is_not_there_never_answers() -> None:
    desk = Desk(board())
    desk.write(reg.IO_EXPANDER, 0x9300)
    assert desk.read(reg.IO_EXPANDER) == 0x4800_0000
    old = Desk(board(7))
    old.write(reg.IO_EXPANDER, 0x9300)
    assert old.read(reg.IO_EXPANDER) == 0
