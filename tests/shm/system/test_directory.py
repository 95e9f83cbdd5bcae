"""The directory: what is up, by name, without a configuration."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from typing import Any

import pytest

from tests.conftest import World
from trocar.shm.commands import COMMANDS
from trocar.shm.mailbox.mailbox_map import create_mailbox
from trocar.shm.memory.segment import SegmentError
from trocar.shm.ring.slots import PlacesOnDemand
from trocar.shm.system import directory
from trocar.shm.time.control_page import create_control
from trocar.shm.topics import ARM_STATE, EVENTS, IO_STATE, SETPOINT

DIMS = {"axes": 7, "drives": 7, "robots": 1, "inputs": 2, "outputs": 0}


@pytest.fixture
def system(world: Any) -> Iterator[str]:
    """A small system: supervisor, one io, one arm."""
    for instance in ("supervisor", "IO1", "PSM1"):
        create_control(world.name, instance)
        directory.create_ring(world.name, instance, EVENTS, {}, {"kind": instance})
    create_mailbox(world.name, "IO1", "io", COMMANDS["io"])
    directory.create_ring(world.name, "IO1", IO_STATE, DIMS, {"robots": {"PSM1": 7}})
    directory.create_ring(world.name, "PSM1", SETPOINT, {}, {})
    directory.publish_document(world.name, '{"name":"größe"}'.encode())
    yield world.name
    world.remove()


def test_systems_instances_and_rings_are_found(system: str) -> None:
    assert system in directory.systems()
    assert directory.instances(system) == ["supervisor", "IO1", "PSM1"]
    assert set(directory.rings(system)) == {("IO1", "events"), ("IO1", "state"), ("PSM1", "events"),
                                            ("PSM1", "setpoint"), ("supervisor", "events")}


def test_the_document_comes_back_byte_for_byte(system: str) -> None:
    assert directory.document(system) == '{"name":"größe"}'.encode()


def test_a_document_still_being_written_is_refused(system: str) -> None:
    from trocar.shm.memory.segment import Segment, segment_name
    from trocar.shm.ring.ring import HEAD

    with Segment(segment_name(system, "supervisor", "document"), write=True) as segment:
        segment.words()[HEAD] = 0
    with pytest.raises(SegmentError, match="still being written"):
        directory.document(system)


def test_a_reader_needs_no_table(system: str) -> None:
    reader = directory.reader(system, "IO1", "state")
    assert reader.info["robots"] == {"PSM1": 7} and reader.info["dims"] == DIMS
    assert reader.field("position").shape == (7,) and reader.field("input").shape == (2,)
    reader.close()


@pytest.mark.parametrize(("rate_hz", "kept_s", "depth"), [(1500.0, 2.0, 3000), (3000.0, 0.5, 1500), (10.0, 2.0, 256)])
def test_the_depth_follows_from_seconds_and_rate(world: World, rate_hz: float, kept_s: float, depth: int) -> None:
    directory.create_ring(world.name, "PSM2", SETPOINT, {}, {"rate_hz": rate_hz}, history_s=kept_s)
    reader = directory.reader(world.name, "PSM2", "setpoint", "arm")
    assert reader.depth == depth
    reader.close()
    world.remove()


def test_a_writer_of_our_table_fits_and_another_kind_does_not(system: str) -> None:
    writer = directory.writer(system, "IO1", "state", "io")
    with pytest.raises(SegmentError, match="both must be of the same version"):
        directory.reader(system, "IO1", "state", "arm")
    with pytest.raises(SegmentError, match=r"IO1 \(pid \d+\) writes it already"):
        directory.writer(system, "IO1", "state", "io")
    writer.close()


def test_topics_are_looked_up_by_kind() -> None:
    assert directory.topic_of("arm", "state") is ARM_STATE and directory.topic_of("io", "state") is IO_STATE
    assert directory.topic_of("arm", "events") is EVENTS
    with pytest.raises(KeyError, match="arm writes no topic nothing"):
        directory.topic_of("arm", "nothing")


def test_a_system_that_is_not_up_is_told() -> None:
    with pytest.raises(SegmentError, match="is the system up"):
        directory.document("nosuchsystem")
    assert directory.instances("nosuchsystem") == []


def test_only_periodic_rings_keep_a_place_for_each_slot(system: str) -> None:
    with closing(directory.writer(system, "PSM1", "events", "arm")) as writer:
        reader = directory.reader(system, "PSM1", "events", "arm")
        assert isinstance(writer._places, PlacesOnDemand) and isinstance(reader._places, PlacesOnDemand)
        for stamp_ns in range(1, 2 * reader.depth):
            writer.publish(stamp_ns)
            assert reader.next() and reader.stamp_ns == stamp_ns
        reader.close()
    for often in (True, False):
        with closing(directory.reader(system, "PSM1", "setpoint", "arm", often=often)) as setpoint:
            assert isinstance(setpoint._places, PlacesOnDemand) is not often
