"""The format of recordings: nothing is lost, readers of others open it, and what is cut off is readable so far."""

from __future__ import annotations

import io
import json
import re
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcap.exceptions import EndOfFile
from mcap.reader import NonSeekingReader, make_reader
from mcap.records import Message
from mcap.stream_reader import StreamReader
from rosbags.rosbag2.storage_mcap import McapReader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from tests.examples import examples
from tests.recordings.made import BEGIN_NS, FACTS, STATE, a_recording, in_memory, rows_of, written
from trocar.procs.recordings import names, reading
from trocar.procs.recordings.chunks import COMPRESSIONS, Chunk, packed
from trocar.procs.recordings.layout import ENCAPSULATION, _unique, layout_of
from trocar.procs.recordings.reading import RecordingError, open_recording
from trocar.procs.recordings.writing import MAGIC, ChannelTable, RecordingFile
from trocar.procs.ros_messages.definitions import definition
from trocar.procs.ros_messages.hashes import ros_name
from trocar.procs.ros_messages.messages import JointStates, MessageHeader, Time
from trocar.shm.memory.layout import schema_of
from trocar.shm.memory.rows import Field, Topic

TYPE_NAME = re.compile(r"[a-z][a-z0-9_]*/msg/[A-Z][A-Za-z0-9]*")
FIELD_LINE = re.compile(r"(bool|u?int(8|16|32|64)|float(32|64))(\[[1-9][0-9]*\])? [a-z]([a-z0-9]|_[a-z0-9])*(  # .*)?")

scalars = st.sampled_from(["?", "u1", "i1", "<u2", "<i2", "<u4", "<i4", "<u8", "<i8", "<f4", "<f8", "S1", "S13"])
shapes = st.sampled_from(["", "(1,)", "(3,)", "(0,)", "(2,3)", "(0,2)"])
fields = st.lists(st.tuples(scalars, shapes), min_size=0, max_size=12)
field_names = ("Name", "a__b", "a/b", "padding_16", "x-", "_y", "Z9", "name", "a_b", "velocity", "q", "r", "s", "t")


def schema_from(drawn: list[tuple[str, str]]) -> object:
    rows = tuple(Field(field_names[n], shape + scalar, "m", "what it is") for n, (scalar, shape) in enumerate(drawn))
    return schema_of(Topic("odd-topic", "user", rate_hz=10, depth=10, fields=rows))


@examples(60)
@given(fields, st.integers(0, 1 << 30), st.sampled_from(sorted(COMPRESSIONS)))
def test_what_is_written_is_what_is_read(tmp_path_factory, drawn, seed, compression):
    schema = schema_from(drawn)
    rows = rows_of(schema, 7, seed)
    path = tmp_path_factory.mktemp("round") / "one.mcap"
    with path.open("wb", buffering=0) as stream:
        written(stream, {("box", "odd-topic"): (schema, rows)}, 3, COMPRESSIONS[compression])
    with open_recording(path) as recording:
        found = recording.records("box/odd-topic")
        assert recording.is_whole
        assert not recording.problems
    for name in schema.dtype.names:
        assert found.rows[name].tobytes() == rows[name].tobytes()
    assert (found.local_ns == BEGIN_NS + rows["stamp_ns"]).all()
    assert found.missing == 0


@examples(40)
@given(fields, st.integers(0, 1 << 30))
@pytest.mark.slow
def test_a_record_is_the_message_that_ros_would_write(drawn, seed):
    schema = schema_from(drawn)
    layout, row = layout_of("user", schema), rows_of(schema, 1, seed)
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(layout.definition, layout.type_name))
    data = b"\0\1\0\0" + row.tobytes()[: layout.size]
    message = store.deserialize_cdr(data, layout.type_name)
    assert message.sequence == row["sequence"][0]
    shown = [name for name in vars(message) if not name.startswith(("__", "padding"))]
    kept = [name for name in schema.dtype.names if schema.dtype[name].itemsize and name != "padding_16"]
    for ours, theirs in zip(kept, [name for name in shown if name in [*shown]], strict=False):
        if (kind := schema.dtype[ours].base.kind) != "S":
            values = np.ravel(getattr(message, theirs))
            assert np.array_equal(values, np.ravel(row[ours][0]), equal_nan=kind == "f"), ours


