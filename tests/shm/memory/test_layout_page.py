"""docs/shared-memory.md says what the code does: its tables, its example, and a client made from nothing else."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterator
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from tests.cases import cases
from tests.shm.memory.layout_page import ROOT, TEXT, code, number, places, records, table, tables
from trocar.shm.commands import COMMANDS
from trocar.shm.mailbox import generations as faults
from trocar.shm.mailbox import mailbox, mailbox_map, received
from trocar.shm.mailbox.mailbox_map import COMMAND_SCHEMA, REPLY_SCHEMA
from trocar.shm.memory import header
from trocar.shm.memory.layout import LINE, LayoutError, Schema, schema_from_json, schema_of
from trocar.shm.memory.segment import NAME, Segment, segment_name
from trocar.shm.ring import ring
from trocar.shm.ring.ring import RingWriter
from trocar.shm.system import subscriptions
from trocar.shm.system.directory import create_ring
from trocar.shm.time import control_page as page
from trocar.shm.time import lockstep, wakeup
from trocar.shm.time.control_page import STATES
from trocar.shm.topics import TOPICS, Field, Topic


def test_the_header_lies_where_the_page_says() -> None:
    rows = {row["name"]: (int(row["offset"]), int(row["size"])) for row in table("Header", "offset", "size")}
    fixed = places(header.FIXED.format)
    identity = [(header.IDENTITY_AT + at, size) for at, size in places(header.IDENTITY.format)]
    assert list(rows.values()) == [*fixed, *identity, (header.HEAD_AT, 8)]
    assert " ".join(rows) == ("magic version first fingerprint stride depth schema info kind size pid epoch start "
                              "instance head")
    assert header.MAGIC == b"TROCAR\0\1" and "`TROCAR`, 0, 1" in TEXT


def test_every_constant_is_that_of_the_code() -> None:
    rows = [row for t in tables() if "in the code" in t.columns for row in t.rows]
    assert {row["in the code"]: number(row["value"]) for row in rows} == {
        row["in the code"]: code(row["in the code"]) for row in rows}
    named = {row["in the code"] for row in rows}
    assert len(named) == len(rows)
    assert {name.removeprefix("trocar.shm.") for name in named} >= {
        "memory.header.VERSION", "memory.header.TEXT_AT", "memory.header.MAX_TEXT", "memory.layout.MAX_STRIDE",
        "memory.layout.MAX_DEPTH", "memory.layout.PAGE", "memory.layout.LINE", "memory.locks.OFD_SETLK",
        "ring.ring.BUSY", "ring.ring.RETRIES", "mailbox.mailbox_map.CLIENTS", "mailbox.mailbox_map.COMMANDS_DEPTH",
        "mailbox.mailbox_map.REPLIES_DEPTH", "mailbox.mailbox.LAST_NUMBER", "mailbox.mailbox.LATE_NS"}


def test_the_kinds_are_all_there_are() -> None:
    rows = table("Segments", "what", "kind")
    assert {row["kind"] for row in rows} == set(header.KINDS)
    named = {what.strip(" `") for row in rows if row["kind"] == "ring" for what in row["what"].split(",")}
    assert named == {topic.name for topic in TOPICS} - {"command", "reply"}


SCALARS = table("Schema, and where its fields lie", "scalar", "size", "aligned to")


def allowed(dtype: str) -> bool:
    try:
        schema_from_json(b'{"topic":"t","fields":[{"name":"x","dtype":"%s"}]}' % dtype.encode())
    except LayoutError:
        return False
    return True


def test_the_scalars_are_those_the_code_allows() -> None:
    named = {row["scalar"]: row for row in SCALARS}
    tried = {"?", "S20", *(f"{order}{kind}{size}" for order in ("", "<", ">", "=", "|") for kind in "?biufcSUVOMm"
                           for size in ("", "0", "1", "2", "4", "8", "16"))} - {"S1", "S2", "S4", "S8", "S16"}
    assert {dtype for dtype in tried if allowed(dtype)} == set(named)
    assert allowed("S1") and allowed("S9999") and not allowed("S0") and not allowed("S10000")
    for dtype, row in named.items():
        assert (np.dtype(dtype).itemsize, np.dtype(dtype).alignment) == (int(row["size"]), int(row["aligned to"]))


def laid_out(schema: Schema) -> tuple[dict[str, int], int, int]:
    """Offsets, record and stride by the three rules of the page and its table of scalars."""
    sizes = {row["scalar"]: (int(row["size"]), int(row["aligned to"])) for row in SCALARS}
    at, offsets = 16, {"sequence": 0, "stamp_ns": 8}
    for name, shape, scalar in re.findall(rb'"name":"([^"]*)","dtype":"(?:\(([^)]*)\))?([^"]*)"', schema.text):
        text = scalar.decode()
        size, align = (int(text[1:]), 1) if text.startswith("S") else sizes[text]
        at = -(-at // align) * align
        offsets[name.decode()] = at
        at += size * int(np.prod([int(n) for n in shape.split(b",") if n], dtype=int))
    record = -(-at // 8) * 8
    return offsets, record, -(-record // 64) * 64


@pytest.mark.parametrize("count", [0, 1, 7])
def test_the_rules_give_the_offsets_of_every_topic(count: int) -> None:
    named = ("axes", "drives", "robots", "inputs", "outputs", "readers", "boards", "setups", "instances",
             "teleops", "arms", "components")
    dims = dict.fromkeys(named, count)
    for schema in [*(schema_of(topic, dims) for topic in TOPICS), page.SCHEMA, lockstep.SCHEMA,
                   schema_of(faults.PAGE, dims)]:
        names = schema.dtype.names or ()
        assert laid_out(schema) == ({n: schema.offset(n) for n in names}, schema.dtype.itemsize, schema.stride)


@pytest.mark.parametrize(("which", "schema"), [(0, page.SCHEMA), (1, COMMAND_SCHEMA), (2, REPLY_SCHEMA),
                                               (3, lockstep.SCHEMA)])
def test_records_lie_where_the_page_says(which: int, schema: Schema) -> None:
    dtypes = dict(re.findall(r'"name":"([^"]*)","dtype":"([^"]*)"', schema.text.decode()))
    dtypes = {"sequence": "<u8", "stamp_ns": "<i8"} | {n: d.replace(",)", ",)") for n, d in dtypes.items()}
    assert [(row["field"], int(row["offset"]), int(row["size"]), row["dtype"]) for row in records(which).values()] == [
        (n, schema.offset(n), schema.dtype[n].itemsize, dtypes[n]) for n in schema.dtype.names or ()]


ARM = [command.name for command in COMMANDS["arm"]]
LAST_PLACE = mailbox_map.PLACES - 1
LOCKS_AT = 16 + mailbox_map.CURSORS.index("place") * mailbox_map.CURSOR_BYTES
SENTENCES = [
    "State: " + ", ".join(f"{i} {state}" for i, state in enumerate(STATES)) + ".",
    ", ".join(f"{i} {outcome}" for i, outcome in received.OUTCOMES.items()),
    f"The first {header.TEXT_AT} bytes", f"offset of slot 0: {header.TEXT_AT} + both texts, in whole pages",
    f"the schema text, which begins at {header.TEXT_AT}", f"`st_blocks` · {header.BLOCK} ≥ size",
    f"in whole cache lines of {LINE}", f"Simulated time begins at {lockstep.EPOCH_NS} ns",
    "Mode 0600, or 0660", f".l_start = first + {LOCKS_AT} + k, .l_len = 1",
    f"It has {mailbox_map.CLIENTS} places for clients, and place {mailbox_map.RESERVED} for stops",
    f"lock the byte of a place, 0 to {mailbox_map.CLIENTS - 1};", f"lock the byte of place {mailbox_map.RESERVED};",
    "With B = first + 16:", f"There are {page.SUBSCRIBERS} places: a cell",
    f"at first + {page.SCHEMA.offset('place')} + k",
    f"`sent` of places 0 to {LAST_PLACE} |", f"places 0 to {LAST_PLACE}: {mailbox_map.COMMANDS_DEPTH} command slots",
    f"command slots, behind them {mailbox_map.REPLIES_DEPTH} reply slots",
    f"command slot n mod {mailbox_map.COMMANDS_DEPTH}, {COMMAND_SCHEMA.stride} bytes each",
    f"reply slot n mod {mailbox_map.REPLIES_DEPTH}, {REPLY_SCHEMA.stride} bytes each", "from byte first + 16 on",
    f"0 ≤ sent − taken ≤ {mailbox_map.COMMANDS_DEPTH} and sent < 2^62", f"sent − taken < {mailbox_map.COMMANDS_DEPTH}?",
    f"one that is full ({mailbox_map.COMMANDS_DEPTH})", f"older than {mailbox.LATE_NS / 1e9:g} s by its `stamp_ns`",
    f"more than {mailbox.MAX_VALUES} values", f"at most the last {mailbox_map.REPLIES_DEPTH} ",
    f"values are used, at most {mailbox.MAX_VALUES} |",
    "Record 4 lies in slot 4 mod 3 = 1, at 4096 + 64; slot 2 is busy with record 5, record 3 is in slot 0",
]


@cases("sentence", SENTENCES)
def test_numbers_in_sentences_are_those_of_the_code(sentence: str) -> None:
    assert sentence in " ".join(TEXT.split())

def test_the_faults_page_lies_where_the_page_says() -> None:
    schema = schema_of(faults.PAGE, {"components": 3})
    assert [schema.offset(name) for name in ("count", "fault", "void")] == [16, 16 + 8 * 3, 16 + 8 * 6]
    assert [row["field"] for row in table("Faults page", "field", "dtype")] == ["count", "fault", "void"]


def test_names_are_as_long_as_the_page_says() -> None:
    assert "each of the three parts has 1 to 64 letters, digits, `_` or `-`" in " ".join(TEXT.split()).lower()
    assert all(NAME.fullmatch(name) for name in ("x", "a_-Z9", "x" * 64))
    assert not any(NAME.fullmatch(name) for name in ("", "ä", "x" * 65))


def test_the_steps_are_those_of_the_modules() -> None:
    modules: tuple[ModuleType, ...] = (ring, mailbox, wakeup, subscriptions)
    steps = re.compile(r"\b(?:[WRVMNABPQLCDEFG][1-9]|S1)\b")
    assert set(steps.findall(TEXT)) == {step for module in modules for step in steps.findall(module.__doc__ or "")}


def test_the_size_of_peek_is_right() -> None:
    lines = len((ROOT / "tools" / "peek.c").read_text(encoding="utf-8").splitlines())
    assert f"a reader of {lines} lines" in TEXT


LEVEL = Topic("level", "arm", rate_hz=100, depth=3, fields=(
    Field("valid", "?", "", ""), Field("position", "(2,)<f8", "rad", ""),
    Field("state", "S6", "", ""), Field("age", "<i4", "ns", "")))


@pytest.fixture
def system(world: Any) -> Iterator[str]:
    """Name of a system whose segments are removed behind the test."""
    yield world.name
    world.remove()


@pytest.fixture
def level(system: str) -> bytes:
    """The bytes of the page's small ring: after four records, by a writer with the pid and start shown there."""
    create_ring(system, "PSM1", LEVEL, {}, {"kind": "arm"})
    name = segment_name(system, "PSM1", "level")
    with Segment(name, write=True) as segment:
        writer = RingWriter(segment, "PSM1")
        for i in range(1, 5):
            for field, value in (("valid", True), ("position", (i / 2, -i)), ("age", -i),
                                 ("state", b"HOMING" if i == 4 else b"IDLE")):
                writer.field(field)[...] = value
            writer.publish(1000 * i)
        raw = bytearray(segment.view)
    header.IDENTITY.pack_into(raw, header.IDENTITY_AT, 4711, 1, 123456, b"PSM1")
    return bytes(raw)


