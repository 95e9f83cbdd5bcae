"""The black box: what it takes, how much of it stays, and what a disk does to it."""

from __future__ import annotations

import errno
import io
import os
import threading
from pathlib import Path

import pytest

from tests.recorder.harness import RingsOfATest
from trocar.procs.recorder.disk import Disk
from trocar.procs.recorder.files import path_of, too_old
from trocar.procs.recordings import names
from trocar.procs.recordings.chunks import Chunk
from trocar.procs.recordings.folder import KeptFile, kept
from trocar.procs.recordings.reading import open_recording


@pytest.mark.slow
def test_events_are_complete_and_records_are_samples(rings: RingsOfATest) -> None:
    rings.events.status("before it began", "PSM1")
    box = rings.box()
    for n in range(30):
        rings.write(10)
        rings.events.emit("goal_reached", value=float(n))
        rings.passes(n * 0.02)
        box.step()
    box.close()
    rings.written()
    with open_recording(rings.begun[0].path) as recording:
        assert recording.is_whole
        events = recording.events()
        assert events[0]["text"] == "PSM1: before it began"
        assert [row["value"] for row in events[1:]] == [float(n) for n in range(30)]
        found = recording.records("PSM1/state")
        assert 25 <= len(found.rows) <= 30
        assert found.rows["sequence"][-1] == 300
        assert recording.topics["PSM1/measured_js"].type_name == "sensor_msgs/msg/JointState"
        assert 5 <= len(list(recording.messages("PSM1/measured_js"))) <= 8
        assert [len(list(recording.messages("PSM1/log")))] == [1]
        assert abs(found.local_ns[-1] - rings.times.local_ns) < 60e9


def test_a_record_is_taken_once(rings: RingsOfATest) -> None:
    box = rings.box()
    rings.write(1)
    for n in range(10):
        rings.passes(n * 0.1)
        box.step()
    box.close()
    rings.written()
    with open_recording(rings.begun[0].path) as recording:
        assert len(list(recording.messages("PSM1/state"))) == 1


def test_the_rate_can_be_changed_while_it_runs(rings: RingsOfATest) -> None:
    box = rings.box()
    box.limits.rate_hz = 1.0
    for n in range(40):
        rings.write(1)
        rings.passes(n * 0.1)
        box.step()
    box.close()
    rings.written()
    with open_recording(rings.begun[0].path) as recording:
        assert len(recording.records("PSM1/state").rows) == 4


def test_a_file_that_is_full_is_ended_and_the_oldest_go(rings: RingsOfATest) -> None:
    box = rings.box(size_mb=0.1)  # a file of a second has more than a tenth of that
    rings.seldom.field("number")[...] = 3.0
    rings.seldom.publish(5)
    for n in range(30):
        rings.write(1)
        rings.passes(2.0 * n)
        rings.times.local_ns += 2_000_000_000 * n
        box.step()
        rings.idle()
    box.close()
    rings.written()
    left = kept(rings.folder, names.BOX)
    assert len(rings.begun) > 20
    assert sum(file.size for file in left) < 400_000
    assert left[-1].path == rings.begun[-1].path
    for file in left:
        with open_recording(file.path) as recording:
            assert recording.is_whole
            assert recording.records("box/gains").rows["number"].tolist() == [3.0]
            assert abs(recording.begin_ns - names.time_in(file.path.name)) < 3600e9


def test_what_stays_is_bounded_by_age_and_by_size() -> None:
    files = [KeptFile(Path(str(n)), 10, n * 1_000_000_000) for n in range(10)]
    assert too_old(files, 9_500_000_000, 5.0, 1000) == [Path(str(n)) for n in range(5)]
    assert too_old(files, 9_500_000_000, 100.0, 35) == [Path(str(n)) for n in range(7)]
    assert too_old(files, 9_500_000_000, 5.0, 0) == [Path(str(n)) for n in range(10)]


@pytest.mark.parametrize("step_s", [86400, -86400])
def test_a_clock_that_is_set_makes_no_file_older(rings: RingsOfATest, step_s: int) -> None:
    former = path_of(rings.folder, names.BOX, rings.times.local_ns - 60_000_000_000)
    former.write_bytes(b"of a process before")
    os.utime(former, ns=(rings.times.local_ns - 60_000_000_000,) * 2)
    box = rings.box(minutes=0.5 + 1.0)
    for n in range(8):
        rings.write(1)
        rings.passes(12.0 * n)
        rings.times.local_ns += n * 12_000_000_000 + (step_s * 1_000_000_000 if n > 3 else 0)
        box.step()
        rings.idle()
        if n > 3:  # as its clock says
            os.utime(rings.begun[-1].path, ns=(rings.times.local_ns,) * 2)
    left = {file.path for file in kept(rings.folder, names.BOX)}
    assert former not in left and left == {file.path for file in rings.begun}
    assert box.remove_oldest() and not rings.begun[0].path.exists()
    box.close()


def test_names_of_files_are_in_the_order_of_time(tmp_path: Path) -> None:
    made = [path_of(tmp_path, names.BOX, n * 1_700_000_000_123_000_000).name for n in range(3)]
    assert made == sorted(made)
    assert made[0] == "box-19700101-000000.000.mcap"
    assert path_of(tmp_path, names.FAULT, 0, "PSM1").name == "fault-19700101-000000.000-PSM1.mcap"
    assert path_of(tmp_path, names.NAMED, 0, "grasp").name == "grasp-19700101-000000.000.mcap"


class DiskOfATest(io.BytesIO):
    """Has room for so many bytes, all files together."""

    room = 1 << 20

    def write(self, data):
        if DiskOfATest.room < len(data):
            raise OSError(28, "No space left on device")
        DiskOfATest.room -= len(data)
        return super().write(data)

    def close(self) -> None:
        """Its content is wanted."""


