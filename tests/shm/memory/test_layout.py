"""Layouts: every row becomes a schema, and no change of a row goes unnoticed."""

from __future__ import annotations

import dataclasses
import json
import struct

import pytest

from tests.cases import cases
from trocar.shm.mailbox import mailbox_map
from trocar.shm.memory.layout import LINE, LayoutError, cut_text, schema_from_json, schema_of
from trocar.shm.topics import COMMAND, IO_STATE, SETPOINT, TOPICS, Field, Topic

DIMS = {"axes": 7, "drives": 7, "robots": 1, "inputs": 3, "outputs": 0, "readers": 1, "boards": 2, "setups": 4,
        "instances": 4, "teleops": 2, "arms": 3}
SMALL = Topic("small", "io", rate_hz=10, depth=10, fields=(
    Field("a", "(2,)<f8", "m", "one"), Field("b", "?", "", "two")))


@cases("topic", TOPICS)
def test_every_row_becomes_a_schema(topic: Topic) -> None:
    schema = schema_of(topic, DIMS)
    assert schema.stride % LINE == 0 and schema.stride >= schema.dtype.itemsize
    assert schema.dtype.names == ("sequence", "stamp_ns", *(f.name for f in topic.fields))
    assert (schema.offset("sequence"), schema.offset("stamp_ns")) == (0, 8)


@cases("topic", TOPICS)
def test_the_schema_survives_its_header_text(topic: Topic) -> None:
    schema = schema_of(topic, DIMS)
    again = schema_from_json(schema.text)
    assert again == schema and again.dtype == schema.dtype


@cases("topic", TOPICS)
def test_every_field_explains_itself(topic: Topic) -> None:
    assert all(f.text for f in topic.fields)
    views = [part for view in topic.views for _, part in view.fields] + [v.where for v in topic.views]
    assert set(views) <= {"", *(f.name for f in topic.fields)}  # "": always valid


@pytest.mark.parametrize("change", [
    {"name": "c"}, {"dtype": "(3,)<f8"}, {"dtype": "(2,)<f4"}, {"unit": "rad"}, {"text": "other"},
])
def test_any_change_of_a_row_changes_the_fingerprint(change: dict[str, str]) -> None:
    fields = (dataclasses.replace(SMALL.fields[0], **change), SMALL.fields[1])
    changed = dataclasses.replace(SMALL, fields=fields)
    assert schema_of(changed).fingerprint != schema_of(SMALL).fingerprint


def test_order_of_fields_and_names_count_too() -> None:
    prints = {schema_of(t).fingerprint for t in (
        SMALL, dataclasses.replace(SMALL, fields=SMALL.fields[::-1]), dataclasses.replace(SMALL, name="tiny"),
        dataclasses.replace(SMALL, writer="arm"), dataclasses.replace(SMALL, fields=SMALL.fields[:1]))}
    assert len(prints) == 5


def test_sizes_are_part_of_the_fingerprint() -> None:
    assert schema_of(IO_STATE, DIMS).fingerprint != schema_of(IO_STATE, {**DIMS, "axes": 8}).fingerprint


def test_a_missing_size_names_the_field() -> None:
    with pytest.raises(LayoutError, match="field position: size axes was not given"):
        schema_of(IO_STATE, {"robots": 1})


@cases("dtype", ["O", "<f3", ">f8", "V8", "S0", "<U4", "object", "(2,)O", "(-1,)<f8", "(x,)<f8",
                 "f8,f8"])
def test_dtypes_that_have_no_place_in_memory_are_refused(dtype: str) -> None:
    text = json.dumps({"topic": "t", "fields": [{"name": "a", "dtype": dtype}]}).encode()
    with pytest.raises(LayoutError):
        schema_from_json(text)


@cases("text", [
    b"", b"[]", b"{}", b"\xff\xfe", b'{"topic":"t"}', b'{"topic":"t","fields":3}', b'{"topic":"t","fields":[1]}',
    b'{"topic":"t","fields":[{"name":"a"}]}', b"[" * 100_000,
    b'{"topic":"t","fields":[{"name":"sequence","dtype":"u1"}]}',
    b'{"topic":"t","fields":[{"name":"a","dtype":"(1048576,1048576)<f8"}]}',
    b'{"topic":"t","fields":[{"name":"a","dtype":"(1048576,)<f8"}]}',
])
def test_a_text_that_is_no_schema_is_refused(text: bytes) -> None:
    with pytest.raises(LayoutError):
        schema_from_json(text)


def test_a_setpoint_is_as_small_as_the_figures_assume() -> None:
    assert schema_of(SETPOINT).stride <= 6 * LINE


def test_texts_are_cut_between_characters() -> None:
    assert cut_text("N·m", 10) == "N·m".encode()
    assert cut_text("N·m", 2) == b"N"
    assert cut_text("\udc80", 4) == b"?"


def test_mailbox_structs_agree_with_the_schema() -> None:
    command, reply = mailbox_map.COMMAND_SCHEMA, mailbox_map.REPLY_SCHEMA
    assert [command.offset(n) for n in ("stamp_ns", "id", "origin", "generation", "code", "count", "peer", "program",
                                        "text", "values")] == [8, 16, 24, 32, 40, 42, 44, 48, 64, 128]
    starts = (0, mailbox_map.PROGRAM_IN_RAW, mailbox_map.TEXT_IN_RAW, mailbox_map.VALUES_IN_RAW)
    assert [mailbox_map.COMMAND_START + n for n in starts] == [8, 48, 64, 128]
    assert mailbox_map.COMMANDS_OF[3].format == "<qQQQHHI16s64s3d" and mailbox_map.REPLY_BODY.format == "<QB200s"
    assert [reply.offset(n) - reply.offset("id") for n in ("id", "outcome", "text")] == [0, 8, 9]
    assert COMMAND.fields[-1].name == "values" and COMMAND.fields[-1].dtype == f"({mailbox_map.MAX_VALUES},)<f8"
    assert struct.calcsize(mailbox_map.REPLY_BODY.format) <= reply.stride - reply.offset("id")
