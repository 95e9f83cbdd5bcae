"""Headers: whatever a file says, it is believed only when everything in it fits, and refused in one line."""

from __future__ import annotations

import os
import re
import struct
from typing import Any

import pytest

from tests.shm.memory.headers import rewrite
from trocar.shm.memory.layout import schema_of
from trocar.shm.memory.segment import FIXED, Segment, SegmentError, path_of
from trocar.shm.topics import SETPOINT

SCHEMA = schema_of(SETPOINT)


def refusal(name: str) -> str:
    """Why attaching is refused: the same both ways, in one line that names the segment."""
    reported = []
    for write in (False, True):
        with pytest.raises(SegmentError) as caught:
            Segment(name, write=write)
        reported.append(str(caught.value))
    assert reported[0] == reported[1]
    assert name in reported[0] and "\n" not in reported[0] and len(reported[0]) < 400
    return reported[0]


@pytest.mark.parametrize(("change", "message"), [
    ({"magic": b"TROCAR\0\2"}, "is not a Trocar segment"),
    ({"version": 1}, "header version 1"),
    ({"fingerprint": 1}, "contradict"),
    ({"stride": 0}, "out of range"),
    ({"stride": 1 << 30}, "out of range"),
    ({"stride": 65}, "out of range"),
    ({"stride": 64}, "contradict"),
    ({"depth": 0}, "out of range"),
    ({"depth": 2**32 - 1}, "out of range"),
    ({"depth": 1 << 19}, "out of range"),
    ({"depth": 1 << 15}, "asks for"),
    ({"first": 4095}, "do not fit"),
    ({"first": 8192}, "do not fit"),
    ({"first": 0}, "do not fit"),
    ({"schema": 2**31}, "do not fit"),
    ({"schema": 5}, "schema is not readable"),
    ({"schema": 300}, "schema is not readable"),
    ({"info": 0}, "says of the instance is not readable"),
    ({"size": 1 << 40}, "asks for"),
    ({"size": 1 << 63}, "asks for"),
    ({"kind": b"tape"}, "unknown kind 'tape'; known are ring"),
    ({"kind": b"\xff\n"}, "unknown kind"),
])
def test_a_header_that_lies_is_refused(ring: str, change: dict[str, Any], message: str) -> None:
    rewrite(ring, **change)
    assert message in refusal(ring)


@pytest.mark.parametrize(("size", "why"), [
    (0, "too short for a header"), (40, "too short for a header"), (FIXED.size, "asks for 8192"),
    (4096, "asks for 8192"), (8191, "asks for 8192"),
])
def test_a_truncated_file_is_refused(ring: str, size: int, why: str) -> None:
    os.truncate(path_of(ring), size)
    assert why in refusal(ring)


@pytest.mark.parametrize("size", [1, 4096, 4097])
def test_a_file_that_is_too_long_is_refused(ring: str, size: int) -> None:
    path = path_of(ring)
    with path.open("ab") as file:
        file.write(bytes(size))
    assert "asks for" in refusal(ring)
    rewrite(ring, size=path.stat().st_size)  # the header agrees, but no Trocar makes such a file
    assert "asks for" in refusal(ring)


def test_a_file_with_holes_is_refused(ring: str) -> None:
    path = path_of(ring)
    content = path.read_bytes()
    path.write_bytes(b"")
    with path.open("r+b") as file:
        file.write(content[:4096])
        file.truncate(len(content))
    assert re.search(r"file with holes: of \d+ bytes 4096 are there", refusal(ring))


def with_text(name: str, schema: bytes, info: bytes = b"{}") -> None:
    """Put other texts into the header, everything else in agreement with them."""
    first = -(-(256 + len(schema) + len(info)) // 4096) * 4096
    size = -(-(first + 64) // 4096) * 4096
    path = path_of(name)
    fixed = FIXED.pack(b"TROCAR\0\1", 2, first, 0, 64, 1, len(schema), len(info), b"ring", size)
    path.write_bytes((fixed.ljust(256, b"\0") + schema + info).ljust(size, b"\0"))


@pytest.mark.parametrize("schema", [
    b"", b"\xff\xfe", b"[" * 2000, b"[" * 1000000, b'{"topic":' * 100000, b"null", b"3", b'"x"', b"{}", b"[]",
    b'{"topic":"a","fields":3}', b'{"topic":"a","fields":["name"]}', b'{"topic":"a","fields":[{"name":"b"}]}',
    b'{"topic":3,"fields":[]}', b'{"topic":"a\\nb","fields":[]}', b'{"topic":"a","fields":{"name":1}}',
    b"9" * 5000, b'{"topic":"a","fields":[' + b",".join(b'{"name":"a%d","dtype":"S9999"}' % i for i in range(9999)) +
    b"]}",
    *(b'{"topic":"a","fields":[{"name":"b","dtype":"%s"}]}' % dtype for dtype in (
        b"O", b"<f16", b">f8", b"V8", b"M8[ns]", b"(3,)O", b"(1048576,1048576)<f8", b"(1048577,)<f8", b"(-1,)<f8",
        b"(1,1,1,1,1,1,1,1,1)<f8", b"(x,)<f8", b"(" + b"9" * 5000 + b",)<f8", b"S0", b"S99999", b"")),
    *(b'{"topic":"a","fields":[{"name":"%s","dtype":"u1"}]}' % name for name in (
        b"", b"a b", b"\\u001b[31m", b"\\ud800", b"sequence", b"x" * 65, b"\\u0000")),
], ids=lambda text: f"{text[:48]!r}")
def test_a_schema_that_is_none_is_refused_shortly(ring: str, schema: bytes) -> None:
    with_text(ring, schema)
    assert re.search("schema is not readable|topic a: |is no name|is not allowed|is out of range|twice", refusal(ring))


@pytest.mark.parametrize("shape", [b"-1,", b"1048577,", b"0,1048577", b"1,1,1,1,1,1,1,1,1"])
def test_a_shape_out_of_range_is_said_to_be_so(ring: str, shape: bytes) -> None:
    with_text(ring, b'{"topic":"a","fields":[{"name":"b","dtype":"(%s)u1"}]}' % shape)
    assert re.search(r"shape .* is out of range", refusal(ring))


def test_texts_that_are_too_long_are_not_even_read(ring: str) -> None:
    long = SCHEMA.text.ljust((1 << 20) + 1)
    with_text(ring, long)
    assert "do not fit a header" in refusal(ring)
    with_text(ring, SCHEMA.text, b"{}".ljust((1 << 20) + 1))
    assert "do not fit a header" in refusal(ring)


@pytest.mark.parametrize("info", [b"", b"[]", b"3", b"null", b"{", b"\xff", b"[" * 5000, b'{"a":' * 5000])
def test_constants_that_are_none_are_refused(ring: str, info: bytes) -> None:
    with_text(ring, SCHEMA.text, info)
    assert "says of the instance" in refusal(ring)


def test_the_header_is_as_documented(ring: str) -> None:
    raw = path_of(ring).read_bytes()
    assert raw[:8] == b"TROCAR\0\1" and struct.unpack_from("<I", raw, 12)[0] % 4096 == 0
    assert raw[40:44] == b"ring" and struct.unpack_from("<Q", raw, 56)[0] == len(raw)
