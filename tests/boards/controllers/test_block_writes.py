"""Real-time blocks of firmware Rev 7, 8 and 9: which words of them reach which register."""

from __future__ import annotations

import pytest

from tests.boards.harness import ENABLE, MASK, MS, ON, VALID, Desk, board
from tests.cases import cases
from trocar.procs.fpga import registers as reg
from trocar.procs.fpga import wire

ID_7 = 3 << reg.DAC_BOARD_SHIFT


def _commands(desk: Desk) -> list[int]:
    return [desk.axis(axis, reg.DAC) for axis in range(4)]


# -- Rev 7 -------------------------------------------------------------------------------------------------------------


def test_rev_7_reads_back_nothing_before_the_first_command_and_0x30_above_it_then() -> None:
    desk = Desk(board(7))
    assert _commands(desk) == [0] * 4
    desk.block(VALID | ID_7 | 0x8100, ID_7 | 0x8200, VALID | ID_7 | 0x7FFF, ID_7, 0)
    assert _commands(desk) == [0x0030_8100, 0, 0x0030_7FFF, 0], "words without valid bit are left out"
    assert [int(bits) for bits in desk.lines.dac[0]] == [0x8100, 0x8000, 0x7FFF, 0x8000]


def test_a_single_command_of_rev_7_needs_no_valid_bit_and_one_of_rev_8_does() -> None:
    for firmware, expected in ((7, 0x0030_9000), (8, 0x8000), (9, 0x8000)):
        desk = Desk(board(firmware))
        desk.dac(0, 0x9000)
        assert desk.axis(0, reg.DAC) == expected


@pytest.mark.parametrize("others", [(3, 3, 3, 2), (2, 2, 2, 2), (3, 3, 2, 3)])
def test_a_group_of_rev_7_is_taken_only_with_its_id_in_all_four_words(others: tuple[int, ...]) -> None:
    desk = Desk(board(7), watchdog=100)
    desk.tick += 20_000
    desk.block(*[VALID | board_id << 24 | 0x9000 for board_id in others], reg.CONTROL_POWER_ON)
    assert _commands(desk) == [0] * 4
    assert not desk.read() & reg.STATUS_POWER
    desk.tick += 10_000
    assert desk.read() & reg.STATUS_WATCHDOG, "and it does not refresh the watchdog"


@pytest.mark.parametrize("firmware", [7, 8])
def test_only_20_bits_of_a_control_word_leave_a_block_before_rev_9(firmware: int) -> None:
    desk = Desk(board(firmware))
    control = 0xFFF0_0000 | reg.CONTROL_POWER_ON
    if firmware == 7:
        desk.block(*[ID_7] * 4, control)
    else:
        desk.group(0, 0, 0, 0, control)
    assert desk.read() & 0x0034_0000 == 0x0034_0000, "power, and the outputs' hardware is not looked for"


def test_all_bits_of_a_control_word_leave_a_block_in_rev_9() -> None:
    desk = Desk(board(9))
    desk.group(0, 0, 0, 0, reg.CONTROL_DOUT_TEST | reg.CONTROL_POWER_ON)
    assert desk.read() & 0x0034_0000 == 0x0004_0000
    desk.tick += 5000
    assert desk.read() & 0x0034_0000 == 0x0034_0000


@pytest.mark.parametrize(("firmware", "reboots"), [(8, False), (9, True)])
def test_a_block_may_ask_for_a_reboot_in_rev_9(firmware: int, reboots: bool) -> None:
    desk = Desk(board(firmware))
    desk.group(VALID | 0x9000, 0, 0, 0, reg.CONTROL_REBOOT)
    asked = wire.quadlet_read(0, reg.FIRMWARE, 1, desk.bus.generation)
    assert (desk.bus.answer(asked, desk.tick) is None) == reboots
    generation = desk.bus.generation
    desk.tick += reg.CLOCK_HZ
    desk.bus.step(desk.tick)
    assert desk.bus.generation == generation + reboots
    assert _commands(desk)[0] == (0x8000 if reboots else 0x9000)


# -- Rev 8 and 9 -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("firmware", [8, 9])
def test_words_from_rev_8_on_command_with_the_valid_bit_and_mode_0(firmware: int) -> None:
    desk = Desk(board(firmware))
    desk.group(VALID | 0x8100, 0x8200, VALID | 1 << 24 | 0x8300, VALID | 0xF << 24 | 0x8400, 0)
    assert _commands(desk) == [0x8100, 0x8000, 0x8000, 0x8000]
    desk.group(VALID | 0xFFFF, VALID, 0, 0, 0)
    assert _commands(desk) == [0xFFFF, 0, 0x8000, 0x8000]


