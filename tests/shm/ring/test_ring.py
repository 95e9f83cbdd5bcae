"""Rings: every verb against a plain list, loss counted exactly, and writers that die."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.examples import examples
from trocar.shm.memory.layout import schema_of
from trocar.shm.memory.order import FencedWords
from trocar.shm.memory.segment import Segment, SegmentError, names_of, segment_name, unlink
from trocar.shm.ring.ring import HEAD, RingError, RingReader, RingWriter
from trocar.shm.system.directory import create_ring
from trocar.shm.topics import SETPOINT, Field, Topic

DEPTH = 4  # slots; one is always busy, so 3 records are kept
NUMBER = Topic("number", "io", (Field("value", "<i8", "", "a number"), Field("pair", "(2,)<f8", "", "two")),
               depth=DEPTH)
WRITER = """
import sys
from trocar.shm.ring.ring import RingWriter
from trocar.shm.memory.segment import Segment
writer = RingWriter(Segment(sys.argv[2], write=True), "PSM1")
value = writer.field("value")
for i in range(1, 7):
    value[...] = 100 + i
    writer.publish(i)
print("written", flush=True)
sys.stdin.read()
"""


class RingUnderTest:
    """One ring under test."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.ends: list[Any] = []

    def writer(self) -> RingWriter:
        self.ends.append(RingWriter(Segment(self.name, write=True), "PSM1"))
        return self.ends[-1]

    def reader(self) -> RingReader:
        self.ends.append(RingReader(Segment(self.name)))
        return self.ends[-1]


@pytest.fixture
def make_ring(world: Any) -> Iterator[Callable[[], RingUnderTest]]:
    """A maker of rings of NUMBER."""
    made: list[RingUnderTest] = []
    counter = itertools.count()

    def make() -> RingUnderTest:
        instance = f"r{next(counter)}"
        create_ring(world.name, instance, NUMBER, {}, {})
        made.append(RingUnderTest(segment_name(world.name, instance, "number")))
        return made[-1]

    yield make
    for ring in made:
        for end in ring.ends:
            end.close()
        unlink(ring.name)


@pytest.fixture
def ring(make_ring: Callable[[], RingUnderTest]) -> RingUnderTest:
    return make_ring()


def put(writer: RingWriter, *values: int) -> None:
    for value in values:
        writer.field("value")[...] = value
        writer.field("pair")[...] = value
        writer.publish(1000 + value)


def rest(reader: RingReader) -> list[int]:
    """All `next` gives now."""
    found = []
    while reader.next():
        found.append(int(reader.field("value")[()]))
    return found


def test_an_empty_ring_gives_nothing(ring: RingUnderTest) -> None:
    reader = ring.reader()
    assert not reader.newest() and not reader.next()
    assert len(reader.last(3)) == 0 and len(reader.since(0)) == 0
    assert (reader.sequence, reader.stamp_ns, reader.head, reader.epoch, reader.lost) == (0, 0, 0, 0, 0)


def test_newest_copies_one_whole_record(ring: RingUnderTest) -> None:
    writer, reader = ring.writer(), ring.reader()
    value, pair = reader.field("value"), reader.field("pair")
    put(writer, 1, 2)
    assert reader.newest() and reader.newest()
    assert (int(value), pair.tolist(), reader.stamp_ns, reader.sequence) == (2, [2.0, 2.0], 1002, 2)
    put(writer, 3)
    assert int(value) == 2  # a private copy
    assert reader.newest() and int(value) == 3


def test_who_looks_once_reads_the_same(ring: RingUnderTest) -> None:
    put(ring.writer(), *range(1, 7))
    prepared, once = ring.reader(), RingReader(Segment(ring.name), often=False)
    ring.ends.append(once)
    assert once.newest() and prepared.newest() and bytes(once.record) == bytes(prepared.record)
    assert once.last(9)["value"].tolist() == prepared.last(9)["value"].tolist() == [4, 5, 6]
    assert once.since(1005)["value"].tolist() == [5, 6]
    once.close()
    assert once._segment._map.closed


def test_last_leaves_the_slot_out_that_comes_next(ring: RingUnderTest) -> None:
    writer, reader = ring.writer(), ring.reader()
    put(writer, *range(1, 10))
    assert reader.last(100)["value"].tolist() == [7, 8, 9]
    assert reader.last(2)["value"].tolist() == [8, 9] and len(reader.last(0)) == 0
    assert reader.since(1008)["value"].tolist() == [8, 9]
    assert reader.since(0)["value"].tolist() == [7, 8, 9] and len(reader.since(9999)) == 0


def test_a_field_that_is_not_there_names_those_that_are(ring: RingUnderTest) -> None:
    with pytest.raises(RingError, match=r"no field x; there are: sequence, stamp_ns, value, pair"):
        ring.writer().field("x")


