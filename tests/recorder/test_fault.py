"""After a fault: which events are one, and what of before and after is in its file."""

from __future__ import annotations

import threading

import pytest

from tests.recorder.harness import RingsOfATest
from trocar.procs.recorder.files import kept
from trocar.procs.recorder.watch import SeenFault
from trocar.procs.recordings import names
from trocar.procs.recordings.reading import open_recording


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
