"""A reader that was overrun by a writer at full speed: it restarts where the writer does not catch it again."""

from __future__ import annotations

from typing import Any

import pytest

from trocar.shm.memory.segment import Segment, segment_name
from trocar.shm.ring.ring import HEAD, RingReader, RingWriter
from trocar.shm.system.directory import create_ring
from trocar.shm.topics import Field, Topic

FIELDS = (Field("value", "<i8", "", "a number"),)


class Hurried:
    """The words of a reader; the writer publishes one more record whenever it looks at the head."""

    def __init__(self, words: Any, writer: RingWriter) -> None:
        self._words, self._writer = words, writer

    def __getitem__(self, index: int) -> int:
        value = int(self._words[index])
        if index == HEAD:
            put(self._writer)
        return value


def put(writer: RingWriter) -> None:
    writer.field("value")[...] = writer.sequence + 1
    writer.publish(writer.sequence + 1)


@pytest.mark.parametrize("depth", [4, 5, 64])
def test_an_overrun_reader_gets_away_from_a_quick_writer(world: Any, depth: int) -> None:
    topic = Topic("number", "io", FIELDS, depth=depth)
    create_ring(world.name, "io", topic, {}, {})
    name = segment_name(world.name, "io", "number")
    writer, reader = RingWriter(Segment(name, write=True), "io"), RingReader(Segment(name))
    for _ in range(3 * depth):
        put(writer)
    reader._words = Hurried(reader._words, writer)  # type: ignore[assignment]
    assert reader.next() and int(reader.field("value")) == reader.sequence
    assert reader.lost == reader.sequence - 1 and not reader.problem
    reader.close()
    writer.close()
    world.remove()
