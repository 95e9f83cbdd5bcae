"""Play-back of the waveform table: durations, end, restarts, and what writes meanwhile do."""

from __future__ import annotations

import pytest

from trocar.procs.boards.devices.outputs import PLAY, BoardOutputs
from trocar.procs.boards.devices.waveform import NEVER, VALID


def entry(ticks: int, levels: int) -> int:
    """A waveform entry that lasts so many ticks."""
    return VALID | (ticks - 1) << 8 | levels


def turns(outputs: BoardOutputs, after: int, until: int) -> list[tuple[int, int]]:
    return list(outputs.changes(after, until).items)


def playing(*entries: int, start: int = 1000, mask: int = 0xF) -> BoardOutputs:
    outputs = BoardOutputs()
    outputs.write_table(0, list(entries), 0)
    outputs.write(PLAY | mask << 8, start)
    return outputs


def test_waveform_entries_last_their_value_plus_1_ticks() -> None:
    outputs = playing(entry(10, 1), entry(1, 2), entry(20, 3), 0x7FFF_FF0F)
    assert outputs.levels(1000) == 1
    assert turns(outputs, 1000, 9999) == [(1010, 2), (1011, 3), (1031, 0)]


def test_read_value_shows_index_and_activity() -> None:
    outputs = playing(entry(10, 1), entry(5, 2), 0)
    assert outputs.read(1009) == PLAY | 1 << 30 | 1
    assert outputs.read(1010) == PLAY | 1 << 30 | 1 << 16 | 2
    assert outputs.read(1015) == PLAY | 2 << 16  # the invalid entry comes up
    assert outputs.read(1016) == 0
    assert [outputs.playing(tick) for tick in (1014, 1015, 1016)] == [True, True, False]
    assert outputs.busy_until == 1016


def test_outputs_not_handed_over_keep_their_own_timers() -> None:
    outputs = BoardOutputs()
    outputs.write_table(0, [entry(100, 0xF), 0], 0)
    outputs.configure(2, 8 << 16 | 8, 0)
    outputs.write(0x404, 0)
    outputs.write(PLAY | 0x300, 1000)
    assert outputs.levels(1001) & 3 == 3
    assert {level & 3 for _, level in turns(outputs, 1000, 1099)} == {3}
    assert turns(outputs, 1000, 1099)[0][0] - 1000 == 10
    assert outputs.levels(1100) & 3 == 0


def test_levels_written_with_the_start_hold_after_the_end() -> None:
    outputs = BoardOutputs()
    outputs.write_table(0, [entry(4, 0xA), 0], 0)
    outputs.write(PLAY | 0xF05, 100)
    assert [outputs.levels(tick) for tick in (103, 104)] == [0xA, 0x5]


@pytest.mark.parametrize("value", [0x000, 0x101, PLAY])
def test_any_write_without_bit_31_or_mask_stops_it(value: int) -> None:
    outputs = playing(entry(1000, 0xF), 0)
    outputs.write(value, 1100)
    assert not outputs.playing(1100)
    assert outputs.levels(1100) == value & 0xF
    assert outputs.busy_until == 0


def test_start_while_playing_begins_at_entry_0_again() -> None:
    outputs = playing(entry(10, 1), entry(1000, 2), 0)
    outputs.write(PLAY | 0xF00, 1200)
    assert turns(outputs, 1200, 1300) == [(1210, 2)]


def test_full_table_goes_round_for_ever() -> None:
    outputs = playing(*(entry(2 + k % 3, k & 0xF) for k in range(1024)))
    lap = sum(2 + k % 3 for k in range(1024))
    assert outputs.busy_until == NEVER
    assert outputs.read(1000 + 10**6 * lap) == PLAY | 1 << 30
    far = 1000 + 123_456 * lap
    shift = [(tick + 123_456 * lap, level) for tick, level in turns(outputs, 1000 + lap, 1000 + 2 * lap)]
    assert turns(outputs, far + lap, far + 2 * lap) == shift
    assert len(shift) == 1024


def test_table_is_read_and_written_in_parts_that_wrap() -> None:
    outputs = BoardOutputs()
    outputs.write_table(1022, [1, 2, 3, 4], 0)
    assert outputs.read_table(1021, 5, 0) == [0, 1, 2, 3, 4]


@pytest.mark.parametrize("hides", [True, False])
def test_reads_give_the_entry_that_is_on_while_playing(hides: bool) -> None:
    outputs = BoardOutputs(playing_hides_table=hides)
    table = [entry(10, 1), entry(10, 2), 0]
    outputs.write_table(0, table, 0)
    outputs.write(PLAY | 0xF00, 100)
    assert outputs.read_table(0, 3, 115) == ([table[1]] * 3 if hides else table)
    assert outputs.read_table(0, 3, 121) == table


def test_entry_rewritten_while_on_goes_on_with_its_new_length() -> None:
    outputs = playing(entry(100, 1), entry(50, 2), 0)
    outputs.write_table(0, [entry(40, 4)], 1020)
    assert outputs.levels(1020) == 4
    assert turns(outputs, 1020, 9999) == [(1040, 2), (1090, 0)]
    assert outputs.busy_until == 1091
    outputs.write_table(0, [entry(60, 4)], 1030)
    assert turns(outputs, 1030, 9999) == [(1060, 2), (1110, 0)]
    outputs.write_table(0, [entry(40, 4)], 1035)
    outputs.write_table(0, [entry(400, 4)], 1050)  # is over: changes nothing
    outputs.write_table(1, [entry(45, 2)], 1050)
    assert turns(outputs, 1050, 9999) == [(1085, 0)]
    outputs.write_table(1, [0], 1060)
    assert outputs.read(1060) == PLAY | 1 << 16
    assert not outputs.playing(1061)


def test_entry_shortened_below_its_age_runs_until_the_counter_wraps() -> None:
    outputs = playing(entry(100, 1), 0)
    outputs.write_table(0, [entry(10, 1)], 1050)
    assert turns(outputs, 1050, 10**8) == [(1050 + (9 - 50) % (1 << 23) + 1, 0)]


def test_longest_entry_lasts_8388608_ticks() -> None:
    outputs = playing(entry(1 << 23, 1), 0)
    assert turns(outputs, 1000, 10**8) == [(1000 + 8_388_608, 0)]