def test_another_schema_is_refused_naming_both(ring: RingUnderTest) -> None:
    with Segment(ring.name) as segment, pytest.raises(SegmentError) as caught:
        RingReader(segment, schema_of(SETPOINT))
    text = str(caught.value)
    assert f"{schema_of(NUMBER).fingerprint:016x}" in text and f"{schema_of(SETPOINT).fingerprint:016x}" in text


def test_a_successor_goes_on_from_head_with_a_new_epoch(world: Any, ring: RingUnderTest) -> None:
    reader = ring.reader()
    child = world.start(WRITER, ring.name)
    assert child.stdout.readline() == "written\n"
    assert reader.newest() and (reader.sequence, reader.epoch) == (6, 1)
    with Segment(ring.name, write=True) as second, pytest.raises(SegmentError, match=rf"PSM1 \(pid {child.pid}\)"):
        RingWriter(second, "PSM1")
    world.kill(child)
    writer = ring.writer()
    assert (writer.sequence, writer.stamp_ns, int(writer.field("value")[()])) == (6, 6, 106)
    put(writer, 7)
    assert rest(reader) == [105, 106, 7] and reader.lost == 4 and reader.epoch == 2


def test_a_writer_that_died_inside_a_slot_harms_nobody(ring: RingUnderTest) -> None:
    writer, reader = ring.writer(), ring.reader()
    put(writer, 1, 2, 3)
    with Segment(ring.name, write=True) as hand:
        words = hand.words()
        at = (hand.header.first + 0 * hand.header.stride) // 8  # slot of record 4, as W1 and half of W2 leave it
        words[at], words[at + 1] = 0, 77
        assert reader.newest() and reader.sequence == 3
        assert rest(reader) == [1, 2, 3] and reader.lost == 0
        assert reader.last(9)["value"].tolist() == [1, 2, 3]
    writer.close()
    heir = ring.writer()
    put(heir, 4)
    assert rest(reader) == [4] and reader.lost == 0


