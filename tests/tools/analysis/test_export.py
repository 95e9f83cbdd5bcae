"""`trocar export`: tables have every number under its name, bags are opened by programs that are not ours."""

from __future__ import annotations

import csv
import io
import json
import sys
import tracemalloc
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore
from typer.testing import CliRunner, Result

from tests.recordings.made import BEGIN_NS, FACTS, STATE, STEP_NS, WIDE, a_recording, rows_of, written
from trocar.procs.recordings import names
from trocar.procs.recordings.chunks import ZSTD, Chunk, packed
from trocar.procs.recordings.layout import ENCAPSULATION
from trocar.procs.recordings.reading import RecordedTopic, open_recording
from trocar.procs.recordings.writing import ChannelTable, RecordingFile
from trocar.procs.ros_messages.definitions import definition
from trocar.procs.ros_messages.hashes import ros_name
from trocar.procs.ros_messages.messages import JointStates, MessageHeader, Time
from trocar.shm.memory.header import readable
from trocar.tools import cli
from trocar.tools.analysis import exporting
from trocar.tools.analysis.choosing import Stretch
from trocar.tools.analysis.exporting import RecordingTables, element_names, file_stem

APP = cli.build()


def run(*words: Any) -> Result:
    return CliRunner().invoke(APP, ["export", *map(str, words)])


def test_a_table_has_each_element_under_its_joint(tmp_path: Path) -> None:
    path, rows = a_recording(tmp_path)
    found = run(path, "-o", tmp_path / "out", "--json")
    assert found.exit_code == 0, found
    (file,) = json.loads(found.stdout)["files"]
    with Path(file).open(newline="") as stream:
        table = list(csv.DictReader(stream))
    assert len(table) == 50 and [int(row["sequence"]) for row in table] == rows["sequence"].tolist()
    joints = [readable(text) for text in rows["names"][-1].tolist()]
    for k, joint in enumerate(joints):
        values = [float(row[f"position[{joint}]"] or "nan") for row in table]
        assert np.array_equal(values, rows["position"][:, k], equal_nan=True), "all digits"
    assert [int(row["valid"]) for row in table] == rows["valid"].astype(int).tolist()
    assert [float(row["matrix[1][2]"] or "nan") for row in table] == pytest.approx(rows["matrix"][:, 1, 2], nan_ok=True)


@pytest.mark.slow
def test_one_topic_goes_to_the_output(tmp_path: Path) -> None:
    path, rows = a_recording(tmp_path)
    found = run(path, "-o", "-", "--topics", "PSM1/state", "--from", 10 * STEP_NS * 1e-9, "--to", 0.02)
    stamps = [int(row["stamp_ns"]) for row in csv.DictReader(io.StringIO(found.stdout))]
    assert stamps == rows["stamp_ns"][10:20].tolist()
    assert run(path, "-o", "-", "--format", "rosbag2").exit_code == 2