def test_schemas_follow_the_rules_of_foxglove():
    layout = layout_of("third_party", STATE)
    assert TYPE_NAME.fullmatch(layout.type_name)
    for line in layout.definition.splitlines():
        assert FIELD_LINE.fullmatch(line), line
    nested = definition(JointStates).split("=" * 80 + "\n")
    assert [text.splitlines()[0] for text in nested[1:]] == ["MSG: builtin_interfaces/Time", "MSG: std_msgs/Header"]
    assert len({line.split()[1] for line in layout.definition.splitlines()}) == len(layout.definition.splitlines())


def test_rosbags_reads_records_and_joint_states(tmp_path: Path):
    message = JointStates(MessageHeader(Time(7, 8), "base"), ["a", "b"], [1.0, 2.0], [], [0.5, -0.5])
    table, path = ChannelTable(), tmp_path / "joints.mcap"
    with path.open("wb", buffering=0) as stream:
        channel = table.channel("PSM1/measured_js", ros_name(JointStates), definition(JointStates), {})
        state, layout = table.ring("PSM1", "state", "arm", STATE, 1)
        row = rows_of(STATE, 1)[0]
        file, chunk = RecordingFile(stream, table, FACTS), Chunk()
        chunk.add(channel, 1, BEGIN_NS, 5, bytes(message.serialize()))
        chunk.add(state, 1, BEGIN_NS, 5, b"\0\1\0\0", row.tobytes()[: layout.size])
        file.put(packed(chunk, "zstd"))
        file.finish()
    bag = McapReader(path)
    bag.open()
    store = get_typestore(Stores.EMPTY)
    found = {}
    for connection, _, data in bag.messages(bag.connections, None, None):
        known = get_types_from_msg(connection.msgdef.data, connection.msgtype)
        store.register({name: kind for name, kind in known.items() if name not in store.fielddefs})
        found[connection.topic] = store.deserialize_cdr(data, connection.msgtype)
    bag.close()
    assert found["/PSM1/measured_js"].name == ["a", "b"]
    assert found["/PSM1/measured_js"].position.tolist() == [1.0, 2.0]
    assert found["/PSM1/measured_js"].header.stamp.sec == 7
    assert np.array_equal(found["/PSM1/state"].position, row["position"], equal_nan=True)


def test_mcap_reads_it_with_and_without_its_summary(tmp_path: Path):
    path, rows = a_recording(tmp_path)
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        summary = reader.get_summary()
        assert summary.statistics.message_count == len(rows)
        assert len(summary.chunk_indexes) == 5
        assert [m.sequence for _, _, m in reader.iter_messages()] == rows["sequence"].tolist()
        assert {m.name for m in reader.iter_metadata()} == {names.SYSTEM}
        assert [a.name for a in reader.iter_attachments()] == [names.DOCUMENT]
    with path.open("rb") as stream:
        assert len(list(NonSeekingReader(stream, validate_crcs=True).iter_messages())) == len(rows)


def test_a_file_is_readable_up_to_its_last_chunk_wherever_it_is_cut(tmp_path: Path):
    whole = in_memory(30, finish=False)
    chunks, at = [], len(MAGIC)
    while at < len(whole):
        length = int.from_bytes(whole[at + 1 : at + 9], "little")
        at += 9 + length
        chunks.append((at, whole[at - 9 - length] == 6))
    ends = [end for end, is_chunk in chunks if is_chunk]
    assert len(ends) == 3
    path = tmp_path / "cut.mcap"
    for cut in sorted({each + shift for each, _ in chunks for shift in (-1, 0, 1, 5)}):
        path.write_bytes(whole[:cut])
        with open_recording(path) as recording:
            assert recording.problems
            assert not recording.is_whole
            kept = 10 * sum(end <= cut for end in ends)
            if "PSM1/state" in recording.topics:
                assert recording.records("PSM1/state").rows["sequence"].tolist() == list(range(1, kept + 1))
            else:
                assert kept == 0
    found = []
    with pytest.raises(EndOfFile):
        for record in StreamReader(io.BytesIO(whole)).records:
            found.append(record)
    assert sum(isinstance(record, Message) for record in found) == 30


