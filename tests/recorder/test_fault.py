"""After a fault: which events are one, and what of before and after is in its file."""

from __future__ import annotations

import itertools
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.conftest import World
from tests.recorder.harness import RingsOfATest
from trocar.procs.recorder import fault as fault_file
from trocar.procs.recorder.sources import LocalTimes, RecordedRing
from trocar.procs.recorder.watch import SeenFault
from trocar.procs.recordings import names
from trocar.procs.recordings.folder import kept
from trocar.procs.recordings.reading import open_recording
from trocar.shm.memory.segment import names_of, segment_name, unlink
from trocar.shm.system import directory
from trocar.shm.time.control_page import create_control
from trocar.shm.topics import ARM_STATE, IO_STATE, TELEOP_STATE, Topic


def test_all_that_rings_have_and_the_box_before_is_kept(rings: RingsOfATest) -> None:
    box = rings.box()
    for n in range(40):
        rings.write(200)
        rings.passes(n * 0.02)
        box.step()
    fault = rings.fault()
    fault.add(fault.faults[0])
    assert not fault.step("zstd")
    rings.passes(2.0)
    while not fault.step("zstd"):
        pass
    box.flush()
    fault.finish(rings.folder, rings.disk, [file.path for file in box.files], 3)
    box.close()
    rings.written()
    [file] = kept(rings.folder, names.FAULT)
    with open_recording(file.path) as recording:
        assert recording.is_whole
        assert not recording.problems
        whole = recording.records("PSM1/state").rows["sequence"]
        depth = rings.sources.rings["PSM1/state"].sampler.depth
        assert set(range(8000 - depth + 2, 8001)) <= set(whole.tolist())
        assert whole[0] == 200  # of the black box
        setpoints = recording.records("PSM1/setpoint").rows["sequence"]
        assert len(setpoints) > 1490


@pytest.mark.parametrize("has_made_room", [False, True])
def test_what_made_room_for_a_fault_is_said_to_be_missing(rings: RingsOfATest, has_made_room: bool) -> None:
    rings.write(200)
    fault = rings.fault()
    rings.passes(2.0)
    while not fault.step("zstd"):
        pass
    assert fault.file is not None
    fault.file.has_made_room = has_made_room
    fault.finish(rings.folder, rings.disk, [rings.folder / "box-that-is-gone.mcap"], 3)
    rings.written()
    assert fault.file.is_ended and fault.file.is_complete != has_made_room
    made_room = "the oldest file of the black box was deleted to make room for it"
    assert fault.file.problem == (made_room if has_made_room else "")
    with open_recording(fault.file.path) as recording:
        assert recording.is_whole and len(recording.records("PSM1/state").rows) > 100


def test_so_many_are_kept_and_no_more(rings: RingsOfATest) -> None:
    for n in range(5):
        rings.passes(10.0 * n)
        rings.times.local_ns += n * 1_000_000_000
        fault = rings.fault()
        rings.passes(10.0 * n + 1.0)
        rings.times.local_ns += n * 1_000_000_000
        while not fault.step("zstd"):
            pass
        fault.finish(rings.folder, rings.disk, [], 2)
    rings.written()
    assert len(kept(rings.folder, names.FAULT)) == 2


def test_the_first_since_all_was_well_goes_last_and_the_newest_stays(rings: RingsOfATest) -> None:
    names_of, firsts = list[str](), (False, True, False, False, False, True)
    for n, is_first in enumerate(firsts):
        rings.write(20)
        rings.passes(10.0 * n)
        rings.times.local_ns += n * 1_000_000_000
        fault = rings.fault(is_first=is_first)
        rings.times.monotonic_ns += 1_000_000_000
        while not fault.step("zstd"):
            pass
        assert fault.file is not None
        names_of.append(fault.file.path.name)
        fault.finish(rings.folder, rings.disk, [], 3)
        removed = threading.Event()
        rings.disk.do(removed.set)
        assert removed.wait(30.0)
        left = {file.path.name for file in kept(rings.folder, names.FAULT)}
        firsts_so_far = {name for name, first in zip(names_of, firsts, strict=False) if first}
        assert {names_of[-1], *firsts_so_far} <= left and len(left) == min(n + 1, 3)


def test_what_follows_soon_belongs_to_it(rings: RingsOfATest) -> None:
    fault = rings.fault("PSM1: too hot")
    assert not fault.step("zstd") and fault.takes_more
    rings.passes(1.0)
    fault.add(SeenFault("PSM2", "PSM2 is in FAULT"))
    while not fault.step("zstd"):
        pass
    assert not fault.takes_more and not fault.is_quiet and fault.reason == "PSM1: too hot; PSM2 is in FAULT"
    rings.passes(3.0)
    assert fault.is_quiet
    fault.close()


def test_no_record_is_overwritten_while_others_are_taken(rings: RingsOfATest, monkeypatch: pytest.MonkeyPatch) -> None:
    depth, keep = rings.sources.rings["PSM1/setpoint"].sampler.depth, RecordedRing.keep_copied

    def slow(ring: RecordedRing, *arguments: Any) -> None:
        rings.write(500)  # meanwhile
        keep(ring, *arguments)

    rings.write(depth)
    fault = rings.fault()
    rings.passes(2.0)
    monkeypatch.setattr(RecordedRing, "keep_copied", slow)
    while not fault.step("zstd"):
        pass
    fault.finish(rings.folder, rings.disk, [], 1)
    rings.written()
    assert not any(fault.lost.values()) and fault.file is not None
    with open_recording(fault.file.path) as recording:
        for topic in ("PSM1/state", "PSM1/setpoint"):
            rows = recording.records(topic).rows
            assert rows["sequence"].tolist() == list(range(2, depth + 1)) and np.all(np.diff(rows["stamp_ns"]) > 0)


