"""Segments: made once, claimed by one, checked before they are trusted."""

from __future__ import annotations

import errno
import os
import pwd
import signal
import socket
import stat
from pathlib import Path
from typing import Any

import pytest

from tests.cases import cases
from trocar.shm.memory import shm_files
from trocar.shm.memory.layout import MAX_DEPTH, schema_of
from trocar.shm.memory.owners import SERVICE_USER
from trocar.shm.memory.segment import (
    FOLDER,
    Segment,
    SegmentError,
    SegmentFull,
    create,
    held,
    names_of,
    path_of,
    segment_name,
    size_of,
    start_time,
    unlink,
)
from trocar.shm.topics import SETPOINT

SCHEMA = schema_of(SETPOINT)
CLAIM = """
import sys
from trocar.shm.memory.segment import Segment
segment = Segment(sys.argv[2], write=True)
segment.claim("PSM1")
print("claimed", flush=True)
sys.stdin.read()
"""


def test_a_new_segment_says_what_it_is(ring: str) -> None:
    with Segment(ring) as segment:
        header = segment.header
        assert (header.kind, header.depth, header.stride) == ("ring", 8, SCHEMA.stride)
        assert header.schema == SCHEMA and header.info == {"kind": "arm"}
        assert segment.identity().pid == 0 and not segment.claimed()


def test_its_size_is_what_create_said_and_allocated(world: Any) -> None:
    name = segment_name(world.name, "PSM1", "setpoint")
    size = create(name, "ring", SCHEMA, 100)
    status = path_of(name).stat()
    unlink(name)
    assert status.st_size == size >= 100 * SCHEMA.stride
    assert status.st_blocks * 512 >= size  # really there: no SIGBUS later


def test_a_second_one_of_the_name_is_refused(ring: str) -> None:
    with pytest.raises(SegmentError, match="exists already"):
        create(ring, "ring", SCHEMA, 8)


@pytest.mark.parametrize(("depth", "info"), [(1, {}), (1000, {"a": "b" * 5000})])
def test_the_size_can_be_asked_before(world: Any, depth: int, info: dict[str, Any]) -> None:
    name = segment_name(world.name, "PSM1", "setpoint")
    expected = size_of(name, "ring", SCHEMA, depth, info)
    assert names_of(world.name) == []
    assert create(name, "ring", SCHEMA, depth, info) == expected
    unlink(name)