@examples(150)
@given(st.data())
@pytest.mark.slow
def test_a_damaged_file_is_told_and_never_an_accident(tmp_path_factory, data):
    whole = bytearray(in_memory(20, compression=data.draw(st.sampled_from(("", "lz4", "zstd")))))
    for _ in range(data.draw(st.integers(1, 5))):
        whole[8 + data.draw(st.integers(0, 1 << 20)) % (len(whole) - 8)] = data.draw(st.integers(0, 255))
    path = tmp_path_factory.mktemp("damaged") / "one.mcap"
    path.write_bytes(whole)
    with open_recording(path) as recording:
        for topic in recording.record_topics:
            assert len(recording.records(topic).rows) <= 20
        assert isinstance(recording.document, bytes)
        assert len(recording.problems) <= 20


def record_at(whole: bytes, opcode: int) -> int:
    """Where the content of the first record of this kind begins."""
    at = len(MAGIC)
    while whole[at] != opcode:
        at += 9 + int.from_bytes(whole[at + 1 : at + 9], "little")
    return at + 9


def test_a_size_that_no_computer_has_is_told(tmp_path: Path):
    whole = bytearray(in_memory(10, document=b"{}"))
    at = record_at(whole, 9) + 16  # an attachment: two times, name, type, and how long it is
    for _ in range(2):
        at += 4 + int.from_bytes(whole[at : at + 4], "little")
    whole[at : at + 8] = b"\xff" * 8
    path = tmp_path / "long.mcap"
    path.write_bytes(whole)
    with open_recording(path) as recording:
        assert any("a record cannot be read" in problem for problem in recording.problems)
        assert len(recording.records("PSM1/state").rows) == 10


@pytest.mark.parametrize("epoch", [-1, 1 << 63, 1 << 200])
def test_an_epoch_that_no_writer_has_is_told(tmp_path: Path, epoch: int):
    table, path = ChannelTable(), tmp_path / "epoch.mcap"
    with path.open("wb", buffering=0) as stream:
        channel, layout = table.ring("PSM1", "state", "arm", STATE, epoch)
        chunk, row = Chunk(), rows_of(STATE, 1)[0]
        chunk.add(channel, 1, BEGIN_NS, 5, b"\0\1\0\0", row.tobytes()[: layout.size])
        RecordingFile(stream, table, FACTS).put(packed(chunk, "zstd"))
    with open_recording(path) as recording:
        assert recording.record_topics == [] or not len(recording.records("PSM1/state").rows)
        assert any("allowed are 0 to" in problem for problem in recording.problems)


def test_what_is_no_recording_is_refused_by_name(tmp_path: Path):
    path = tmp_path / "text.mcap"
    path.write_text("no recording")
    with pytest.raises(RecordingError, match=r"text\.mcap: is no MCAP file"):
        open_recording(path)
    with pytest.raises(RecordingError, match="No such file"):
        open_recording(tmp_path / "none.mcap")


def test_a_chunk_that_claims_too_much_is_not_uncompressed(tmp_path: Path):
    whole = bytearray(in_memory(10, finish=False))
    at = record_at(whole, 6)
    whole[at + 16 : at + 24] = (1 << 40).to_bytes(8, "little")
    path = tmp_path / "bomb.mcap"
    path.write_bytes(whole)
    with open_recording(path) as recording:
        assert len(recording.records("PSM1/state").rows) == 0
        assert any("allowed are" in problem for problem in recording.problems)


def test_a_message_that_is_shorter_than_a_record_takes_no_room(tmp_path: Path):
    table, path = ChannelTable(), tmp_path / "bomb.mcap"
    large = schema_of(Topic("state", "arm", rate_hz=1500, depth=4, fields=(
        Field("numbers", "(130000,)<f8", "", "a megabyte"),)))
    with path.open("wb", buffering=0) as stream:
        channel, _ = table.ring("PSM1", "state", "arm", large, 1)
        chunk = Chunk()
        for number in range(300):
            chunk.add(channel, number, BEGIN_NS, 5, ENCAPSULATION)
        RecordingFile(stream, table, FACTS).put(packed(chunk, "zstd"))
    tracemalloc.start()
    with open_recording(path) as recording:
        assert len(recording.records("PSM1/state").rows) == 0
        assert "PSM1/state: a message of 4 bytes is no record" in recording.problems
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 20e6


def test_of_more_than_memory_holds_the_first_are_read_and_that_is_told(tmp_path: Path, monkeypatch):
    path, rows = a_recording(tmp_path)
    monkeypatch.setattr(reading, "MAX_ROWS", 25 * rows.dtype.itemsize)
    with open_recording(path) as recording:
        assert recording.records("PSM1/state").rows["sequence"].tolist() == list(range(1, 21))
        assert any("only the first ones are read" in problem for problem in recording.problems)
        assert sum(len(piece.rows) for _, piece in recording.pieces(["PSM1/state"])) == 50


