"""A hostile process writes into live rings and pages: everybody reports, nobody hangs, and a writer puts it right."""

from __future__ import annotations

import contextlib
import itertools
import os
import signal
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from tests.examples import examples
from tests.shm.memory.test_hostile import bounded
from trocar.shm.memory.parts import remove_all
from trocar.shm.memory.segment import Segment, SegmentError, segment_name, unlink
from trocar.shm.ring.ring import BUSY, HEAD, LAST_SEQUENCE, RingReader, RingWriter
from trocar.shm.system.directory import create_ring
from trocar.shm.time import lockstep
from trocar.shm.time.control_page import ControlPage, create_control
from trocar.shm.time.lockstep import SCHEMA, LockstepClock, Table, Timekeeper
from trocar.shm.topics import Field, Topic

SYSTEM = f"tscribble{os.getpid()}"
COUNTER = itertools.count()
DEPTH = 8
NUMBER = Topic("number", "io", (Field("value", "<i8", "", ""), Field("pair", "(2,)<f8", "", "")), depth=DEPTH)
ODD = (0, 1, 2**31, 2**32 - 1, BUSY, BUSY + 1, LAST_SEQUENCE, 2**58, 2**62, 2**63, 2**64 - 2, 2**64 - 1)
NEAR = st.integers(-2 * DEPTH, 2 * DEPTH)


def clear() -> None:
    remove_all(SYSTEM)


