"""Faults one after the other, and wishes to keep what is: each is in a file, and whoever asked hears of it."""

from __future__ import annotations

import io
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from tests.recorder.harness import RingsOfATest
from trocar.procs.recorder import fault, keeping
from trocar.procs.recorder.fault import FaultRecording
from trocar.procs.recorder.files import path_of
from trocar.procs.recorder.keeping import ASKED, FaultKeeper
from trocar.procs.recorder.watch import SeenFault
from trocar.procs.recordings import names
from trocar.procs.recordings.folder import kept
from trocar.procs.recordings.reading import open_recording
from trocar.shm.time.clock import monotonic_ns

KEEP = 10


@dataclass
class Wish:
    """A command `keep`, and what was answered."""

    answers: list[str] = field(default_factory=list)

    def done(self, text: str = "") -> None:
        self.answers.append(f"done: {text}")

    def fail(self, reason: str) -> None:
        self.answers.append(f"failed: {reason}")


class Kept:
    """A keeper on rings of a test, and what it told."""

    def __init__(self, rings: RingsOfATest) -> None:
        self.rings, self.box, self.told = rings, rings.box(), list[FaultRecording]()
        self.keeper = FaultKeeper(rings.folder, rings.disk, rings.sources, rings.times, self.box, self._begin,
                                  self.told.append)
        self.at_s = 0.0

    def _begin(self, fault: FaultRecording) -> Any:
        self.rings.times.local_ns += 1_000_000  # names of files have ms
        return self.rings.begin_fault(fault, self.box.remove_oldest)

    def saw(self, who: str, asked: Any = None) -> None:
        self.keeper.saw(SeenFault(who, f"{who} is in FAULT"), asked)

    def goes_on(self, until_s: float) -> None:
        while self.at_s < until_s:
            self.at_s = round(self.at_s + 0.02, 3)
            self.rings.write(20)
            self.rings.passes(self.at_s)
            self.box.step()
            self._works()

    def gets_time(self, enough: Callable[[], bool]) -> None:
        """What a busy machine did not do in its slice, at the same time of the system."""
        end_ns = monotonic_ns() + 30_000_000_000
        while not enough() and monotonic_ns() < end_ns:
            self._works()

    def _works(self) -> None:
        self.keeper.step("zstd", KEEP)
        written = threading.Event()
        self.rings.disk.do(written.set)
        assert written.wait(30.0)


@pytest.fixture
def keeping_of(rings: RingsOfATest, monkeypatch: pytest.MonkeyPatch) -> Iterator[Kept]:
    monkeypatch.setattr(fault, "SLICE_NS", 10_000_000_000)  # real time, in which a busy machine might do nothing
    found = Kept(rings)
    yield found
    found.box.close()


def test_what_comes_soon_after_is_in_the_same_file_and_what_comes_later_in_the_next(keeping_of: Kept) -> None:
    keeping_of.saw("PSM1")
    keeping_of.goes_on(0.2)
    keeping_of.saw("PSM2")
    keeping_of.goes_on(0.5)
    for who, until_s in (("PSM3", 0.7), ("IO1", 1.0), ("PSM3", 1.5)):  # the rings of the first are taken
        keeping_of.saw(who)
        keeping_of.goes_on(until_s)
    assert [fault.reason for fault in keeping_of.told] == ["PSM1 is in FAULT; PSM2 is in FAULT"]
    keeping_of.goes_on(4.0)
    assert [fault.reason for fault in keeping_of.told][1:] == ["PSM3 is in FAULT; IO1 is in FAULT"]
    assert keeping_of.keeper.is_idle
    assert len(kept(keeping_of.rings.folder, names.FAULT)) == 2
    keeping_of.saw("PSM1")
    keeping_of.goes_on(7.0)
    assert len(keeping_of.told) == 3


@pytest.mark.slow
def test_of_the_black_box_the_second_of_two_has_what_the_first_has_not(keeping_of: Kept) -> None:
    keeping_of.goes_on(3.0)
    keeping_of.saw("PSM1")
    keeping_of.goes_on(3.5)
    keeping_of.saw("PSM2")
    keeping_of.goes_on(7.0)
    firsts = []
    for file in kept(keeping_of.rings.folder, names.FAULT):
        with open_recording(file.path) as recording:
            assert recording.is_whole
            firsts.append(next(iter(recording.messages("PSM1/measured_js")))[1])
    assert len(firsts) == 2 and firsts[0] < firsts[1], "views are of the box alone"