def test_a_half_written_newest_slot_is_never_given(ring: RingUnderTest) -> None:
    writer, reader = ring.writer(), ring.reader()
    put(writer, 1, 2)
    with Segment(ring.name, write=True) as hand:
        words = hand.words()
        words[(hand.header.first + 2 * hand.header.stride) // 8] = 0  # as if the writer had come round to it
        assert not reader.newest() and reader.torn == 1
        assert rest(reader) == [1] and reader.lost == 1
        assert len(reader.last(9)) == 0  # who has come round to 2 has overwritten 1


def test_a_record_finished_before_its_head_is_kept_by_the_successor(ring: RingUnderTest) -> None:
    writer, reader, other = ring.writer(), ring.reader(), ring.reader()
    put(writer, 1, 2)
    with Segment(ring.name, write=True) as hand:
        hand.words()[HEAD] = 1  # as a writer leaves it that dies between W3 and W4
    writer.close()
    assert rest(reader) == [1, 2]  # what `next` has given …
    assert reader.newest() and reader.sequence == 2 and reader.backwards == 0
    assert other.newest() and other.sequence == 1
    heir = ring.writer()
    assert (heir.sequence, int(heir.field("value")[()])) == (2, 2)  # … is not written a second time
    put(heir, 5)
    assert rest(reader) == [5] and reader.sequence == 3 and reader.problem == ""


def test_a_head_that_goes_backwards_is_reported_and_not_followed(ring: RingUnderTest) -> None:
    writer, reader = ring.writer(), ring.reader()
    put(writer, 1, 2, 3)
    assert reader.newest() and rest(reader) == [1, 2, 3]
    with Segment(ring.name, write=True) as hand:
        hand.words()[HEAD] = 1
    assert not reader.newest() and reader.stamp_ns == 0
    assert not reader.next()
    assert reader.backwards == 1 and "went backwards" in reader.problem


def test_a_slot_that_contradicts_the_head_is_reported(ring: RingUnderTest) -> None:
    writer, reader = ring.writer(), ring.reader()
    put(writer, 1, 2)
    with Segment(ring.name, write=True) as hand:
        hand.words()[(hand.header.first + 2 * hand.header.stride) // 8] = 99
    assert not reader.newest() and (reader.torn, reader.stamp_ns) == (1, 0)
    assert "no whole record" in reader.problem


def test_a_slot_that_contradicts_is_not_kept(ring: RingUnderTest) -> None:
    writer, reader = ring.writer(), ring.reader()
    put(writer, 1, 2)
    with Segment(ring.name, write=True) as hand:
        hand.words()[(hand.header.first + 2 * hand.header.stride) // 8] = 99
    assert rest(reader) == [1] and (reader.lost, reader.stamp_ns) == (1, 0)
    put(writer, 3)
    assert rest(reader) == [3] and reader.stamp_ns == 1003
    assert rest(reader) == [] and reader.stamp_ns == 1003  # not there yet: the last one stands


@pytest.mark.parametrize("head", [2**64 - 1, 2**62, 1 << 40, 7])
def test_a_garbage_head_ends_in_no_endless_loop(ring: RingUnderTest, head: int) -> None:
    writer, reader = ring.writer(), ring.reader()
    put(writer, 1, 2)
    assert rest(reader) == [1, 2]
    with Segment(ring.name, write=True) as hand:
        hand.words()[HEAD] = head
    assert not reader.newest() and not reader.next() and "no whole record" in reader.problem
    assert len(reader.last(5)) == 0 and len(reader.since(0)) == 0
    writer.close()
    if head >= 2**62:
        with pytest.raises(SegmentError, match=f"head {head} is garbage"):
            ring.writer()


@pytest.mark.parametrize("head", [0, 5, 1 << 40])
def test_a_successor_counts_on_although_somebody_wrote_into_the_head(ring: RingUnderTest, head: int) -> None:
    writer = ring.writer()
    put(writer, *range(1, 42))
    reader = ring.reader()  # waits for 42
    with Segment(ring.name, write=True) as hand:
        hand.words()[HEAD] = head
    writer.close()
    put(ring.writer(), 42)
    assert rest(reader) == [42] and (reader.lost, reader.problem) == (0, "")


def test_fences_asked_for_change_nothing_but_the_time(ring: RingUnderTest, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TROCAR_FENCES", "1")
    writer, reader = ring.writer(), ring.reader()
    assert isinstance(writer._words, FencedWords) and isinstance(reader._words, FencedWords)
    for start in range(1, 20, 2):
        put(writer, start, start + 1)
        assert rest(reader) == [start, start + 1] and reader.newest() and reader.sequence == start + 1
    assert reader.problem == "" and reader.lost == 0


class Model:
    """A reader of an unbounded list, of which the ring keeps the last DEPTH - 1."""

    def __init__(self, written: list[int]) -> None:
        self.written, self.place, self.lost = written, len(written), 0

    def next(self) -> int | None:
        oldest = max(0, len(self.written) - DEPTH + 1)
        if self.place < oldest:
            self.lost += oldest - self.place
            self.place = oldest
        if self.place == len(self.written):
            return None
        self.place += 1
        return self.written[self.place - 1]


STEPS = st.lists(st.sampled_from(["put", "put", "put", "newest", "next", "last", "since", "attach", "restart"]),
                 max_size=60)


@examples(150)
@given(steps=STEPS)
def test_any_sequence_of_verbs_equals_a_plain_list(steps: list[str]) -> None:
    name = segment_name(MODEL_SYSTEM, "model", "number")
    create_ring(MODEL_SYSTEM, "model", NUMBER, {}, {})
    ring, written = RingUnderTest(name), []
    try:
        writer = ring.writer()
        pairs = [(ring.reader(), Model(written))]
        for step in steps:
            if step == "put":
                written.append(len(written) + 1)
                put(writer, written[-1])
            elif step == "attach":
                pairs.append((ring.reader(), Model(written)))
            elif step == "restart":
                writer.close()
                writer = ring.writer()
            for reader, model in pairs:
                check(step, reader, model, written)
    finally:
        for end in ring.ends:
            end.close()
        unlink(name)
    assert names_of(MODEL_SYSTEM) == []


MODEL_SYSTEM = f"tmodel{np.random.default_rng().integers(1 << 40)}"


def check(step: str, reader: RingReader, model: Model, written: list[int]) -> None:
    if step == "newest":
        assert reader.newest() == bool(written)
        assert not written or int(reader.field("value")[()]) == written[-1] == reader.stamp_ns - 1000
    elif step == "next":
        expected = model.next()
        assert reader.next() == (expected is not None)
        assert expected is None or int(reader.field("value")[()]) == expected == reader.sequence
    elif step == "last":
        assert reader.last(2)["value"].tolist() == written[-2:]
    elif step == "since":
        stamp = 1000 + len(written) - 1
        kept = written[-(DEPTH - 1):]
        assert reader.since(stamp)["value"].tolist() == [v for v in kept if 1000 + v >= stamp]
    assert reader.lost == model.lost and reader.torn == 0


@pytest.mark.parametrize("stamp", [-(2**63), -1, 2**63 - 1])
def test_a_successor_takes_over_no_absurd_stamp(ring: RingUnderTest, stamp: int) -> None:
    writer = ring.writer()
    writer.publish(stamp)
    writer.close()
    assert ring.writer().stamp_ns == 0