@pytest.mark.parametrize("ring", ["events", "audit"])
@pytest.mark.parametrize("form", ["(2,)<i8", "S7", ""])
def test_made_up_events_are_left_out_and_told(tmp_path: Path, ring: str, form: str):
    fields = (Field("monotonic_ns", form, "ns", "when"),) if form else ()
    odd = schema_of(Topic(ring, "arm", (*fields, Field("text", "S7", "", "said")), depth=4))
    path = tmp_path / "odd.mcap"
    with path.open("wb", buffering=0) as stream:
        written(stream, {("PSM1", ring): (odd, rows_of(odd, 5))})
    with open_recording(path) as recording:
        assert recording.events() == recording.commands() == []
        assert any(f"PSM1/{ring}: left out: its layout differs" in problem for problem in recording.problems)


def test_another_epoch_is_another_channel_of_the_same_topic(tmp_path: Path):
    table, path = ChannelTable(), tmp_path / "epochs.mcap"
    with path.open("wb", buffering=0) as stream:
        file = RecordingFile(stream, table, FACTS)
        for epoch, first in ((1, 1), (2, 11)):
            channel, layout = table.ring("PSM1", "state", "arm", STATE, epoch)
            chunk = Chunk()
            for row in rows_of(STATE, 5, first=first):
                chunk.add(channel, int(row["sequence"]), BEGIN_NS + first, 5, b"\0\1\0\0", row.tobytes()[: layout.size])
            file.put(packed(chunk, "zstd"))
    with open_recording(path) as recording:
        found = recording.records("PSM1/state")
    assert found.rows["sequence"].tolist() == [1, 2, 3, 4, 5, 11, 12, 13, 14, 15]
    assert found.epoch.tolist() == [1] * 5 + [2] * 5
    assert found.missing == 5


def test_a_time_of_day_chooses_records(tmp_path: Path):
    path, rows = a_recording(tmp_path)
    with open_recording(path) as recording:
        begin = BEGIN_NS + int(rows["stamp_ns"][20])
        found = recording.records("PSM1/state", begin, begin + 3_000_000)
        assert found.rows["sequence"].tolist() == [21, 22, 23]
        assert (recording.begin_ns, recording.end_ns) == (BEGIN_NS + 5, BEGIN_NS + int(rows["stamp_ns"][-1]))


class FullDisk(io.BytesIO):
    """Takes so many bytes, and no more."""

    def __init__(self, room: int) -> None:
        super().__init__()
        self.room = room

    def write(self, data):
        taken = min(len(data), max(0, self.room - self.tell()))
        if not taken:
            raise OSError(28, "No space left on device")
        return super().write(data[:taken])


def test_a_disk_that_is_full_leaves_a_readable_file(tmp_path: Path):
    disk, table, path = FullDisk(1 << 20), ChannelTable(), tmp_path / "full.mcap"
    channel, layout = table.ring("PSM1", "state", "arm", STATE, 1)
    file = RecordingFile(disk, table, FACTS)
    chunk = Chunk()
    row = rows_of(STATE, 1)[0]
    chunk.add(channel, 1, BEGIN_NS, 5, b"\0\1\0\0", row.tobytes()[: layout.size])
    file.put(packed(chunk, "zstd"))
    disk.room = file.size + 20
    with pytest.raises(OSError, match="No space"):
        file.put(packed(chunk, "zstd"))
    path.write_bytes(disk.getvalue())
    with open_recording(path) as recording:
        assert len(recording.records("PSM1/state").rows) == 1
    disk.room = 1 << 20  # somebody has made room
    file.put(packed(chunk, "zstd"))
    file.finish()
    path.write_bytes(disk.getvalue())
    with open_recording(path) as recording:
        assert recording.is_whole


def test_the_configuration_comes_along(tmp_path: Path):
    path, _ = a_recording(tmp_path, document=b'{"name":"demo"}')
    with open_recording(path) as recording:
        assert json.loads(recording.document) == {"name": "demo"}
        assert recording.metadata[names.SYSTEM]["kind"] == names.BOX


def test_fields_whose_names_ros_does_not_tell_apart_get_numbers() -> None:
    used = set[str]()
    assert [_unique(name, used) for name in ("a", "A", "a_", "2", "é")] == ["a", "a_2", "a_3", "f_2", "field"]