class ScribbledRing(RuleBasedStateMachine):
    """One writer, readers that come and go, and somebody who writes anywhere."""

    @initialize()
    def make(self) -> None:
        instance = f"r{next(COUNTER)}"
        create_ring(SYSTEM, instance, NUMBER, {}, {})
        self.name = segment_name(SYSTEM, instance, "number")
        self.hand = Segment(self.name, write=True)
        self.words = self.hand.words()
        self.fixed, self.texts = self.hand.view[:64].tobytes(), self.hand.view[256:4096].tobytes()
        self.writer = RingWriter(Segment(self.name, write=True), "io")
        self.readers = [RingReader(Segment(self.name))]
        self.kept: list[int] = [0]
        self.reported = [(0, 0, 0)]
        self.clean = True

    def restore(self) -> None:
        """What the supervisor wrote, which no writer can bring back."""
        self.hand.view[:64], self.hand.view[256:4096] = self.fixed, self.texts

    @rule(count=st.integers(1, 2 * DEPTH))
    def publish(self, count: int) -> None:
        for _ in range(count):
            n = self.writer.sequence + 1
            self.writer.field("value")[...] = n
            self.writer.field("pair")[...] = n
            self.writer.publish(1000 + n)

    @rule(at=st.integers(0, 4096 + DEPTH * 64 - 1), data=st.binary(min_size=1, max_size=80))
    def scribble(self, at: int, data: bytes) -> None:
        self.clean = False
        end = min(len(self.hand.view), at + len(data))
        self.hand.view[at:end] = data[: end - at]

    @rule(value=st.one_of(st.sampled_from(ODD), NEAR))
    def put_head(self, value: int) -> None:
        self.clean = False
        near = abs(value) <= 2 * DEPTH and value not in (0, 1)
        self.words[HEAD] = max(0, self.writer.sequence + value) if near else value % 2**64

    @rule(slot=st.integers(0, DEPTH - 1), value=st.one_of(st.sampled_from(ODD), NEAR), busy=st.booleans())
    def put_sequence(self, slot: int, value: int, busy: bool) -> None:
        self.clean = False
        first, stride = self.hand.header.first, self.hand.header.stride
        number = max(0, self.writer.sequence + value) if abs(value) <= 2 * DEPTH else value
        self.words[(first + slot * stride) // 8] = (number + (BUSY if busy else 0)) % 2**64

    @rule()
    def attach(self) -> None:
        if len(self.readers) < 4:
            with contextlib.suppress(SegmentError):
                self.readers.append(RingReader(Segment(self.name)))
                self.kept.append(0)
                self.reported.append((0, 0, 0))

    @rule()
    def restart_writer(self) -> None:
        """Like a death and a successor; one who finds garbage in the head says so and is not let down by it."""
        before = self.writer.sequence
        self.writer.close()
        self.restore()
        segment = Segment(self.name, write=True)
        try:
            self.writer = RingWriter(segment, "io")
        except SegmentError as error:
            segment.close()
            assert "is garbage" in str(error) and self.words[HEAD] >= LAST_SEQUENCE
            self.words[HEAD] = before
            self.writer = RingWriter(Segment(self.name, write=True), "io")

    @rule(verb=st.sampled_from(["newest", "next", "last", "since"]), which=st.integers(0, 3))
    def read(self, verb: str, which: int) -> None:
        place = which % len(self.readers)
        reader = self.readers[place]
        with bounded():
            if verb in ("newest", "next"):
                before = reader.sequence
                took = getattr(reader, verb)()
                if took and verb == "newest":
                    assert reader.sequence >= before
                if took and verb == "next":  # it goes its own way, behind what `newest` has given
                    assert reader.sequence > self.kept[place] or not self.clean
                    self.kept[place] = reader.sequence
                if took and self.clean:
                    assert int(reader.field("value")) == reader.sequence == reader.stamp_ns - 1000
                if verb == "newest" and not took:
                    assert reader.stamp_ns == 0
            else:
                rows = reader.last(DEPTH) if verb == "last" else reader.since(0)
                assert len(rows) < DEPTH
                numbers = rows["sequence"].tolist()
                assert numbers == sorted(set(numbers))
            assert isinstance(reader.problem, str) and reader.epoch >= 0 and reader.stamp_ns is not None

    @rule()
    def heal(self) -> None:
        """Two rounds of the writer put everything right; who is left behind says so."""
        self.restore()
        self.publish(2 * DEPTH)
        last = self.writer.sequence
        with contextlib.closing(RingReader(Segment(self.name))) as fresh, bounded():
            assert fresh.newest() and fresh.sequence == last == int(fresh.field("value"))
            assert fresh.last(DEPTH)["value"].tolist() == list(range(last - DEPTH + 2, last + 1))
            assert fresh.since(1000 + last)["value"].tolist() == [last] and fresh.problem == ""
            self.publish(1)
            assert fresh.next() and fresh.sequence == last + 1 and not fresh.next() and fresh.lost == 0
        for place, reader in enumerate(self.readers):
            with bounded():
                took = 0
                while reader.next():
                    took += 1
                    assert took <= 3 * DEPTH
                if reader.sequence != last + 1:
                    assert reader.problem or reader.lost > DEPTH
                if not reader.newest():
                    assert reader.problem
            self.kept[place] = reader.sequence

    @invariant()
    def counts_only_grow(self) -> None:
        for place, reader in enumerate(getattr(self, "readers", [])):
            now = reader.lost, reader.torn, reader.backwards
            assert all(new >= old for new, old in zip(now, self.reported[place], strict=True))
            assert bool(reader.problem) == bool(reader.torn or reader.backwards)
            self.reported[place] = now

    def teardown(self) -> None:
        for part in (self.hand, self.writer, *self.readers):
            part.close()
        unlink(self.name)


TestScribbledRing = ScribbledRing.TestCase
TestScribbledRing.settings = examples(40, stateful_step_count=40)


def test_a_reader_that_comes_while_the_head_lies_says_so(world: Any) -> None:
    create_ring(world.name, "io", NUMBER, {}, {})
    name = segment_name(world.name, "io", "number")
    with Segment(name, write=True) as hand, contextlib.closing(RingWriter(Segment(name, write=True), "io")) as writer:
        for _ in range(2 * DEPTH):
            writer.publish(1)
        hand.words()[HEAD] += DEPTH
        with contextlib.closing(RingReader(Segment(name))) as misled:
            for _ in range(DEPTH):
                writer.publish(1)
            assert not misled.next() and misled.problem
        with contextlib.closing(RingReader(Segment(name))) as reader:
            writer.publish(1)
            assert reader.next() and not reader.problem
    world.remove()


@examples(40)
@given(at=st.integers(0, 4096), data=st.binary(min_size=1, max_size=1200))
def test_a_scribbled_control_page_stops_nobody(at: int, data: bytes) -> None:
    create_control(SYSTEM, "PSM1")
    page, other = ControlPage(SYSTEM, "PSM1", write=True), ControlPage(SYSTEM, "PSM1", write=True)
    try:
        ours, theirs = page.wakeup(), other.wakeup()
        end = min(len(page.segment.view), 4096 + at + len(data))
        page.segment.view[4096 + at : end] = data[: end - 4096 - at]
        with bounded():
            for _ in range(20):
                theirs.wake()
            assert ours.sleep(lambda: False, 100_000) is False
            assert isinstance(page.state, str)
            assert all(page.get(name) is not None for name in ("heartbeat_ns", "period_avg", "policy", "error"))
            page.show("FAILED", "it did")
        assert page.state == "FAILED" and page.get("error") == b"it did"
    finally:
        page.close()
        other.close()
        clear()


@pytest.mark.parametrize("garbage", [0, 1, 2**62, 2**63, 2**64 - 1])
@pytest.mark.parametrize("field", ["now_ns", "next_ns", "finished", "active", "base_ns", "base_monotonic_ns"])
def test_a_clock_page_that_shows_garbage_lets_everybody_end(
    monkeypatch: pytest.MonkeyPatch, field: str, garbage: int,
) -> None:
    monkeypatch.setattr(lockstep, "POLL_NS", 1_000_000)
    create_control(SYSTEM, "boards")
    keeper = Timekeeper(SYSTEM, Table(("boards",), paced=True))
    clock = LockstepClock(SYSTEM, "boards")
    try:
        keeper.admit(["boards"])
        clock.words[(4096 + SCHEMA.offset(field)) // 8] = garbage
        asked = iter(range(3))
        with bounded():
            clock.sleep_until(2**62 - 5, lambda: next(asked, None) is None)
            keeper.let_pass(0.001)
            assert keeper.now_ns() < 2**63 and clock.now_ns() < 2**63
    finally:
        clock.close()
        keeper.close()
        clear()


CUT_SHORT = """
import sys
from trocar.shm.system.directory import reader
ring = reader(sys.argv[1], "io", "number")
print("attached", flush=True)
sys.stdin.readline()
ring.newest()
print("still here", flush=True)
"""


@pytest.mark.slow
def test_a_file_cut_short_under_a_reader_ends_it(world: Any) -> None:
    """What no reader can be protected against: the kernel's answer is SIGBUS; shm/memory/segment.py says why."""
    create_ring(world.name, "io", NUMBER, {}, {})
    child = world.start(CUT_SHORT)
    assert child.stdout.readline() == "attached\n"
    with Segment(segment_name(world.name, "io", "number"), write=True) as hand:
        os.ftruncate(hand.fd, 0)
    printed, _ = child.communicate("\n", timeout=30)
    assert (child.returncode, printed) == (-signal.SIGBUS, "")
    world.remove()
