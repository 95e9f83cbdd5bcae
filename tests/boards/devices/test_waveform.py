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


def test_entry_shortened_below_its_age_runs_until_the_counter_wraps() -> None:
    outputs = playing(entry(100, 1), 0)
    outputs.write_table(0, [entry(10, 1)], 1050)
    assert turns(outputs, 1050, 10**8) == [(1050 + (9 - 50) % (1 << 23) + 1, 0)]


def test_longest_entry_lasts_8388608_ticks() -> None:
    outputs = playing(entry(1 << 23, 1), 0)
    assert turns(outputs, 1000, 10**8) == [(1000 + 8_388_608, 0)]