def test_more_than_shared_memory_holds_is_an_error_now(world: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(fd: int, offset: int, size: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "posix_fallocate", full)
    with pytest.raises(SegmentFull, match=r"shared memory is full: \d+ bytes are needed, \d+ are free in /dev/shm"):
        create(segment_name(world.name, "a", "b"), "ring", SCHEMA, 8)
    assert names_of(world.name) == []


@pytest.mark.parametrize(("kind", "depth", "info"), [
    ("ring", 0, {}), ("ring", MAX_DEPTH + 1, {}), ("string", 1, {}), ("ring", 1, {"a": "b" * (1 << 20)}),
])
def test_what_could_not_be_attached_is_not_made(world: Any, kind: str, depth: int, info: dict[str, Any]) -> None:
    with pytest.raises(SegmentError, match="allowed are"):
        create(segment_name(world.name, "a", "b"), kind, SCHEMA, depth, info)
    assert names_of(world.name) == []


@pytest.mark.parametrize("umask", [0, 0o077, 0o777])
@pytest.mark.parametrize("mode", [0o600, 0o660])
def test_the_mode_does_not_depend_on_the_umask(world: Any, mode: int, umask: int) -> None:
    name = segment_name(world.name, "PSM1", "setpoint")
    before = os.umask(umask)
    try:
        create(name, "ring", SCHEMA, 2, mode=mode)
    finally:
        os.umask(before)
    found = stat.S_IMODE(path_of(name).stat().st_mode)
    unlink(name)
    assert found == mode


def test_a_group_gets_the_segment(world: Any) -> None:
    as_root()
    name = segment_name(world.name, "PSM1", "setpoint")
    create(name, "ring", SCHEMA, 2, mode=0o660, group=4343)
    status = path_of(name).stat()
    Segment(name, write=True).close()
    unlink(name)
    assert (status.st_gid, stat.S_IMODE(status.st_mode)) == (4343, 0o660)


def test_a_group_we_are_not_in_is_refused(world: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(fd: int, user: int, group: int) -> None:
        raise PermissionError(errno.EPERM, "Operation not permitted")

    monkeypatch.setattr(os, "fchown", refuse)
    with pytest.raises(SegmentError, match="cannot be given to group 4343: Operation not permitted; a member"):
        create(segment_name(world.name, "a", "b"), "ring", SCHEMA, 2, mode=0o660, group=4343)
    assert names_of(world.name) == []


@cases("bad", ["", "a b", "a~b", "../x", "a/b", "ä", "a\n", "x" * 65, "a.b"])
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


def as_root() -> None:
    if os.getuid() != 0:
        pytest.skip("only root can give a file away")


def refused(name: str, match: str) -> None:
    """Attaching is refused both ways, in one line that names the segment."""
    for write in (False, True):
        with pytest.raises(SegmentError, match=match) as caught:
            Segment(name, write=write)
        assert "\n" not in str(caught.value) and name in str(caught.value)
        assert len(str(caught.value)) < 400


def test_a_file_cut_short_after_the_check_is_refused(ring: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def look_then_cut(fd: int, name: str) -> Any:
        header = checked(fd, name)
        os.truncate(path_of(name), 4096)
        return header

    from trocar.shm.memory import segment as module
    from trocar.shm.memory.header import checked
    monkeypatch.setattr(module, "checked", look_then_cut)
    with pytest.raises(SegmentError, match="cannot be mapped"):
        Segment(ring)


def other_kinds(path: Path) -> dict[str, Any]:
    def bound() -> None:
        with socket.socket(socket.AF_UNIX) as made:
            made.bind(str(path))

    return {"directory": path.mkdir, "link": lambda: path.symlink_to("/etc/hostname"),
            "dangling link": lambda: path.symlink_to("/nowhere"), "pipe": lambda: os.mkfifo(path), "socket": bound}


@pytest.mark.parametrize("kind", ["directory", "link", "dangling link", "pipe", "socket"])
def test_what_is_no_file_is_refused_at_once(world: Any, kind: str) -> None:
    name = segment_name(world.name, "PSM1", "setpoint")
    other_kinds(path_of(name))[kind]()
    signal.alarm(10)  # ends the run, if opening a pipe should wait
    try:
        refused(name, "is no segment but")
        assert names_of(world.name) == []
        with pytest.raises(SegmentError, match="exists already"):
            create(name, "ring", SCHEMA, 2)
    finally:
        signal.alarm(0)
        (path_of(name).rmdir if kind == "directory" else path_of(name).unlink)()


def test_what_anybody_may_write_is_refused(ring: str) -> None:
    for mode in (0o602, 0o666, 0o777):
        path_of(ring).chmod(mode)
        refused(ring, rf"every user may write it \(mode {mode:o}\); allowed are 600 and 660")
    path_of(ring).chmod(0o660)
    Segment(ring).close()


def test_another_owner_is_refused_in_plain_words(ring: str) -> None:
    as_root()
    os.chown(path_of(ring), 4242, -1)
    refused(ring, "belongs to user 4242; accepted are root and the user in TROCAR_SERVICE_USER")
    with pytest.raises(SegmentError, match="exists already and belongs to user 4242"):
        create(ring, "ring", SCHEMA, 8)


def test_the_service_user_is_accepted(ring: str, monkeypatch: pytest.MonkeyPatch) -> None:
    as_root()
    name, uid = "daemon", pwd.getpwnam("daemon").pw_uid
    os.chown(path_of(ring), uid, -1)
    refused(ring, f"belongs to user {name}; accepted are root and")
    monkeypatch.setenv(SERVICE_USER, name)
    Segment(ring).close()
    os.chown(path_of(ring), 4242, -1)
    refused(ring, f"belongs to user 4242; accepted are root, {name}")
    os.chown(path_of(ring), 0, -1)
    Segment(ring).close()


@pytest.mark.parametrize("nobody", ["no-such-user", "a\nb", "1", "x\u00e4"])
def test_a_service_user_who_is_nobody_is_an_error(ring: str, monkeypatch: pytest.MonkeyPatch, nobody: str) -> None:
    monkeypatch.setenv(SERVICE_USER, nobody)
    for attempt in (lambda: Segment(ring), names_of):
        with pytest.raises(SegmentError, match=r"TROCAR_SERVICE_USER=.* this machine has no such user") as caught:
            attempt()
        assert "\n" not in str(caught.value)
    monkeypatch.delenv(SERVICE_USER)


def test_what_others_have_put_there_is_not_listed(world: Any, ring: str) -> None:
    odd = [FOLDER / f"trocar~{world.name}~{rest}" for rest in ("PSM1", "a b~state", "PSM1~x~state", "PSM1~st\u00e4te")]
    for path in odd:
        path.touch()
    try:
        assert names_of(world.name) == [(world.name, "PSM1", "setpoint")]
        if os.getuid() == 0:
            os.chown(path_of(ring), 4242, -1)
            assert names_of(world.name) == [] and (world.name, "PSM1", "setpoint") not in names_of()
    finally:
        for path in odd:
            path.unlink()


@pytest.mark.parametrize("garbage", [b"\xff", b"\0", b"\n\x1b[31m", b"\x01"])
def test_a_replaced_identity_misleads_nobody_for_long(ring: str, garbage: bytes) -> None:
    with Segment(ring, write=True) as first, Segment(ring, write=True) as second:
        first.claim("PSM1")
        first.view[64:144] = (garbage * 80)[:80]
        assert second.identity().name.isprintable() and second.claimed()
        with pytest.raises(SegmentError, match="writes it already") as caught:
            second.claim("PSM2")  # the kernel knows better
        assert "\n" not in str(caught.value)
    with Segment(ring, write=True) as heir:
        identity = heir.claim("PSM1")
        assert heir.identity() == identity and (identity.pid, identity.name) == (os.getpid(), "PSM1")


def test_what_may_not_be_removed_is_an_error(ring: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(name: str) -> None:
        raise PermissionError(errno.EACCES, "No permission to unlink this segment")

    with monkeypatch.context() as patch:
        patch.setattr(shm_files, "unlink", refuse)
        with pytest.raises(SegmentError, match=f"{ring}: cannot be removed"):
            unlink(ring)


def test_names_of_lists_one_system_only(world: Any, ring: str) -> None:
    assert names_of(world.name) == [(world.name, "PSM1", "setpoint")]
    assert (world.name, "PSM1", "setpoint") in names_of()


def test_a_claim_is_seen_on_a_segment_of_another_version(ring: str) -> None:
    with Segment(ring, write=True) as segment:
        segment.claim("PSM1")
        segment.view[8:12] = (1).to_bytes(4, "little")
        assert held(ring)
    assert not held(ring) and not held("/trocar~no~such~thing")
