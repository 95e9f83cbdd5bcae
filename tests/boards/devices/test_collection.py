"""Data collection against a tick-by-tick model, and its rules one by one."""

from __future__ import annotations

from dataclasses import dataclass, field

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.examples import examples
from trocar.procs.boards.devices.collection import COLLECTING, LATE, MEASURED, Collection
from trocar.procs.fpga import registers as reg

MS = 49152
ON = reg.DAC_VALID | reg.DAC_COLLECT
OFF = reg.DAC_VALID


def command(ticks: int, value: int) -> int:
    """An entry for a command, so many ticks after the last real-time sample."""
    return (LATE if ticks >= 1 << 14 else 0) | (ticks & 0x3FFF) << 16 | value


@dataclass
class SlowCollection:
    """The buffer one tick after the other."""

    free_running: bool
    tick: int = 0
    stamp: int = 0
    collecting: bool = False
    channel: int = 1
    index: int = 0
    measured: int = 0x8000
    entries: list[int] = field(default_factory=lambda: [0] * 1024)

    def step(self) -> None:
        self.tick += 1
        self.stamp += 1
        if self.tick % 416 == 144 and self.collecting:
            self.index = (self.index + 1) % 1024
            self.entries[self.index] = MEASURED | command(self.stamp, self.measured)

    def command(self, channel: int, word: int, measured: int) -> None:
        collect = bool(word & reg.DAC_COLLECT)
        if collect and not self.collecting:
            self.channel, self.index, self.collecting, self.measured = channel, 0, True, measured
        elif channel == self.channel:
            self.collecting = collect
            self.index = (self.index + 1) % 1024 if collect else self.index
        if collect:
            self.entries[self.index] = command(max(self.stamp, 0), word & 0xFFFF)


def test_power_up_status_is_axis_1_at_rest() -> None:
    collection = Collection(8)
    assert collection.status(0) == 0x0400
    assert not collection.collecting
    assert collection.read(0, 1024, 5 * MS) == [0] * 1024


@pytest.mark.parametrize(("tick", "entry"), [
    ((1 << 14) - 1, 0x3FFF_0007), (1 << 14, LATE | 7), ((1 << 32) - 1, LATE | 0x3FFF_0007), ((1 << 32) + 5, 0x5_0007)])
def test_time_stamp_beyond_14_bits_says_so_until_the_counter_wraps(tick: int, entry: int) -> None:
    collection = Collection(9)
    collection.command(1, ON | 7, tick)
    assert collection.read(0, 1, tick) == [entry]


def test_buffer_is_mirrored_and_the_status_lies_above() -> None:
    collection = Collection(8)
    collection.command(4, ON | 7, 1)
    assert collection.read(0x3FF, 3, 1) == [0, command(1, 7), 0]
    assert collection.read(0x400, 1, 1) == [command(1, 7)]
    assert collection.read(0x7FF, 3, 1) == [0, COLLECTING | 4 << 10, 0]
    assert collection.read(0xC00, 1, 1) == [0]


def test_ring_goes_round_after_1024_entries() -> None:
    collection = Collection(9)
    collection.command(1, ON | 7, 0)
    last = 144 + 1023 * 416
    assert collection.status(last) & 0x3FF == 0
    assert collection.read(0, 2, last) == [MEASURED | command(last, 0x8000), MEASURED | command(144, 0x8000)]


def test_pause_of_months_leaves_the_newest_entries() -> None:
    slow, fast, months = Collection(9), Collection(9), 10**15
    for collection in (slow, fast):
        collection.command(1, ON | 7, 0)
    for tick in range(months - 4096 * 416, months, 416 * 100):
        slow.status(tick)
    assert fast.status(months) == slow.status(months)
    assert fast.read(0, 1024, months) == slow.read(0, 1024, months)


WORDS = st.tuples(st.integers(1, 4), st.booleans(), st.integers(0, 0xFFFF))
EVENTS = st.lists(st.tuples(st.integers(0, 1200), st.one_of(
    WORDS, st.just("sampled"), st.integers(0, 0xFFFF), st.just("look"))), max_size=20)


@examples(40)
@given(EVENTS, st.sampled_from((8, 9)))
def test_stepping_in_one_go_equals_tick_by_tick(
        events: list[tuple[int, tuple[int, bool, int] | int | str]], firmware: int) -> None:
    collection, slow = Collection(firmware), SlowCollection(firmware == 9)
    for wait, event in [*events, (500, "look")]:
        for _ in range(wait):
            slow.step()
        match event:
            case (channel, collect, value):
                word = (ON if collect else OFF) | value
                collection.command(channel, word, slow.tick, value ^ 0x5555)
                slow.command(channel, word, value ^ 0x5555)
            case "sampled":
                collection.sampled(slow.tick)
                slow.stamp = slow.stamp if slow.free_running else -1
            case int(value):
                collection.measure(value, slow.tick)
                slow.measured = value
            case _:
                status = slow.collecting << 15 | slow.channel << 10 | slow.index
                assert collection.status(slow.tick) == status
                assert collection.read(0, 1024, slow.tick) == slow.entries
        assert collection.collecting == slow.collecting


@pytest.mark.parametrize("firmware", [8, 9])
def test_time_counts_from_power_up(firmware: int) -> None:
    late, first = Collection(firmware, 1_000_001), Collection(firmware)
    for collection, tick in ((late, 1_000_001), (first, 0)):
        collection.command(1, ON | 0x9000, tick + 100)
    assert late.read(0, 8, 1_000_001 + 2000) == first.read(0, 8, 2000)
    assert first.read(1, 1, 2000)[0] >> 31
