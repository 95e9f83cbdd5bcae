"""Watchdog, power and enables of a QLA with firmware Rev 7, 8 and 9: what differs, and what does not."""

from __future__ import annotations

import pytest

from tests.boards.harness import ENABLE, MASK, MS, ON, VALID, Desk, board
from tests.cases import cases
from trocar.procs.boards.controllers import power
from trocar.procs.document.system import Quirks
from trocar.procs.fpga import registers as reg

ALL = (7, 8, 9)
POWER_AND_AMPS = reg.CONTROL_POWER_ON | reg.CONTROL_AMPS_ON


def _on(firmware: int) -> Desk:
    """Power and amplifiers are on."""
    desk = Desk(board(firmware))
    desk.write(reg.STATUS, reg.CONTROL_POWER_ON)
    desk.write(reg.STATUS, reg.CONTROL_AMPS_ON)
    desk.tick += 61 * MS
    assert desk.on() == [True] * 4
    return desk


# -- watchdog ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("firmware", [8, 9])
def test_the_watchdog_counts_from_the_write_itself(firmware: int) -> None:
    desk = Desk(board(firmware))
    for desk.tick in (1000, 70_001):
        desk.write(reg.WATCHDOG, 2)
        desk.write(reg.STATUS, reg.CONTROL_POWER_ON)
        began = desk.tick
        desk.tick = began + 512
        assert not desk.read() & reg.STATUS_WATCHDOG
        desk.tick = began + 513
        assert desk.read() & reg.STATUS_WATCHDOG


@pytest.mark.parametrize("began", [1000, 1024, 1153, 1154, 5000])
def test_the_watchdog_of_rev_7_counts_edges_of_a_clock_that_runs_on(began: int) -> None:
    desk = Desk(board(7))
    desk.tick = began
    desk.write(reg.WATCHDOG, 2)
    fires = next(tick for tick in range(began + 513, began + 769) if tick % 256 == 129)
    desk.tick = fires - 1
    assert not desk.read() & reg.STATUS_WATCHDOG
    desk.tick = fires
    assert desk.read() & reg.STATUS_WATCHDOG
    assert int(desk.power.watchdog_tick[0]) == fires


@pytest.mark.parametrize("firmware", ALL)
def test_the_watchdog_has_fired_before_anybody_writes(firmware: int) -> None:
    desk = Desk(board(firmware), watchdog=None)
    desk.tick = 29 * MS
    assert desk.read() == 0x4330_0000
    desk.tick = 31 * MS
    assert desk.read() == 0x43B0_0000


@cases("firmware", ALL)
@cases(("address", "value", "clears"), [
    (0x00, reg.CONTROL_POWER_ON, ALL), (0x00, 0x0101, ALL), (0x00, 0x0808, ALL), (0x00, reg.CONTROL_POWER_OFF, ()),
    (0x00, 0x0004_0000, ()), (0x00, 0x0F00, ()), (0x00, 0x000F, ()), (0x00, 0, ()), (0x00, reg.CONTROL_RELAY_ON, ()),
    (0x11, ON, (8, 9)), (0x41, VALID | ON, (8, 9)), (0x11, MASK, ()), (0x11, ENABLE, ()), (0x11, VALID | 0x8000, ()),
    (0x03, 0, ()), (0x06, 0xF0F, ()), (0x14, 0x800000, ()),
])
def test_only_commands_that_switch_on_clear_the_watchdog(firmware: int, address: int, value: int,
                                                         clears: tuple[int, ...]) -> None:
    desk = Desk(board(firmware), watchdog=2)
    desk.tick += 2000
    desk.write(address, value)
    assert bool(desk.read() & reg.STATUS_WATCHDOG) == (firmware not in clears)


@pytest.mark.parametrize("firmware", ALL)
def test_the_watchdog_cuts_requests_and_leaves_power_relay_and_commands(firmware: int) -> None:
    desk = _on(firmware)
    desk.write(reg.STATUS, reg.CONTROL_RELAY_ON)
    desk.dac(0, VALID | 0x9000)
    desk.write(reg.WATCHDOG, 0x1680)
    desk.tick += 100 * MS
    assert desk.read() & 0x008F_0F0F == 0x008F_0000
    assert desk.axis(0, reg.DAC) & 0xFFFF == 0x9000
    assert desk.requests() == [False] * 4