def test_whoever_wants_to_keep_hears_of_it_when_it_is_written(keeping_of: Kept) -> None:
    first, second = Wish(), Wish()
    keeping_of.saw("PSM1")
    keeping_of.goes_on(0.1)
    keeping_of.saw(ASKED, first)
    keeping_of.goes_on(1.0)
    keeping_of.gets_time(lambda: bool(first.answers))
    assert first.answers == [f"done: kept in {keeping_of.told[0].file.path}"]
    keeping_of.saw(ASKED, second)
    keeping_of.goes_on(1.5)
    assert second.answers == []
    keeping_of.goes_on(4.0)
    keeping_of.gets_time(lambda: bool(second.answers))
    assert second.answers == [f"done: kept in {keeping_of.told[1].file.path}"]


class NoRoom(io.BytesIO):
    """A disk that takes nothing."""

    def write(self, data: Any) -> int:
        raise OSError(28, "No space left on device")


def test_a_wish_that_the_disk_does_not_take_fails(keeping_of: Kept) -> None:
    wish = Wish()
    keeping_of.rings.opened = lambda path: NoRoom()
    keeping_of.saw(ASKED, wish)
    keeping_of.goes_on(2.5)
    assert wish.answers == ["failed: not all of it could be written: No space left on device"]


def test_a_fault_is_told_when_its_file_has_ended_and_not_before(keeping_of: Kept) -> None:
    goes = threading.Event()
    keeping_of.rings.write(20)
    keeping_of.saw("PSM1")
    keeping_of.rings.disk.do(lambda: goes.wait(30.0) and None)
    for n in range(100):
        keeping_of.rings.passes(0.05 * n)
        keeping_of.keeper.step("zstd", KEEP)
    assert keeping_of.told == []
    goes.set()
    keeping_of.gets_time(lambda: bool(keeping_of.told))
    [fault] = keeping_of.told
    assert fault.file is not None and fault.file.is_complete and fault.file.path.exists()


def test_what_a_full_disk_did_not_take_of_a_fault_is_counted(keeping_of: Kept) -> None:
    keeping_of.rings.opened = lambda path: NoRoom()
    keeping_of.saw("PSM1")
    keeping_of.goes_on(2.5)
    [fault] = keeping_of.told
    assert fault.file is not None and not fault.file.is_complete and not fault.file.size
    assert fault.file.problem == "No space left on device"
    assert keeping_of.keeper.dropped == fault.file.dropped > 0
    keeping_of.saw("PSM1")
    keeping_of.goes_on(5.0)
    assert keeping_of.keeper.dropped == sum(each.file.dropped for each in keeping_of.told if each.file is not None)


class Shared(io.FileIO):
    """A file on a disk that has room for so many bytes, all its files together."""

    folder, most = Path(), 0

    def write(self, data: Any) -> int:
        if sum(path.stat().st_size for path in self.folder.glob("*.mcap")) + len(data) > self.most:
            raise OSError(28, "No space left on device")
        return super().write(data)


def test_the_oldest_of_the_black_box_makes_room_for_a_fault(keeping_of: Kept) -> None:
    folder = keeping_of.rings.folder
    keeping_of.goes_on(0.1)
    for n in range(3):
        old = path_of(folder, names.BOX, n * 1_000_000_000)
        old.write_bytes(bytes(100_000))
    Shared.folder, Shared.most = folder, 330_000
    keeping_of.rings.opened = lambda path: Shared(path, "xb")
    keeping_of.saw("PSM1")
    keeping_of.goes_on(2.5)
    [fault] = keeping_of.told
    assert fault.file is not None and fault.file.is_complete, fault.file
    left = [file.path.name for file in kept(folder, names.BOX)]
    assert "box-19700101-000000.000.mcap" not in left and len(left) >= 2


@pytest.mark.slow
def test_more_wishes_than_can_wait_are_refused(keeping_of: Kept, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(keeping, "MAX_QUEUE", 2)
    keeping_of.saw("PSM1")
    keeping_of.goes_on(0.6)
    keeping_of.saw("PSM2")
    keeping_of.saw("PSM3")
    with pytest.raises(ValueError, match="2 are already waiting to be saved"):
        keeping_of.saw(ASKED, Wish())


def test_whoever_ends_keeps_what_had_just_begun(keeping_of: Kept) -> None:
    wish = Wish()
    keeping_of.goes_on(0.1)
    keeping_of.saw("PSM1")
    keeping_of.goes_on(0.6)
    keeping_of.saw("PSM2")
    keeping_of.saw(ASKED, wish)
    keeping_of.keeper.end("zstd", KEEP, 20.0)
    assert keeping_of.keeper.is_idle and len(keeping_of.told) == 2
    assert wish.answers == [f"done: kept in {keeping_of.told[1].file.path}"]
    keeping_of.rings.idle()
    for file in kept(keeping_of.rings.folder, names.FAULT):
        with open_recording(file.path) as recording:
            assert recording.is_whole and len(recording.records("PSM1/state").rows)