def test_a_file_that_the_recorder_ends_early_counts_what_it_lacks(
    rings: RingsOfATest, monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(fault_file, "monotonic_ns", itertools.count(0, 5_000_000).__next__)  # a slow disk
    rings.write(rings.sources.rings["PSM1/state"].sampler.depth)
    fault = rings.fault()
    fault.step("zstd", hurry=True)
    left = sum(len(rows) for _, rows in fault._copied)
    assert left and fault.file is not None
    fault.finish(rings.folder, rings.disk, [], 1)
    rings.written()
    assert not fault.file.is_complete and sum(fault.lost.values()) >= left


def test_a_ring_that_is_out_of_reach_does_not_prevent_the_recording_of_the_others(rings: RingsOfATest) -> None:
    rings.write(100)
    fault = rings.fault()
    for parts in names_of(rings.system):
        unlink(segment_name(*parts))  # and no supervisor has them
    while not fault.step("zstd", hurry=True):
        pass
    fault.finish(rings.folder, rings.disk, [], 1)
    rings.written()
    assert fault.file is not None
    with open_recording(fault.file.path) as recording:
        assert len(recording.records("PSM1/state").rows) == 100


DIMS = {"axes": 7, "drives": 7, "robots": 1, "inputs": 0, "outputs": 0, "readers": 0}


@pytest.fixture
def beside(world: World, tmp_path: Path) -> Iterator[Callable[..., RingsOfATest]]:
    """Makes the usual rings, and other instances with a state each, which keeps so long."""
    made: list[RingsOfATest] = []

    def make(history_s: float, **others: Topic) -> RingsOfATest:
        for instance, topic in others.items():
            create_control(world.name, instance, topics=[topic])
            directory.create_ring(world.name, instance, topic, DIMS, {"kind": topic.writer}, history_s=history_s)
        made.append(RingsOfATest(world.name, tmp_path))
        return made[-1]

    yield make
    for rings in made:
        rings.close()
    world.remove()


def test_rings_of_io_and_the_instance_in_fault_are_copied_first_and_others_count_their_losses(
    beside: Callable[..., RingsOfATest], monkeypatch: pytest.MonkeyPatch,
) -> None:
    rings, copied, copy = beside(0.3, ECM=ARM_STATE, IO1=IO_STATE), list[str](), RecordedRing.copy
    ecm = directory.writer(rings.system, "ECM", "state", "arm")

    def slow(ring: RecordedRing) -> Any:
        ecm.publish(ecm.stamp_ns + 1)  # meanwhile
        rings.write(10)
        copied.append(ring.topic)
        return copy(ring)

    depth = rings.sources.rings["ECM/state"].sampler.depth
    for _ in range(depth):
        ecm.publish(ecm.stamp_ns + 1)
    rings.write(200)
    fault = rings.fault()
    monkeypatch.setattr(RecordedRing, "copy", slow)
    while not fault.step("zstd", hurry=True):
        pass
    fault.finish(rings.folder, rings.disk, [], 1)
    rings.written()
    ecm.close()
    assert set(copied[:3]) == {"IO1/state", "PSM1/state", "PSM1/setpoint"} and "ECM/state" in copied[3:]
    assert fault.file is not None
    with open_recording(fault.file.path) as recording:
        losses = recording.metadata[names.LOSSES]
        assert losses["PSM1/state"] == losses["IO1/state"] == "0"  # they were not full
        before = copied.index("ECM/state") + 1
        assert losses["ECM/state"] == str(before) and len(recording.records("ECM/state").rows) == depth - 1


@pytest.mark.parametrize("topic", [IO_STATE, ARM_STATE, TELEOP_STATE], ids=lambda topic: topic.writer)
def test_rings_that_keep_little_are_taken_sooner(beside: Callable[..., RingsOfATest], topic: Topic) -> None:
    rings = beside(0.3, other=topic)
    fault = rings.fault()
    rings.passes(0.09)
    assert not fault.step("zstd") and fault.takes_more
    rings.passes(0.11)
    fault.step("zstd")
    assert not fault.takes_more
    fault.close()


@pytest.mark.parametrize(("simulated", "system_s", "is_taken"), [
    (True, 0.09, False), (True, 0.11, True), (False, 9.0, False),
])
def test_simulated_time_that_passes_faster_ends_the_delay(
    beside: Callable[..., RingsOfATest], simulated: bool, system_s: float, is_taken: bool,
) -> None:
    rings = beside(0.3, other=ARM_STATE)
    time: Any = SimpleNamespace(simulated=simulated, now_ns=lambda: 5_000_000_000)
    rings.times = LocalTimes(time)
    fault = rings.fault()
    rings.times.system_ns += round(system_s * 1e9)
    rings.times.monotonic_ns += 10_000_000
    fault.step("zstd")
    assert fault.takes_more != is_taken
    fault.close()