# -- enables -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("firmware", "requested"), [(7, False), (8, True), (9, True)])
def test_one_control_word_for_power_and_amplifiers_is_enough_from_rev_8_on(firmware: int, requested: bool) -> None:
    desk = Desk(board(firmware))
    desk.write(reg.STATUS, POWER_AND_AMPS)
    assert desk.requests() == [requested] * 4
    desk.write(reg.STATUS, POWER_AND_AMPS)
    assert desk.requests() == [True] * 4
    desk.tick += 61 * MS
    assert desk.read() & 0x000C_0F0F == 0x000C_0F0F


def test_requests_of_rev_7_outlive_the_power_until_the_next_control_write() -> None:
    desk = _on(7)
    desk.write(reg.STATUS, reg.CONTROL_POWER_OFF)
    assert desk.read() & 0x000C_0F0F == 0x0000_000F
    desk.dac(0, 0x9000)
    desk.block(*[VALID | 3 << 24 | 0x8000] * 4, 0)
    assert desk.read() & 0xF == 0xF, "a control word of 0 beside command words is not executed"
    desk.block(*[3 << 24] * 4, 0)
    assert desk.read() & 0xF == 0, "without any it is"


@pytest.mark.parametrize("firmware", [8, 9])
def test_requests_go_with_the_power_from_rev_8_on(firmware: int) -> None:
    desk = _on(firmware)
    desk.write(reg.STATUS, reg.CONTROL_POWER_OFF)
    assert desk.read() & 0x000C_0F0F == 0
    assert desk.requests() == [False] * 4


@pytest.mark.parametrize(("firmware", "quirks", "low"), [
    (7, Quirks(), 0xF), (8, Quirks(), 0), (9, Quirks(), 0),
    (7, Quirks(repeated_amp_bits=False), 0xF), (8, Quirks(repeated_amp_bits=False), 0xF),
])
def test_the_lowest_status_bits_are_requests_or_the_feedback_again(firmware: int, quirks: Quirks, low: int) -> None:
    desk = Desk(board(firmware, quirks=quirks))
    desk.write(reg.STATUS, reg.CONTROL_POWER_ON)
    desk.write(reg.STATUS, reg.CONTROL_AMPS_ON)
    assert desk.read() & 0xF0F == low, "requested, and still held off"
    desk.tick += 61 * MS
    desk.power.fail_amplifier(0, 1, True, desk.tick)
    assert desk.read() & 0xF0F == 0xD00 | (0xF if low else 0xD)


@cases("firmware", ALL)
@cases("power_requested", [False, True])
@cases("word", [0x0000, 0x0100, 0x0001, 0x0101])
@cases("before", [False, True])
def test_an_enable_changes_with_its_mask_bit_and_never_without_power(firmware: int, power_requested: bool, word: int,
                                                                     before: bool) -> None:
    desk = _on(firmware) if before else Desk(board(firmware))
    desk.write(reg.STATUS, reg.CONTROL_POWER_ON if power_requested else reg.CONTROL_POWER_OFF)
    desk.write(reg.STATUS, word)
    wanted = word == 0x0101 if word & 0x100 else before
    assert desk.requests()[0] == (wanted and power_requested)


@pytest.mark.parametrize("firmware", ALL)
def test_enables_in_command_words_are_of_rev_8_and_9(firmware: int) -> None:
    desk = Desk(board(firmware))
    desk.write(reg.STATUS, reg.CONTROL_POWER_ON)
    desk.dac(1, ON)
    assert desk.requests() == [False, firmware > 7, False, False]
    desk.dac(1, MASK)
    assert desk.requests() == [False] * 4


# -- the hold-off ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("firmware", [8, 9])
def test_amplifiers_are_held_off_for_7680_counts(firmware: int) -> None:
    desk = Desk(board(firmware))
    desk.write(reg.STATUS, POWER_AND_AMPS)
    desk.tick = power.SUPPLY_RAMP + 7680 * 256 - 1
    assert desk.read() & 0x0008_0F00 == 0x0008_0000
    desk.tick += 1
    assert desk.read() & 0x0008_0F00 == 0x0008_0F00


