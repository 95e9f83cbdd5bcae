"""tools/peek.c, the reader in C, refuses what is no ring, in one line, before it maps anything."""

from __future__ import annotations

import os
import pwd
import random
import re
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.shm.memory.headers import rewrite
from tests.tools.peeking import NUMBER, Peek, build, number_ring, refused
from trocar.shm.commands import COMMANDS
from trocar.shm.mailbox.mailbox_map import create_mailbox
from trocar.shm.memory.layout import schema_of
from trocar.shm.memory.segment import FIXED, HEAD_AT, TEXT_AT, Segment, SegmentError, path_of
from trocar.shm.ring.ring import BUSY, HEAD, attach

pytestmark = pytest.mark.slow

SANITIZED = ("-std=c11", "-O1", "-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
SCHEMA = schema_of(NUMBER)
HEADERS = [
    ({"magic": b"TROCAR\0\2"}, "not a Trocar segment"), ({"magic": bytes(8)}, "not a Trocar segment"),
    ({"version": 1}, "header version 1"), ({"version": 3}, "header version 3"),
    ({"stride": 0}, "stride 0"), ({"stride": 65}, "stride 65"), ({"stride": 1 << 21}, "out of range"),
    ({"stride": 128}, "contradict"), ({"stride": 4096}, "not as long"), ({"depth": 0}, "depth 0"),
    ({"depth": 2**32 - 1}, "out of range"), ({"depth": 1 << 16}, "not as long"), ({"first": 0}, "texts"),
    ({"first": 4095}, "texts"), ({"first": 8192}, "texts"), ({"schema": 2**32 - 1}, "texts"),
    ({"info": 2**32 - 1}, "texts"), ({"schema": 4000}, "texts"), ({"size": 4096}, "not as long"),
    ({"size": 2**64 - 1}, "not as long"),
    ({"kind": b"mailbox"}, "not a ring"), ({"kind": b"ring\0x"}, "not a ring"), ({"kind": b"rng"}, "not a ring"),
    ({"schema": 100}, "not whole"), ({"schema": 0}, "not whole"),
]


@pytest.fixture
def ring(world: Any) -> Iterator[str]:
    yield number_ring(world.name)
    world.remove()


@pytest.mark.parametrize(("changes", "why"), HEADERS, ids=str)
def test_a_header_that_lies_is_refused(ring: str, changes: dict[str, Any], why: str, peek: Peek) -> None:
    rewrite(ring, **changes)
    with pytest.raises(SegmentError), Segment(ring) as segment:  # Python does not believe it either
        attach(segment, "ring", None)
    assert refused(peek(ring), why)


@pytest.mark.parametrize("size", [0, 63, 64, 300, 4096, 8191])
def test_a_file_cut_short_is_refused(ring: str, size: int, peek: Peek) -> None:
    os.truncate(path_of(ring), size)
    assert refused(peek(ring), "too short" if size < FIXED.size else "not as long")


def test_a_file_with_holes_is_refused(ring: str, peek: Peek) -> None:
    raw = path_of(ring).read_bytes()
    os.truncate(path_of(ring), 4096)
    os.truncate(path_of(ring), len(raw))
    assert refused(peek(ring), "holes")


@pytest.fixture
def given_away(ring: str) -> Iterator[str]:
    """The ring, owned by nobody; ours again behind the test, else it could not be removed."""
    os.chown(path_of(ring), pwd.getpwnam("nobody").pw_uid, -1)
    yield ring
    os.chown(path_of(ring), os.getuid(), -1)


@pytest.mark.skipif(os.getuid() != 0, reason="only root can give a file away")
def test_only_accepted_owners_are_read(given_away: str, peek: Peek, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("TROCAR_SERVICE_USER", raising=False)
    assert refused(peek(given_away), "user who is not accepted")
    monkeypatch.setenv("TROCAR_SERVICE_USER", "daemon")
    assert refused(peek(given_away), "user who is not accepted")
    monkeypatch.setenv("TROCAR_SERVICE_USER", "nobody")
    assert peek(given_away).stdout.startswith("6 ")


def test_what_is_no_file_is_refused(ring: str, tmp_path: Path, peek: Peek) -> None:
    aside = tmp_path / "aside"
    aside.write_bytes(path_of(ring).read_bytes())
    path_of(ring).unlink()
    path_of(ring).symlink_to(aside)
    assert refused(peek(ring), "not for us to read")
    path_of(ring).unlink()
    os.mkfifo(path_of(ring))
    assert refused(peek(ring), "too short")
    path_of(ring).unlink()


def test_garbage_and_a_mailbox_are_refused(world: Any, ring: str, peek: Peek) -> None:
    create_mailbox(world.name, "io", "io", COMMANDS["io"])
    assert refused(peek(world.name, "io", "mailbox"), "is not a ring")
    path_of(ring).write_bytes(random.Random(1).randbytes(8192))
    assert refused(peek(ring), "not a Trocar segment")


@pytest.mark.parametrize(("old", "new", "why"), [
    (b"<i8", b">i8", "what dtype"), (b"<i8", b"<x8", "what dtype"), (b"<i8", b"<i4", "what dtype|contradict"),
    (b"<i8", b"<i1", "what dtype"), (b"S8", b"S0", "what dtype"), (b"S8", b"U8", "what dtype"),
    (b"<i8", b"(9,", "shape"), (b'"dtype"', b'"dtypf"', "strange schema"), (b'"S8"', b'"S8,', "what dtype"),
    (b"S8", b"S\0", "not whole"),
])
def test_a_schema_that_is_none_is_refused(ring: str, old: bytes, new: bytes, why: str, peek: Peek) -> None:
    raw = path_of(ring).read_bytes()
    assert len(old) == len(new) and old in raw
    path_of(ring).write_bytes(raw.replace(old, new, 1))
    done = peek(ring)
    assert done.returncode == 0 if new == b"<i4" else refused(done, why)


@pytest.mark.parametrize("behind", [b'{"name":"', b'"dtype":"'])
def test_a_schema_without_an_end_is_refused(ring: str, behind: bytes, peek: Peek) -> None:
    raw = path_of(ring).read_bytes()
    begin, end = raw.index(behind) + len(behind), TEXT_AT + len(SCHEMA.text) - 3
    path_of(ring).write_bytes(raw[:begin] + b"x" * (end - begin) + raw[end:])
    assert refused(peek(ring), "strange schema")


def test_heads_and_slots_that_no_writer_leaves_end_at_once(ring: str, peek: Peek) -> None:
    with Segment(ring, write=True) as hand:
        words, slot = hand.words(), (hand.header.first + 2 * hand.header.stride) // 8
        words[slot] = BUSY + 10  # the writer has come round to record 6
        assert refused(peek(ring), "no whole record")
        assert peek(ring, "--count", "2").stdout.startswith("5 ")
        for head in (BUSY, 2**64 - 1):
            words[HEAD] = head
            assert refused(peek(ring), f"its head is {head}")
        words[HEAD] = 1 << 40
        assert refused(peek(ring), "no whole record")
        words[HEAD], words[slot] = 6, 6
        words[slot - hand.header.stride // 8] = 0
        assert [line[0] for line in peek(ring, "--count", "3").stdout.splitlines()] == ["4", "6"]


def test_a_head_that_goes_backwards_ends_the_following(world: Any, ring: str, program: Path, tmp_path: Path) -> None:
    with (tmp_path / "out").open("w") as out, Segment(ring, write=True) as hand:
        follower = subprocess.Popen([program, ring, "--follow"], stdout=out, stderr=subprocess.PIPE, text=True)
        try:
            world.until(lambda: "6 1006" in (tmp_path / "out").read_text(), "what is there is printed at once")
            words = hand.words()
            words[HEAD], words[(hand.header.first + 3 * hand.header.stride) // 8] = 1, 0
            assert "the head went backwards" in follower.communicate(timeout=30)[1] and follower.returncode == 1
        finally:
            follower.kill()
            follower.communicate()


def mutations(raw: bytes, dice: random.Random, count: int) -> Iterator[bytes]:
    """Bytes of a ring with a few of them changed: anywhere in header, texts, head and slots, or the file's end."""
    interesting = (0, 1, 63, 64, 255, 4096, 1 << 16, 1 << 20, (1 << 31) - 1, 1 << 31, (1 << 32) - 1)
    text_end = TEXT_AT + len(SCHEMA.text) + 2
    for i in range(count):
        changed = bytearray(raw)
        for _ in range(dice.choice((1, 1, 2, 8))):
            at = dice.choice((dice.randrange(FIXED.size), dice.randrange(TEXT_AT, text_end), HEAD_AT,
                              dice.randrange(4096, len(raw))))
            if i % 3 == 0:
                changed[at] = dice.randrange(256)
            elif i % 3 == 1:
                changed[at : at + 4] = dice.choice(interesting).to_bytes(4, "little")
            else:
                changed[at] = dice.choice(b'"\\,:{}[]()<S?uif0189\0')
        yield bytes(changed[: len(raw)]) if i % 7 else bytes(changed[: dice.randrange(len(raw))])


def test_no_bytes_upset_it(world: Any, ring: str, tmp_path: Path) -> None:
    checked = build(tmp_path, *SANITIZED)
    raw, path = path_of(ring).read_bytes(), path_of(ring)
    outcomes = {0: 0, 1: 0}
    for case in [raw, *mutations(raw, random.Random(3), 300)]:
        path.write_bytes(case)
        done = subprocess.run([checked, ring, "--count", "3"], capture_output=True, timeout=30, check=False)
        assert done.returncode in outcomes and len(done.stderr.splitlines()) <= 2, done
        outcomes[done.returncode] += 1
        assert b"anitizer" not in done.stderr and b"runtime error" not in done.stderr, done.stderr.decode()
        if done.returncode == 0:  # what peek takes for a ring is one for Python too, but for what peek does not look at
            try:
                Segment(ring).close()
            except SegmentError as error:
                assert re.search("fingerprint|readable|its header says|is no name|twice", str(error)), error
    assert min(outcomes.values()) > 30, outcomes