@pytest.mark.parametrize("order", ["as they came", "rings before the black box"])
def test_a_table_is_whole_and_in_order_however_it_was_recorded(tmp_path: Path, order: str,
                                                               monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(exporting, "AT_ONCE", 25)
    rows = rows_of(STATE, 95)
    kept = rows if order == "as they came" else np.concatenate([rows[50:], rows[:60]])
    path = tmp_path / "one.mcap"
    with path.open("wb", buffering=0) as stream:
        written(stream, {("PSM1", "state"): (STATE, kept)})
    said = CliRunner().invoke(cli.build("export"), ["export", str(path), "-o", "-", "--topics", "PSM1/state"])
    table = list(csv.DictReader(io.StringIO(said.stdout)))
    assert [int(row["sequence"]) for row in table] == list(range(1, 96))
    assert [int(row["fault"]) for row in table] == rows["fault"].tolist()


@pytest.mark.slow
def test_how_much_memory_a_table_takes_does_not_depend_on_its_length(tmp_path: Path,
                                                                      monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(exporting, "AT_ONCE", 500)
    peaks = []
    for count in (1_500, 6_000):
        path, _ = a_recording(tmp_path, count, f"{count}.mcap", WIDE, per_chunk=500)
        tracemalloc.start()
        with open_recording(path) as recording:
            tables = RecordingTables(recording, ["PSM1/state"], Stretch()).tables(lambda text, fraction: None)
            assert sum(len(part[0].values) for _, parts in tables for part in parts) == count
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < 1.3 * peaks[0], peaks


@pytest.mark.slow
def test_topics_without_records_are_left_out_unless_they_are_named(tmp_path: Path) -> None:
    path = tmp_path / "two.mcap"
    with path.open("wb", buffering=0) as stream:
        written(stream, {("PSM1", "state"): (STATE, rows_of(STATE, 5)), ("PSM2", "state"): (STATE, rows_of(STATE, 0))})
    for arm, words in (("PSM1", ()), ("PSM2", ("--topics", "PSM2/state"))):
        said = run(path, "-o", tmp_path / arm, *words)
        assert said.exit_code == 0, said
        assert [file.name for file in (tmp_path / arm).iterdir()] == [f"{arm}-state.csv"]


@pytest.mark.slow
def test_an_export_of_no_record_is_a_problem_and_leaves_no_folder(tmp_path: Path) -> None:
    path, _ = a_recording(tmp_path)
    assert run(path, "--from", "9", "-o", tmp_path / "none").exit_code == 1
    assert not (tmp_path / "none").exists()
    said = run(path, "--from", "500", "--topics", "PSM1/state", "-o", "-")
    assert said.exit_code == 1 and not said.stdout and "it has some from 0.000 to 0.049 s" in said.stderr


@pytest.mark.slow
def test_columns_are_called_after_joints_where_the_part_has_no_record(tmp_path: Path) -> None:
    path = tmp_path / "two.mcap"
    late = rows_of(STATE, 5)
    late["stamp_ns"] += 10**9
    with path.open("wb", buffering=0) as stream:
        written(stream, {("PSM1", "state"): (STATE, rows_of(STATE, 5)), ("PSM2", "state"): (STATE, late)})
    assert run(path, "-o", tmp_path / "all").exit_code == 0
    assert run(path, "-o", tmp_path / "part", "--to", "0.5", "--topics", "*/state").exit_code == 0
    whole, part = ((tmp_path / each / "PSM2-state.csv").read_text().splitlines() for each in ("all", "part"))
    assert part == whole[:1]


@pytest.mark.slow
def test_what_is_there_is_not_overwritten(tmp_path: Path) -> None:
    path, _ = a_recording(tmp_path)
    assert run(path).exit_code == 0 and (tmp_path / "one" / "PSM1-state.csv").is_file()
    again = run(path)
    assert again.exit_code == 2 and "is there already" in again.stderr
    assert run(path, "--format", "xlsx").exit_code == 2 and run(path, "--to", 0).exit_code == 2


def test_without_pyarrow_nothing_is_made(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    path, _ = a_recording(tmp_path)
    said = CliRunner().invoke(cli.build("export"), ["export", str(path), "-o", str(tmp_path / "out"), "--format",
                                                    "parquet"])
    assert said.exit_code == 1 and "pip install 'trocar[parquet]'" in said.stderr and not (tmp_path / "out").exists()


def test_parquet_says_what_it_needs(tmp_path: Path) -> None:
    path, rows = a_recording(tmp_path)
    found = run(path, "-o", tmp_path / "out", "--format", "parquet")
    try:
        from pyarrow import parquet
    except ImportError:
        assert found.exit_code == 1 and "pip install 'trocar[parquet]'" in found.stderr
    else:
        assert parquet.read_table(tmp_path / "out" / "PSM1-state.parquet")["sequence"].to_pylist() == rows[
            "sequence"].tolist()


@pytest.mark.slow
@pytest.mark.parametrize("part", [(), ("--from", "0.01", "--to", "0.03")])
def test_a_bag_is_opened_by_rosbags(tmp_path: Path, part: tuple[str, ...]) -> None:
    path, rows = a_recording(tmp_path)
    assert run(path, "-o", tmp_path / "bag", "--format", "rosbag2", *part).exit_code == 0
    about = yaml.safe_load((tmp_path / "bag" / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    expected = rows[10:30] if part else rows
    assert about["message_count"] == len(expected) and about["storage_identifier"] == "mcap"
    with AnyReader([tmp_path / "bag"], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as bag:
        found = [bag.deserialize(data, connection.msgtype) for connection, _, data in bag.messages()]
        assert [connection.topic for connection in bag.connections] == ["/PSM1/state"]
    assert [int(row.sequence) for row in found] == expected["sequence"].tolist()  # type: ignore[attr-defined]
    with open_recording(tmp_path / "bag" / "bag.mcap") as recording:
        kept = recording.records("PSM1/state").rows
        assert all(np.array_equal(kept[name], expected[name], equal_nan=kept[name].dtype.kind == "f")
                   for name in kept.dtype.names or ())
        assert recording.document == b"{}" and recording.metadata["trocar"]["system"] == "demo"


def with_a_view(folder: Path) -> Path:
    """Five records of PSM1/state and of its view measured_js, 10 ms apart."""
    path, table = folder / "view.mcap", ChannelTable()
    state, layout = table.ring("PSM1", "state", "arm", STATE, 1)
    view = table.channel("PSM1/measured_js", ros_name(JointStates), definition(JointStates),
                         {names.INSTANCE: "PSM1", names.RING: "state"})
    message = bytes(JointStates(MessageHeader(Time(7, 8), "base"), ["a"], [1.0], [], []).serialize())
    with path.open("wb", buffering=0) as stream:
        file, chunk = RecordingFile(stream, table, FACTS), Chunk()
        for number, row in enumerate(rows_of(STATE, 5)):
            stamp = number * 10 * STEP_NS
            row["stamp_ns"] = stamp
            chunk.add(state, number + 1, BEGIN_NS + stamp, stamp, ENCAPSULATION, row.tobytes()[: layout.size])
            chunk.add(view, number + 1, BEGIN_NS + stamp, stamp, message)
        file.put(packed(chunk, ZSTD))
        file.finish()
    return path


def test_a_view_as_a_table_is_refused_with_the_record_that_has_its_numbers(tmp_path: Path) -> None:
    said = run(with_a_view(tmp_path), "-o", "-", "--topics", "PSM1/measured_js")
    assert said.exit_code == 1 and not said.stdout and said.stderr == (
        "trocar: PSM1/measured_js: csv is for records, not for ROS messages; choose PSM1/state or --format rosbag2\n")


@pytest.mark.parametrize("topics", [(), ("--topics", "PSM1/measured_js")])
def test_a_part_of_a_bag_has_its_views(tmp_path: Path, topics: tuple[str, ...]) -> None:
    said = run(with_a_view(tmp_path), "-o", tmp_path / "bag", "--format", "rosbag2", "--from", "0.015", *topics)
    assert said.exit_code == 0, said.stderr
    with open_recording(tmp_path / "bag" / "bag.mcap") as recording:
        assert len(list(recording.messages("PSM1/measured_js"))) == 3


def test_a_damaged_recording_gives_what_can_be_read(tmp_path: Path) -> None:
    path, _ = a_recording(tmp_path, finish=False)
    found = run(path, "-o", tmp_path / "bag", "--format", "rosbag2")
    assert found.exit_code == 1 and "its writer did not close it" in found.stderr
    assert (tmp_path / "bag" / "metadata.yaml").is_file()


def test_axes_of_an_io_are_called_after_robots_and_joints() -> None:
    info = {"dims": {"axes": 5}, "robots": {"PSM1": {"first": 1, "count": 2, "names": ["yaw", "pitch"]},
                                            "bad": {"first": "x", "names": 3}}}
    topic = RecordedTopic("IO1/state", "", info=info)
    assert element_names(topic, rows_of(STATE, 0)) == {5: ("0", "PSM1.yaw", "PSM1.pitch", "3", "4")}
    assert [file_stem(name) for name in ("PSM1/state", "../x", "")] == ["PSM1-state", "-x", "topic"]