def test_the_dump_is_what_the_code_writes(level: bytes) -> None:
    shown = {int(at, 16): bytes.fromhex(text) for at, text in
             re.findall(r"^    ([0-9a-f]{4})  ((?:[0-9a-f]{2} {1,2}){15}[0-9a-f]{2})(?:  |$)", TEXT, re.MULTILINE)}
    slot = 4096 + 64
    assert list(shown) == [*range(0, 256, 16), *range(slot, slot + 80, 16)]
    assert all(level[at : at + 16] == part for at, part in shown.items())


def test_the_notes_beside_the_dump_are_true(level: bytes) -> None:
    rows = {row["name"]: (int(row["offset"]), int(row["size"])) for row in table("Header", "offset", "size")}
    values = {name: int.from_bytes(level[at : at + size], "little") for name, (at, size) in rows.items() if size < 16}
    for note in ("version {version}, first {first}", "stride {stride}, depth {depth}", "schema {schema}, info {info} b",
                 "size {size}", "pid {pid}, epoch {epoch}; start {start}", "head {head}"):
        assert note.format(**values) in TEXT
    schema = schema_of(LEVEL)
    record = np.frombuffer(level, schema.dtype, 1, 4096 + 64)[0]
    assert (int(record["sequence"]), int(record["stamp_ns"]), bool(record["valid"]), record["position"].tolist(),
            bytes(record["state"]), int(record["age"])) == (4, 4000, True, [2.0, -4.0], b"HOMING", -4)
    assert "sequence 4; stamp_ns 4000" in TEXT and "position[0] = 2.0" in TEXT and "position[1] = -4.0" in TEXT
    assert 'state "HOMING"' in TEXT and "age -4; the record ends at 56" in TEXT and schema.dtype.itemsize == 56


def test_the_fingerprint_is_found_as_the_page_tells(level: bytes) -> None:
    schema = schema_of(LEVEL)
    assert f"\n    {schema.text.decode()}\n" in TEXT
    digest = hashlib.blake2b(schema.text, digest_size=8).digest()
    assert f"with the fingerprint {int.from_bytes(digest, 'little'):016x}:" in TEXT
    assert digest == level[16:24]
