"""Segments: made once, claimed by one, checked before they are trusted."""

from __future__ import annotations

import os
import stat
import struct
from pathlib import Path
from typing import Any

import pytest

from shm.layout import MAX_DEPTH, schema_of
from shm.segment import FIXED, FOLDER, Segment, SegmentError, create, names_of, segment_name, start_time, unlink
from shm.topics import SETPOINT

SCHEMA = schema_of(SETPOINT)
FIELDS = ("magic", "version", "first", "fingerprint", "stride", "depth", "schema", "info", "kind", "size")
CLAIM = """
import sys
from shm.segment import Segment
segment = Segment(sys.argv[2], write=True)
segment.claim("PSM1")
print("claimed", flush=True)
sys.stdin.read()
"""


@pytest.fixture
def ring(world: Any) -> Any:
    """Name of a fresh segment."""
    name = segment_name(world.name, "PSM1", "setpoint")
    create(name, "ring", SCHEMA, 8, {"kind": "arm"})
    yield name
    unlink(name)


def file_of(name: str) -> Path:
    return FOLDER / name[1:]


def rewrite(name: str, **changes: Any) -> None:
    """Change fields of the fixed header."""
    with file_of(name).open("r+b") as file:
        values = dict(zip(FIELDS, FIXED.unpack(file.read(FIXED.size)), strict=True))
        file.seek(0)
        file.write(FIXED.pack(*{**values, **changes}.values()))


def test_a_new_segment_says_what_it_is(ring: str) -> None:
    with Segment(ring) as segment:
        header = segment.header
        assert (header.kind, header.depth, header.stride) == ("ring", 8, SCHEMA.stride)
        assert header.schema == SCHEMA and header.info == {"kind": "arm"}
        assert segment.identity().pid == 0 and not segment.claimed()


def test_its_size_is_what_create_said_and_allocated(world: Any) -> None:
    name = segment_name(world.name, "PSM1", "setpoint")
    size = create(name, "ring", SCHEMA, 100)
    status = file_of(name).stat()
    unlink(name)
    assert status.st_size == size >= 100 * SCHEMA.stride
    assert status.st_blocks * 512 >= size  # really there: no SIGBUS later


def test_a_second_one_of_the_name_is_refused(ring: str) -> None:
    with pytest.raises(SegmentError, match="exists already"):
        create(ring, "ring", SCHEMA, 8)


def test_more_than_shared_memory_holds_is_an_error_now(world: Any) -> None:
    free = os.statvfs(FOLDER)
    needed = free.f_bavail * free.f_frsize // SCHEMA.stride + 1000
    if needed > MAX_DEPTH:
        needed = MAX_DEPTH + 1
    with pytest.raises(SegmentError, match=r"shared memory is full|depth"):
        create(segment_name(world.name, "a", "b"), "ring", SCHEMA, needed)
    assert names_of(world.name) == []


@pytest.mark.parametrize("mode", [0o600, 0o660])
def test_the_mode_does_not_depend_on_the_umask(world: Any, mode: int) -> None:
    name = segment_name(world.name, "PSM1", "setpoint")
    before = os.umask(0o077)
    try:
        create(name, "ring", SCHEMA, 2, mode=mode)
    finally:
        os.umask(before)
    found = stat.S_IMODE(file_of(name).stat().st_mode)
    unlink(name)
    assert found == mode


@pytest.mark.parametrize("bad", ["", "a b", "a~b", "../x", "a/b", "ä", "a\n", "x" * 65, "a.b"])
def test_names_are_checked(bad: str) -> None:
    with pytest.raises(SegmentError, match="allowed are"):
        segment_name(bad, "PSM1", "state")
    with pytest.raises(SegmentError, match="allowed are"):
        segment_name("demo", bad, "state")


def test_the_longest_names_still_fit_a_file_name(world: Any) -> None:
    name = segment_name("s" * 64, "i" * 64, "w" * 64)
    assert len(name) <= 255


def test_a_second_writer_is_refused(ring: str) -> None:
    with Segment(ring, write=True) as first, Segment(ring, write=True) as second:
        first.claim("PSM1")
        with pytest.raises(SegmentError, match=rf"PSM1 \(pid {os.getpid()}\) writes it already"):
            second.claim("PSM2")
        assert second.claimed() and first.claimed()