@cases("firmware", [8, 9])
@cases("word", [ON, MASK, ENABLE, 0, VALID | ON | 0x9000, VALID | MASK, VALID | 0x9000])
def test_enables_in_a_block_come_before_its_power(firmware: int, word: int) -> None:
    desk = Desk(board(firmware))
    desk.group(word, 0, 0, 0, reg.CONTROL_POWER_ON)
    assert desk.requests() == [False] * 4
    desk.group(word, 0, 0, 0, 0)
    assert desk.requests()[0] == (word & ON == ON)


@pytest.mark.parametrize("firmware", [8, 9])
def test_a_control_word_in_a_block_may_enable_and_power_together(firmware: int) -> None:
    desk = Desk(board(firmware))
    desk.group(0, 0, 0, 0, 0x000C_0F05)
    assert desk.requests() == [True, False, True, False]


def test_groups_too_short_come_to_nothing_in_rev_8_and_to_what_is_in_them_in_rev_9() -> None:
    for firmware, commands, power in ((8, [0x8000] * 4, False), (9, [0x9001, 0x9002, 0x8000, 0x8000], True)):
        desk = Desk(board(firmware))
        desk.group(VALID | 0x9001, VALID | 0x9002, reg.CONTROL_POWER_ON)
        assert _commands(desk) == commands
        assert bool(desk.read() & reg.STATUS_POWER) == power


def test_the_control_word_of_a_long_group_is_the_fifth_in_rev_8_and_the_last_in_rev_9() -> None:
    for firmware, status in ((8, reg.STATUS_POWER), (9, reg.STATUS_RELAY)):
        desk = Desk(board(firmware))
        desk.group(0, 0, 0, 0, reg.CONTROL_POWER_ON, reg.CONTROL_RELAY_ON)
        assert desk.read() & (reg.STATUS_POWER | reg.STATUS_RELAY) == status


def test_two_groups_for_one_board_are_executed_in_order() -> None:
    for firmware in (8, 9):
        desk = Desk(board(firmware), board(firmware, board_id=5))
        desk.block(0x306, *[VALID | 0x9000] * 4, reg.CONTROL_POWER_ON, 0x506, *[VALID | 0x9100] * 4, 0,
                   0x306, 0, VALID | ON | 0x9300, 0, 0, 0)
        assert _commands(desk) == [0x9000, 0x9300, 0x9000, 0x9000]
        assert desk.requests() == [False, True, False, False], "power was on when the second one came"
        assert desk.axis(0, reg.DAC, node=1) == 0x9100
    desk = Desk(board(7))
    desk.block(*[ID_7] * 4, reg.CONTROL_POWER_ON, *[ID_7] * 4, 0x0101)
    assert desk.requests() == [True, False, False, False]


def test_a_block_cut_off_within_a_group_commands_as_far_as_it_goes_in_rev_9() -> None:
    for firmware, first in ((8, 0x8000), (9, 0x9000)):
        desk = Desk(board(firmware), watchdog=100)
        desk.tick += 20_000
        desk.block(0x306, VALID | 0x9000, VALID | 0x9000)
        assert _commands(desk) == [first, first, 0x8000, 0x8000]
        desk.tick += 20_000
        assert bool(desk.read() & reg.STATUS_WATCHDOG) == (firmware == 8)


@pytest.mark.parametrize("away", [(), (2,), (1, 2)])
def test_a_running_hosts_block_does_what_single_groups_do(away: tuple[int, ...]) -> None:
    """The write of all boards at once is taken another way through the program, also while some are not there."""
    together, apart = (Desk(board(8, board_id=3), board(9, board_id=5), board(9, board_id=7)) for _ in range(2))
    for desk in (together, apart):
        for node in range(3):
            desk.write(reg.STATUS, reg.CONTROL_POWER_ON, node)
        for row in away:
            desk.bus.take_away(row, True)
    words = [VALID | ON | 0x8123, VALID | MASK | 0x8456, ON, VALID | ENABLE | 0x8789]
    for step in range(4):
        for desk in (together, apart):
            desk.tick += 60 * MS
        groups = ((0x306, *words, 0), (0x506, *reversed(words), 0x0002_0000), (0x706, *words, 0x0002_0000))
        for _ in range(2):  # the same again changes nothing
            together.block(*groups[0], *groups[1], *groups[2])
            for group in groups:
                apart.block(*group)
            for left, right in ((together.lines.dac, apart.lines.dac), (together.power.on, apart.power.on),
                                (together.power.enabled, apart.power.enabled)):
                assert left.tolist() == right.tolist()
        for row in away:
            assert not together.power.on[row].any() and (together.lines.dac[row] == 0x8000).all()
        words[step] ^= VALID | MASK | 0x11


def test_boards_of_two_firmwares_take_what_is_theirs_out_of_one_block() -> None:
    desk = Desk(board(7, board_id=2), board(8, board_id=5))
    desk.block(*[VALID | 2 << 24 | 0x9000] * 4, 0)
    assert desk.axis(0, reg.DAC, node=0) == 0x0030_9000
    assert desk.axis(0, reg.DAC, node=1) == 0x8000
