"""All rings of a system in one recording, from rings that the test writes."""

from __future__ import annotations

import errno
import io
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.conftest import World
from trocar.procs.recordings import names
from trocar.procs.recordings.facts import document_of, facts_of, local_offset_ns
from trocar.procs.recordings.reading import open_recording
from trocar.procs.recordings.snapshot import take
from trocar.shm.memory.segment import path_of, segment_name
from trocar.shm.system import directory
from trocar.shm.time.clock import local_ns, monotonic_ns
from trocar.shm.topics import EVENTS, SETPOINT

SECOND_NS = 1_000_000_000


@pytest.fixture
def world(world: World) -> Iterator[World]:
    """One whose rings are removed at the end."""
    yield world
    world.remove()


def rings(world: World, counts: dict[str, int]) -> None:
    """A setpoint ring for each name, with so many records, 1 ms apart."""
    for instance, count in counts.items():
        directory.create_ring(world.name, instance, SETPOINT, {}, {"kind": "arm"})
        writer = directory.writer(world.name, instance, SETPOINT.name, "arm")
        for number in range(count):
            writer.field("position")[...] = number
            writer.publish(SECOND_NS + number * 1_000_000)
        writer.close()


def taken(world: World, file: Path) -> list[str]:
    """Write the file; what could not be read."""
    with file.open("xb", buffering=0) as stream:
        facts = facts_of(world.name, names.DUMP, "all", "a test")
        return take(world.name, stream, facts, document_of(world.name)).problems


def test_every_ring_is_kept_to_its_full_depth_in_the_order_of_stamps(world: World, tmp_path: Path) -> None:
    rings(world, {"PSM1": 10, "PSM2": 7000, "PSM3": 0})
    directory.create_ring(world.name, "PSM1", EVENTS, {}, {"kind": "arm"})
    depth = directory.reader(world.name, "PSM2", "setpoint")
    most = depth.depth - 1
    depth.close()
    file = tmp_path / "all.mcap"
    assert taken(world, file) == []
    with open_recording(file) as recording:
        assert recording.is_whole and recording.problems == []
        assert recording.metadata[names.SYSTEM]["kind"] == names.DUMP
        assert recording.metadata[names.SYSTEM]["reason"] == "a test"
        assert sorted(recording.record_topics) == ["PSM1/events", "PSM1/setpoint", "PSM2/setpoint", "PSM3/setpoint"]
        first, second = recording.records("PSM1/setpoint"), recording.records("PSM2/setpoint")
        assert list(first.rows["sequence"]) == list(range(1, 11))
        assert list(second.rows["sequence"]) == list(range(7000 - most + 1, 7001))
        assert (second.rows["position"][:, 0] == second.rows["sequence"] - 1).all()
        assert len(recording.records("PSM3/setpoint").rows) == 0
        ahead_ns = local_ns() - monotonic_ns()
        assert abs(int(first.local_ns[0]) - SECOND_NS - ahead_ns) < 50_000_000


def test_a_ring_that_makes_no_sense_is_told_and_the_others_are_kept(world: World, tmp_path: Path) -> None:
    rings(world, {"PSM1": 5, "PSM2": 5})
    with path_of(segment_name(world.name, "PSM1", "setpoint")).open("r+b") as damaged:
        damaged.write(b"nonsense")
    file = tmp_path / "all.mcap"
    assert [problem.partition(":")[0] for problem in taken(world, file)] == ["PSM1/setpoint cannot be read"]
    with open_recording(file) as recording:
        assert recording.record_topics == ["PSM2/setpoint"]
        assert len(recording.records("PSM2/setpoint").rows) == 5


def test_a_full_disk_is_an_error_of_who_asked(world: World) -> None:
    class SmallDisk(io.BytesIO):
        """Takes 10 kB."""

        def write(self, data: object) -> int:
            if self.tell() > 10_000:
                raise OSError(errno.ENOSPC, "No space left on device")
            return super().write(data)  # type: ignore[arg-type]

    rings(world, {"PSM1": 3000})
    with pytest.raises(OSError, match="No space left"):
        take(world.name, SmallDisk(), {}, [])


def test_without_a_clock_page_the_time_of_day_is_that_of_now(world: World) -> None:
    assert abs(local_offset_ns(world.name) - (local_ns() - monotonic_ns())) < 50_000_000