def test_a_writer_of_another_process_is_named(world: Any, ring: str) -> None:
    child = world.start(CLAIM, ring)
    assert child.stdout.readline() == "claimed\n"
    with Segment(ring, write=True) as mine:
        with pytest.raises(SegmentError, match=rf"PSM1 \(pid {child.pid}\)"):
            mine.claim("PSM1")
        identity = mine.identity()
        assert identity.pid == child.pid and identity.start == start_time(child.pid) > 0
    world.kill(child)


def test_kill_9_frees_the_claim(world: Any, ring: str) -> None:
    child = world.start(CLAIM, ring)
    assert child.stdout.readline() == "claimed\n"
    world.kill(child)
    with Segment(ring, write=True) as mine:
        assert not mine.claimed()
        assert mine.claim("PSM1").epoch == 2


def test_closing_frees_the_claim_while_views_live(ring: str) -> None:
    first = Segment(ring, write=True)
    first.claim("PSM1")
    words = memoryview(first.view)
    first.close()
    with Segment(ring, write=True) as second:
        assert second.claim("PSM1").epoch == 2
    words.release()


def test_asking_whether_it_is_claimed_gives_nothing_away(ring: str) -> None:
    with Segment(ring, write=True) as first, Segment(ring) as tool:
        first.claim("PSM1")
        assert first.claimed() and tool.claimed() and tool.claimed()
        with Segment(ring, write=True) as second, pytest.raises(SegmentError):
            second.claim("PSM2")


def test_readers_cannot_write(ring: str) -> None:
    with Segment(ring) as segment, pytest.raises(TypeError):
        segment.view[4096] = 1


def test_an_absent_segment_says_what_to_do() -> None:
    with pytest.raises(SegmentError, match="no such segment"):
        Segment(segment_name("nosuch", "a", "b"))


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
    ({"depth": 1 << 19}, "asks for"),
    ({"first": 4095}, "asks for|do not fit"),
    ({"first": 0}, "do not fit"),
    ({"schema": 2**31}, "do not fit"),
    ({"schema": 5}, "schema is not readable"),
    ({"info": 0}, "Expecting value|contradict"),
    ({"size": 1 << 40}, "asks for"),
])
def test_a_header_that_lies_is_refused(ring: str, change: dict[str, Any], message: str) -> None:
    rewrite(ring, **change)
    with pytest.raises(SegmentError, match=message) as caught:
        Segment(ring)
    assert "\n" not in str(caught.value) and ring in str(caught.value)


@pytest.mark.parametrize("size", [0, 40, FIXED.size, 4096, 8191])
def test_a_truncated_file_is_refused(ring: str, size: int) -> None:
    os.truncate(file_of(ring), size)
    with pytest.raises(SegmentError) as caught:
        Segment(ring)
    assert "\n" not in str(caught.value)


def test_a_deeply_nested_header_text_is_refused(ring: str) -> None:
    with file_of(ring).open("r+b") as file:
        file.seek(FIXED.size)
        file.seek(256)
        file.write(b"[" * 2000)
    with pytest.raises(SegmentError):
        Segment(ring)


def test_another_owner_is_refused_unless_configured(ring: str) -> None:
    if os.getuid() != 0:
        pytest.skip("only root can give a file away")
    os.chown(file_of(ring), 4242, -1)
    with pytest.raises(SegmentError, match="belongs to user 4242"):
        Segment(ring)
    Segment(ring, owners=frozenset({4242})).close()


def test_names_of_lists_one_system_only(world: Any, ring: str) -> None:
    assert names_of(world.name) == [(world.name, "PSM1", "setpoint")]
    assert (world.name, "PSM1", "setpoint") in names_of()


def test_the_header_is_as_documented(ring: str) -> None:
    raw = file_of(ring).read_bytes()
    assert raw[:8] == b"TROCAR\0\1" and struct.unpack_from("<I", raw, 12)[0] % 4096 == 0
    assert raw[40:44] == b"ring" and struct.unpack_from("<Q", raw, 56)[0] == len(raw)