def test_a_full_disk_drops_and_counts_and_goes_on_when_there_is_room(rings: RingsOfATest) -> None:
    disk = DiskOfATest()
    rings.opened = lambda path: disk
    DiskOfATest.room = 1 << 20
    box = rings.box()

    def goes_on(seconds: float) -> None:
        rings.write(5)
        rings.passes(seconds)
        box.step()
        rings.idle()

    goes_on(0.0)
    assert not box.all_dropped
    DiskOfATest.room = 10
    goes_on(2.0)
    assert box.all_dropped > 0
    assert "No space" in rings.disk.problem
    DiskOfATest.room = 1 << 20
    dropped = box.all_dropped
    goes_on(4.0)
    assert (box.all_dropped, rings.disk.problem) == (dropped, "")
    box.close()
    rings.written()
    path = rings.folder / "disk.mcap"
    path.write_bytes(disk.getvalue())
    with open_recording(path) as recording:
        assert recording.is_whole
        assert recording.metadata[names.LOSSES]["dropped"] == str(dropped)
        assert recording.records("PSM1/state").rows["sequence"].tolist() == [5, 15]


class SmallFile(io.FileIO):
    """A real file on a disk that has room for so many bytes."""

    room = 0

    def write(self, data):
        if SmallFile.room < len(data):
            raise OSError(28, "No space left on device")
        SmallFile.room -= len(data)
        return super().write(data)


def test_a_file_that_could_not_be_begun_is_begun_when_there_is_room(rings: RingsOfATest) -> None:
    rings.opened = lambda path: SmallFile(path, "xb")
    SmallFile.room = 3
    box = rings.box()
    for seconds in (0.0, 2.0):
        rings.write(5)
        rings.passes(seconds)
        box.step()
        rings.idle()
        assert "No space" in rings.disk.problem and not rings.begun[0].path.exists()
    dropped = box.all_dropped
    SmallFile.room = 1 << 20
    rings.write(5)
    rings.passes(4.0)
    box.step()
    rings.idle()
    assert dropped and (box.all_dropped, rings.disk.problem) == (dropped, "")
    box.close()
    rings.written()
    with open_recording(rings.begun[0].path) as recording:
        assert recording.is_whole and recording.records("PSM1/state").rows["sequence"].tolist() == [15]


def test_files_that_never_came_to_be_are_forgotten_but_not_what_they_dropped(rings: RingsOfATest) -> None:
    rings.opened = lambda path: SmallFile(path, "xb")
    SmallFile.room = 3
    box = rings.box(minutes=0.1)
    for n in range(8):
        rings.write(1)
        rings.passes(n)
        rings.times.local_ns += 2_000_000 * n  # names of files have ms
        box.step()
        rings.idle()
    SmallFile.room = 1 << 20
    box.close()
    rings.written()
    assert len(rings.begun) >= 7 and len(box.files) <= 2
    assert box.all_dropped == sum(file.dropped for file in rings.begun) > 7


@pytest.mark.parametrize(("error", "said"), [
    (OSError(errno.EIO, "Input/output error"), "Input/output error"), (OSError(errno.EINVAL, "Invalid argument"), "")])
def test_what_a_disk_does_not_write_back_is_told(rings: RingsOfATest, monkeypatch: pytest.MonkeyPatch, error: OSError,
                                                 said: str) -> None:
    def refuses(fd: int) -> None:
        raise error

    monkeypatch.setattr("trocar.procs.recorder.disk.os.fdatasync", refuses)
    box = rings.box()
    rings.write(5)
    rings.passes()
    box.step()
    rings.idle()
    assert rings.disk.problem == rings.begun[0].problem == said
    assert rings.begun[0].has_failed == bool(said)
    box.close()
    rings.written()
    assert rings.begun[0].is_ended


def test_a_disk_that_hangs_holds_nobody_up_and_memory_is_bounded(rings: RingsOfATest) -> None:
    goes, rings.disk = threading.Event(), Disk(most=100_000)
    rings.opened = lambda path: (goes.wait(60.0), open(path, "xb", buffering=0))[1]  # noqa: PTH123, SIM115
    box = rings.box()
    for n in range(200):
        rings.write(1)
        rings.passes(n)
        box.step()
        assert rings.disk.waiting <= 100_000
    assert box.all_dropped > 0
    goes.set()
    box.close()
    rings.written()
    with open_recording(rings.begun[0].path) as recording:
        assert len(recording.records("PSM1/state").rows)


def test_a_chunk_without_messages_is_not_written(rings: RingsOfATest) -> None:
    file = rings.begin_file(rings.folder / "none.mcap", names.BOX)
    assert file.put(Chunk(), "zstd")
    file.finish({}, names.LOSSES)
    rings.written()
    assert not file.path.exists()


def test_an_accident_of_one_write_does_not_end_the_writing(rings: RingsOfATest) -> None:
    rings.disk.do(lambda: [][0], 1)
    rings.idle()
    assert "IndexError" in rings.disk.problem
    box = rings.box()
    rings.write(1)
    rings.passes()
    box.step()
    box.close()
    rings.written()
    assert rings.disk.problem == ""


def test_a_file_that_is_old_is_ended(rings: RingsOfATest) -> None:
    box = rings.box(minutes=0.1)
    for n in range(1, 6):
        rings.write(1)
        rings.passes(0.7 * n)
        rings.times.local_ns += 2_000_000 * n  # names of files have ms
        box.step()
        box.flush()
    box.close()
    rings.written()
    assert len(rings.begun) >= 3
    assert all(file.is_ended for file in rings.begun)
