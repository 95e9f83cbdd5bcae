"""Collection of motor currents, begun, fed and ended by motor command words."""

from __future__ import annotations

import pytest

from tests.boards.harness import COLLECT, MASK, MS, VALID, Desk, board
from trocar.procs.boards.devices.collection import COLLECTING, MEASURED
from trocar.procs.fpga import registers as reg

ALL = (7, 8, 9)


def _block(desk: Desk, firmware: int, words: list[int]) -> None:
    """A real-time block as the host of that firmware writes it."""
    if firmware == 7:
        desk.block(*[word | 3 << reg.DAC_BOARD_SHIFT for word in words], 0)
    else:
        desk.group(*words, 0)


def _entries(desk: Desk, count: int) -> list[int]:
    return [desk.read(reg.DATA_BUFFER + k) for k in range(count)]


@pytest.mark.parametrize("firmware", ALL)
def test_the_state_shows_channel_1_before_anything_was_collected(firmware: int) -> None:
    desk = Desk(board(firmware))
    assert desk.read(reg.DATA_BUFFER_STATUS) == 0x0400
    assert desk.real_time()[3] >> 16 == 0x0400


@pytest.mark.parametrize("firmware", ALL)
def test_commands_of_a_block_with_the_bit_are_collected_until_one_without(firmware: int) -> None:
    desk = Desk(board(firmware))
    desk.tick = 100_000
    desk.real_time()
    desk.tick += 1000
    plain, collected = [VALID | 0x8000] * 4, [VALID | 0x8000] * 4
    collected[2] = VALID | COLLECT | 0x9123
    _block(desk, firmware, plain)
    assert desk.read(reg.DATA_BUFFER_STATUS) == 0x0400
    _block(desk, firmware, collected)
    assert desk.read(reg.DATA_BUFFER_STATUS) == COLLECTING | 3 << 10
    stamp = 101_000 if firmware == 9 else 999
    assert _entries(desk, 1) == [(stamp > 0x3FFF) << 30 | (stamp & 0x3FFF) << 16 | 0x9123]
    desk.tick += 50
    _block(desk, firmware, plain)
    status = desk.read(reg.DATA_BUFFER_STATUS)
    assert status & COLLECTING == 0
    desk.tick += MS
    assert desk.read(reg.DATA_BUFFER_STATUS) == status


@pytest.mark.parametrize("firmware", ALL)
def test_a_single_command_word_begins_and_ends_it_too(firmware: int) -> None:
    desk = Desk(board(firmware))
    desk.tick = 1000
    desk.dac(3, VALID | COLLECT | 0x8001)
    assert desk.read(reg.DATA_BUFFER_STATUS) >> 10 == 0x20 | 4
    desk.dac(0, VALID | 0x8000)
    assert desk.read(reg.DATA_BUFFER_STATUS) & COLLECTING, "another axis' word does not end it"
    desk.dac(3, VALID | 0x8001)
    assert not desk.read(reg.DATA_BUFFER_STATUS) & COLLECTING


def test_measured_currents_are_entered_as_the_physics_makes_them() -> None:
    desk = Desk(board(8))
    desk.lines.adc[0, 1] = 0x1234_8100
    desk.dac(1, VALID | COLLECT | 0x9000)
    for value in (0x8200, 0x8300):
        desk.tick += 4160
        desk.lines.adc[0, 1] = value
        desk.bus.step(desk.tick)
    desk.tick += 4160
    count = desk.read(reg.DATA_BUFFER_STATUS) & 0x3FF
    assert count == 30
    values = [entry & 0xFFFF for entry in _entries(desk, count + 1) if entry & MEASURED]
    assert values == [0x8100] * 10 + [0x8200] * 10 + [0x8300] * 10


def test_words_without_valid_or_mask_bit_are_not_written_before_rev_9_and_so_end_nothing() -> None:
    for firmware in ALL:
        desk = Desk(board(firmware))
        desk.tick = 1000
        desk.dac(0, VALID | COLLECT | 0x8000)
        _block(desk, firmware, [0] * 4)
        assert bool(desk.read(reg.DATA_BUFFER_STATUS) & COLLECTING) == (firmware < 9)
        _block(desk, firmware, [0, MASK, 0, 0])
        assert bool(desk.read(reg.DATA_BUFFER_STATUS) & COLLECTING) == (firmware == 7)


def test_boards_collect_each_their_own() -> None:
    desk = Desk(board(8, board_id=3), board(8, board_id=5))
    desk.tick = 1000
    desk.block(0x306, VALID | COLLECT | 0x8000, 0, 0, 0, 0, 0x506, 0, VALID | 0x8000, 0, 0, 0)
    assert [desk.read(reg.DATA_BUFFER_STATUS, node) >> 10 for node in (0, 1)] == [0x21, 1]
    desk.write(reg.axis_register(1, reg.DAC), VALID | COLLECT | 0x8000, node=1)
    desk.block(0x306, VALID | 0x8000, 0, 0, 0, 0)
    assert [desk.read(reg.DATA_BUFFER_STATUS, node) >> 10 for node in (0, 1)] == [1, 0x22]
    desk.write(reg.axis_register(1, reg.DAC), VALID | 0x8000, node=1)
    assert desk.read(reg.DATA_BUFFER_STATUS, 1) >> 10 == 2
