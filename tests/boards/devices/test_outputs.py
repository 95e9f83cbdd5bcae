"""Digital outputs against a tick-by-tick model, and the laws with the firmware's own figures."""

from __future__ import annotations

import copy
from dataclasses import dataclass, field

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.examples import examples
from trocar.procs.boards.devices.outputs import PLAY, BoardOutputs
from trocar.procs.boards.devices.waveform import NEVER, VALID

MS = 49152


@dataclass
class SlowOutputs:
    """The outputs one tick after the other, as counters and comparisons."""

    tick: int = 0
    value: list[int] = field(default_factory=lambda: [0] * 4)
    counter: list[int] = field(default_factory=lambda: [0] * 4)
    control: list[int] = field(default_factory=lambda: [0] * 4)
    skips: list[int] = field(default_factory=lambda: [0] * 4)  # ticks the counter misses
    table: list[int] = field(default_factory=lambda: [0] * 1024)
    mask: int = 0
    index: int = 0
    gone: int = 0

    def step(self) -> None:
        self.tick += 1
        for k in range(4):
            wanted = self.control[k] >> 16 if self.value[k] else self.control[k] & 0xFFFF
            if self.skips[k]:
                self.skips[k] -= 1
            elif wanted:
                before, self.counter[k] = self.counter[k], (self.counter[k] + 1) & 0xFFFF
                if before > wanted:
                    self.value[k] ^= 1
                    self.counter[k] = 0
        if not self.mask:
            return
        on = self.table[self.index]
        if not on & VALID:
            self.mask = self.index = self.gone = 0
        elif self.gone == on >> 8 & 0x7FFFFF:
            self.index, self.gone = (self.index + 1) % 1024, 0
        else:
            self.gone = (self.gone + 1) & 0x7FFFFF

    def write(self, value: int) -> None:
        for k in range(4):
            if value >> 8 + k & 1:
                self.value[k], self.counter[k], self.skips[k] = value >> k & 1, 0, 0
        self.mask = value >> 8 & 0xF if value & PLAY else 0
        self.index = self.gone = 0

    def levels(self) -> int:
        plain = sum(level << k for k, level in enumerate(self.value))
        on = self.table[self.index]
        return plain & ~self.mask | on & self.mask if self.mask and on & VALID else plain

    def read(self) -> int:
        valid = bool(self.table[self.index] & VALID) << 30
        return self.levels() | (self.index << 16 | valid | PLAY if self.mask else 0)


def turns(outputs: BoardOutputs, after: int, until: int) -> list[tuple[int, int]]:
    return list(outputs.changes(after, until).items)


# -- plain levels and timers -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("high", "low", "spans"), [(10, 5, (12, 7)), (1, 1, (3, 3)), (65534, 2, (65536, 4))])
def test_pwm_turns_after_count_plus_2_ticks(high: int, low: int, spans: tuple[int, int]) -> None:
    outputs = BoardOutputs()
    outputs.configure(2, high << 16 | low, 50)
    outputs.write(0x404, 100)
    first, period = 100 + spans[0], sum(spans)
    expected = [at for k in range(3) for at in ((first + k * period, 0), ((first + spans[1]) + k * period, 4))]
    assert turns(outputs, 100, expected[-1][0]) == expected
    assert outputs.busy_until == NEVER


def test_counter_of_a_held_level_wraps_at_65536() -> None:
    outputs = BoardOutputs()
    outputs.configure(0, 0xFFFF_0000, 0)
    outputs.write(0x101, 0)
    outputs.configure(0, 100 << 16, 65536 + 50)
    assert turns(outputs, 65586, 10**6) == [(65586 + 1 + 52, 0)]


@pytest.mark.parametrize(("quirk", "expected"), [(True, []), (False, [(65537, 0)])])
def test_longest_count_is_held_for_ever_unless_told_otherwise(quirk: bool, expected: list[tuple[int, int]]) -> None:
    outputs = BoardOutputs(longest_holds=quirk)
    outputs.configure(0, 0xFFFF_0000, 0)
    outputs.write(0x101, 0)
    assert turns(outputs, 0, 10**6) == expected


