"""History while the writer goes on: `last` and `since` give whole records without a hole, up to the head they saw."""

from __future__ import annotations

import itertools
import os
from collections.abc import Callable
from contextlib import closing
from typing import Any
from unittest.mock import patch

from hypothesis import given
from hypothesis import strategies as st

from tests.conftest import World
from tests.examples import examples
from tests.shm.witness import Author, Lives, Witness, topic
from trocar.shm.memory.segment import Segment, segment_name, unlink
from trocar.shm.ring import ring
from trocar.shm.ring.ring import HEAD, RingReader, RingWriter
from trocar.shm.system.directory import create_ring

SLOTS = 8
KEPT = SLOTS - 1
COUNTER = itertools.count()
BEFORE = 20


class Interrupted:
    """The reader's words; before every load `meanwhile` runs, and what it returns is kept with the place loaded."""

    def __init__(self, words: Any, meanwhile: Callable[[], int]) -> None:
        self._words, self._meanwhile = words, meanwhile
        self.newest_at: dict[int, int] = {}

    def __getitem__(self, index: int, /) -> int:
        self.newest_at[index] = self._meanwhile()
        return int(self._words[index])

    def __setitem__(self, index: int, value: int, /) -> None:
        raise AssertionError("a reader has written")


class RingPair:
    """A ring with a writer, and a reader in whose every load the writer may come."""

    def __init__(self, pace: list[int]) -> None:
        system = f"t{os.getpid()}x-history{next(COUNTER)}"
        create_ring(system, "io", topic(SLOTS, 64), {}, {})
        self.name = segment_name(system, "io", "telling")
        self.author = Author(RingWriter(Segment(self.name, write=True), "io"), 1)
        for _ in range(BEFORE):
            self.author.publish()
        self.reader = RingReader(Segment(self.name))
        self.witness = Witness(self.reader, Lives())
        self._pace = iter(pace)
        self.words = Interrupted(self.reader._words, self._meanwhile)
        self.reader._words = self.words

    def _meanwhile(self) -> int:
        for _ in range(next(self._pace, 0)):
            self.author.publish()
        return self.author.writer.sequence

    def expected(self, first: int) -> list[int]:
        """Numbers from `first` to the head seen: those behind the last that was gone when its slot was looked at."""
        head = self.words.newest_at[HEAD]
        oldest = max(first, head - KEPT + 1)
        gone = [n for n in range(oldest, head + 1) if self._newest_when_seen(n) >= n + KEPT]
        return list(range(max(gone) + 1 if gone else oldest, head + 1))

    def _newest_when_seen(self, n: int) -> int:
        return self.words.newest_at[self.reader._places[n % SLOTS][0]]

    def close(self) -> None:
        self.author.writer.close()
        self.reader.close()
        unlink(self.name)


BLOCKS = st.sampled_from([1, 3, ring.BLOCK])
PACES = st.lists(st.sampled_from([0, 0, 0, 0, 1, 1, 2, 3, KEPT, 3 * KEPT]), max_size=40)


@examples(150)
@given(pace=PACES, count=st.integers(0, SLOTS + 2), block=BLOCKS)
def test_last_gives_all_that_was_not_overwritten(pace: list[int], count: int, block: int) -> None:
    with closing(RingPair(pace)) as pair, patch.object(ring, "BLOCK", block):
        found = pair.witness.history(pair.reader.last(count))
        assert found == pair.expected(pair.words.newest_at[HEAD] - count + 1)


@examples(150)
@given(pace=PACES, back=st.integers(-3, SLOTS + 2), block=BLOCKS)
def test_since_gives_all_that_was_not_overwritten(pace: list[int], back: int, block: int) -> None:
    with closing(RingPair(pace)) as pair, patch.object(ring, "BLOCK", block):
        found = pair.witness.history(pair.reader.since(BEFORE - back))
        assert found == pair.expected(BEFORE - back)


@examples(150)
@given(pace=PACES)
def test_a_late_reader_counts_all_that_is_overwritten_from_then_on(pace: list[int]) -> None:
    with closing(RingPair(pace)) as pair:
        for _ in pace:
            pair.witness.next()  # counts, and compares, at each record
        while pair.witness.next():
            pass
        newest = pair.author.writer.sequence
        assert pair.witness.received + pair.reader.lost == newest - BEFORE and pair.witness.last in (newest, 0)


def test_next_goes_on_with_what_is_kept_after_a_rewind(world: World) -> None:
    create_ring(world.name, "io", topic(SLOTS, 64), {}, {})
    name = segment_name(world.name, "io", topic(SLOTS, 64).name)
    with closing(RingWriter(Segment(name, write=True), "io")) as writer, closing(RingReader(Segment(name))) as reader:
        for n in range(20):
            writer.publish(n + 1)
        for asked, kept in ((3, 3), (100, KEPT)):
            reader.rewind(asked)
            found = []
            while reader.next():
                found.append(reader.sequence)
            assert found == list(range(21 - kept, 21))
        assert reader.lost == 0
    world.remove()
