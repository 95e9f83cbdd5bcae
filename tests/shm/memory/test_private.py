"""Systems that only one process has: the same segments, without names that others see."""

from __future__ import annotations

import itertools
import os
from collections.abc import Iterator

import pytest

from trocar.shm.memory import private
from trocar.shm.memory.segment import FOLDER, Segment, SegmentError, held, names_of, segment_name, unlink
from trocar.shm.system import directory
from trocar.shm.topics import SETPOINT

COUNTER = itertools.count()


@pytest.fixture
def ours() -> Iterator[str]:
    """The name of a system of ours alone."""
    name = f"private{os.getpid()}x{next(COUNTER)}"
    private.keep(name)
    yield name
    private.forget(name)


def test_its_rings_are_written_and_read_as_others_are(ours: str) -> None:
    directory.create_ring(ours, "PSM1", SETPOINT, {}, {"kind": "arm"})
    writer = directory.writer(ours, "PSM1", "setpoint", "arm")
    reader = directory.reader(ours, "PSM1", "setpoint", "arm")
    writer.field("position")[...] = 0.5
    writer.publish(7)
    assert reader.newest() and reader.stamp_ns == 7 and reader.field("position")[0] == 0.5
    assert not reader.gone
    writer.close()
    assert reader.gone
    reader.close()


def test_nobody_else_sees_it(ours: str) -> None:
    directory.create_ring(ours, "PSM1", SETPOINT, {}, {"kind": "arm"})
    assert names_of(ours) == [(ours, "PSM1", "setpoint")]
    assert (ours, "PSM1", "setpoint") in names_of()
    assert not list(FOLDER.glob(f"trocar~{ours}~*"))
    private.forget(ours)
    assert names_of(ours) == []


def test_one_writer_keeps_others_out(ours: str) -> None:
    directory.create_ring(ours, "PSM1", SETPOINT, {}, {"kind": "arm"})
    name = segment_name(ours, "PSM1", "setpoint")
    assert not held(name)
    writer = directory.writer(ours, "PSM1", "setpoint", "arm")
    assert held(name)
    with pytest.raises(SegmentError, match="writes it already"):
        directory.writer(ours, "PSM1", "setpoint", "arm")
    writer.close()


def test_what_is_there_is_not_made_twice_and_what_is_gone_is_not_found(ours: str) -> None:
    name = segment_name(ours, "PSM1", "setpoint")
    directory.create_ring(ours, "PSM1", SETPOINT, {}, {"kind": "arm"})
    with pytest.raises(SegmentError, match="exists already"):
        directory.create_ring(ours, "PSM1", SETPOINT, {}, {"kind": "arm"})
    with Segment(name) as attached:
        unlink(name)
        unlink(name)
        assert attached.view[:8] != bytes(8), "who has it goes on"
    with pytest.raises(SegmentError, match="there is no such segment"):
        Segment(name)


def test_a_name_is_kept_once(ours: str) -> None:
    with pytest.raises(KeyError):
        private.keep(ours)