def test_pause_of_minutes_is_cut_short_and_says_so() -> None:
    outputs = BoardOutputs()
    for k in range(4):
        outputs.configure(k, 1 << 16 | 1 + k, 0)
    outputs.write(0xF05, 10)
    minutes = 600 * 1000 * MS
    short = outputs.changes(10, minutes, limit=200)
    assert 50 < len(short.items) <= 200  # switchings at the same tick are one change
    assert short.missed > 10**10
    assert short.since > minutes - 1000
    assert short.levels == outputs.levels(short.since)
    assert short.items[-1] == (short.items[-1][0], outputs.levels(minutes))
    assert outputs.changes(short.since, minutes).items == short.items
    assert outputs.changes(minutes, minutes).items == ()
    for k in range(1, 4):  # one output goes on: every switching shows
        outputs.configure(k, 0, minutes)
    every = outputs.changes(minutes, minutes + 1000)
    part = outputs.changes(minutes, minutes + 1000, limit=100)
    assert (every.missed, part.missed + len(part.items)) == (0, len(every.items))


def test_changes_begin_with_the_last_write() -> None:
    outputs = BoardOutputs()
    outputs.configure(0, 10 << 16 | 10, 0)
    outputs.write(0x101, 100)
    assert outputs.changes(50, 130) == outputs.changes(100, 130)
    assert outputs.changes(50, 130).since == 100


def test_changes_of_some_outputs_are_not_hidden_by_fast_pwm_on_others() -> None:
    outputs = BoardOutputs()
    outputs.configure(2, 1 << 16 | 1, 0)
    outputs.configure(0, 4915 << 16, 0)
    outputs.write(0xF05, 100)
    minutes = 600 * 1000 * MS
    assert outputs.changes(100, minutes, of=0b0011).items == ((5017, 0),)
    assert (outputs.settled(0b0011), outputs.settled(0b0010), outputs.settled(0b0100)) == (5017, 0, NEVER)
    outputs.write_table(0, [VALID | 99 << 8 | 1, VALID | 99 << 8 | 2, 0], minutes)
    outputs.write(PLAY | 0x100, minutes)
    assert (outputs.settled(0b0001), outputs.settled(0b0010)) == (minutes + 201, 0)
    assert outputs.changes(minutes, minutes + 300, of=0b0001).items == ((minutes + 100, 0),)


def test_extra_inputs_are_read_beside_the_outputs() -> None:
    outputs = BoardOutputs()
    outputs.write(0xF03, 0)
    assert outputs.read(0) == 3
    outputs.extra = 0x1C
    assert outputs.read(0) == 0xC03


# -- tick by tick ------------------------------------------------------------------------------------------------------

COUNTS = st.integers(0, 6)
ENTRIES = st.lists(st.builds(lambda valid, end, levels: valid << 31 | end << 8 | levels, st.sampled_from((1, 1, 1, 0)),
                             st.integers(0, 5), st.integers(0, 15)), min_size=1, max_size=6)
WRITES = st.one_of(
    st.tuples(st.just("write"), st.integers(0, 0xFFF), st.booleans()),
    st.tuples(st.just("configure"), st.integers(0, 3), COUNTS, COUNTS),
    st.tuples(st.just("table"), st.integers(0, 4), ENTRIES))


def carry_out(outputs: BoardOutputs, slow: SlowOutputs, order: tuple[object, ...]) -> None:
    """Make a write on both."""
    match order:
        case ("write", int(value), bool(play)):
            outputs.write(value | play * PLAY, slow.tick)
            slow.write(value | play * PLAY)
        case ("configure", int(k), int(high), int(low)):
            outputs.configure(k, high << 16 | low, slow.tick)
            slow.control[k] = high << 16 | low
            slow.skips[k] += 1
        case ("table", int(index), list(entries)):
            outputs.write_table(index, entries, slow.tick)
            slow.table[index : index + len(entries)] = entries


@examples(60)
@given(st.lists(st.tuples(st.integers(0, 40), WRITES), max_size=12), st.integers(0, 80))
def test_stepping_in_one_go_equals_tick_by_tick(orders: list[tuple[int, tuple[object, ...]]], rest: int) -> None:
    outputs, asked, slow = BoardOutputs(), BoardOutputs(), SlowOutputs()
    for wait, order in [*orders, (rest, ("table", 9, [0]))]:
        start, seen = slow.tick, [(slow.tick, slow.levels())]
        for _ in range(wait):
            slow.step()
            assert asked.read(slow.tick) == slow.read()
            assert asked.playing(slow.tick) == bool(slow.mask)
            if slow.levels() != seen[-1][1]:
                seen.append((slow.tick, slow.levels()))
            assert slow.tick <= asked.busy_until or (slow.levels(), slow.mask) == (asked.levels(10**9), 0)
        changes = outputs.changes(start, slow.tick)
        assert [(start, changes.levels), *changes.items] == seen
        assert outputs.read(slow.tick) == slow.read()
        carry_out(asked, copy.deepcopy(slow), order)
        carry_out(outputs, slow, order)
        assert outputs.read(slow.tick) == slow.read()