def test_the_hold_off_of_rev_7_counts_edges_of_its_clock() -> None:
    desk = Desk(board(7))
    desk.tick = 777
    desk.write(reg.STATUS, reg.CONTROL_POWER_ON)
    desk.write(reg.STATUS, reg.CONTROL_AMPS_ON)
    good = 777 + power.SUPPLY_RAMP
    edge = next(tick for tick in range(good, good + 256) if tick % 256 == 129)
    desk.tick = edge + 7680 * 256 - 1
    assert desk.read() & 0xF00 == 0
    desk.tick += 1
    assert desk.read() & 0xF00 == 0xF00


# -- the current check -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("firmware", ALL)
def test_too_much_current_trips_between_2457590_and_30_ticks_later(firmware: int) -> None:
    desk = _on(firmware)
    desk.dac(0, VALID | 0x9000)
    desk.lines.adc[0, 0] = 0xA000
    began = desk.tick
    desk.hold(40)
    desk.tick = began + 2_457_590
    assert not desk.read() & 0xF0
    desk.tick = began + 2_457_620
    assert desk.read() & 0x0FF0 == 0x0E10


def test_enabling_against_a_current_that_is_still_too_much_trips_at_once() -> None:
    desk = _on(8)
    desk.lines.adc[0, 0] = 0xA000
    desk.hold(60)
    assert desk.read() & 0x0FF0 == 0x0E10
    desk.dac(0, ON)
    assert desk.read() & 0x0FF0 == 0x0F00, "cleared and on"
    desk.tick += 1
    assert desk.read() & 0x0FF0 == 0x0E10, "for a tick: the counter is still full"
    desk.lines.adc[0, 0] = 0x8000
    desk.hold(1)
    desk.dac(0, ON)
    desk.hold(60)
    assert desk.read() & 0x0FF0 == 0x0F00


def test_the_counter_of_too_much_current_begins_anew_when_it_is_full() -> None:
    desk = _on(8)
    desk.lines.adc[0, 0] = 0xA000
    desk.hold(1)
    over_since = desk.tick - MS
    desk.tick = over_since + (1 << 24) + 10  # 24 bits
    desk.dac(0, ON)
    desk.tick += MS
    assert not desk.read() & 0xF0
    desk.tick = over_since + (1 << 24) + 2_457_600
    assert desk.read() & 0xF0


def test_rev_7_checks_no_axis_before_its_first_command() -> None:
    desk = _on(7)
    desk.lines.adc[0, :2] = 0xA000
    desk.dac(1, 0x8000)
    desk.hold(60)
    assert desk.read() & 0xFF0 == 0xD20


# -- found out anew ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("firmware", ALL)
def test_the_kind_of_outputs_is_found_out_anew_in_4098_ticks(firmware: int) -> None:
    desk = Desk(board(firmware))
    desk.tick = 1000
    desk.write(reg.STATUS, reg.CONTROL_DOUT_TEST)
    assert desk.read() & 0x0030_0000 == 0
    desk.tick += 4097
    assert desk.read() & 0x0030_0000 == 0
    desk.tick += 1
    assert desk.read() & 0x0030_0000 == 0x0030_0000


@pytest.mark.parametrize("firmware", ALL)
def test_rev_7_has_neither_motor_status_nor_motor_configuration(firmware: int) -> None:
    desk = Desk(board(firmware))
    desk.write(reg.axis_register(2, reg.MOTOR_CONFIG), 0xC000_0000)
    assert bool(desk.axis(2, reg.MOTOR_CONFIG)) == bool(desk.axis(2, reg.MOTOR_STATUS)) == (firmware > 7)


def test_a_relay_falls_off_sooner_than_it_closes() -> None:
    desk = Desk()
    desk.write(reg.STATUS, reg.CONTROL_RELAY_ON)
    desk.tick += power.RELAY_TRAVEL
    assert desk.read() & 0x0003_0000 == 0x0003_0000
    desk.write(reg.STATUS, reg.CONTROL_RELAY_OFF)
    assert desk.read() & 0x0003_0000 == reg.STATUS_RELAY_FEEDBACK
    desk.tick += MS
    assert desk.read() & 0x0003_0000 == 0, "the original test looks no later"
