"""tools/peek.c, the reader in C, sees what Python wrote, at any speed."""

from __future__ import annotations

import random
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.system.robot import DEMO, Robot
from tests.tools.peeking import NUMBER, SOURCE, Peek, build, fields_of, number_ring, read_back, refused, running
from trocar.shm.memory.segment import Segment, path_of, segment_name
from trocar.shm.ring.ring import RingWriter
from trocar.shm.system.directory import create_ring
from trocar.shm.time.clock import monotonic_ns
from trocar.shm.topics import Field, Topic

pytestmark = pytest.mark.slow

SCALARS = ("?", "u1", "i1", "<u2", "<u4", "<u8", "<i2", "<i4", "<i8", "<f2", "<f4", "<f8", "S1", "S7", "S64")
LINES = 150


@pytest.fixture
def system(world: Any) -> Iterator[str]:
    """Name of a system whose rings are removed behind the test."""
    yield world.name
    world.remove()


@pytest.fixture
def ring(system: str) -> str:
    return number_ring(system)


def some(random_bytes: np.random.Generator, dtype: np.dtype[Any], shape: tuple[int, ...]) -> Any:
    """Any values of a dtype: every bit pattern, NaN and infinity among them; texts of any bytes but zeros."""
    count = int(np.prod(shape, dtype=int))
    if dtype.kind == "b":
        return (random_bytes.integers(0, 2, count) == 1).reshape(shape)
    if dtype.kind == "S":
        texts = [random_bytes.integers(1, 256, int(random_bytes.integers(0, dtype.itemsize + 1)), np.uint8).tobytes()
                 for _ in range(count)]
        return np.array(texts, dtype).reshape(shape)
    return np.frombuffer(random_bytes.bytes(count * dtype.itemsize), dtype).reshape(shape)


def check_one(name: str, topic: Topic, seed: int, peek: Peek) -> None:
    """A record of random values comes out of peek as it was written."""
    generator = np.random.default_rng(seed)
    with Segment(name, write=True) as segment:
        writer = RingWriter(segment, "io")
        written = {}
        for _ in range(3):
            for f in topic.fields:
                cell = writer.field(f.name)
                cell[...] = written[f.name] = some(generator, cell.dtype, cell.shape)
            stamp = int(generator.integers(-2**62, 2**62))
            writer.publish(stamp)
        done = peek(name)
        assert (done.returncode, done.stderr) == (0, "")
        sequence, shown_stamp, values = fields_of(done.stdout.rstrip("\n"))
        assert (sequence, shown_stamp) == (3, stamp) and list(values) == [f.name for f in topic.fields]
        for f in topic.fields:
            cell = writer.field(f.name)
            shown = read_back(values[f.name], cell.dtype, cell.shape)
            assert shown.tobytes() == written[f.name].tobytes() or (
                cell.dtype.kind == "f" and np.array_equal(shown, written[f.name], equal_nan=True)), f
        del cell
        writer.close()


def test_every_dtype_comes_out_as_it_was_written(system: str, peek: Peek) -> None:
    fields = [Field(f"f{i}", dtype, "", 'of "each" {"name":"x","dtype":"y"}') for i, dtype in enumerate(SCALARS)]
    fields += [Field(f"a{i}", f"(3,){dtype}", "", "größer") for i, dtype in enumerate(SCALARS)]
    topic = Topic("all", "io", tuple(fields), depth=4)
    create_ring(system, "io", topic, {}, {})
    check_one(segment_name(system, "io", "all"), topic, 1, peek)


def test_any_order_of_fields_and_any_shape_is_laid_out_alike(system: str, peek: Peek) -> None:
    dice = random.Random(2)
    for case in range(60):
        fields = []
        for i in range(dice.randint(1, 12)):
            shape = "".join(f"{dice.choice((0, 1, 2, 3, 5))}," for _ in range(dice.choice((0, 0, 1, 1, 2, 3))))
            fields.append(Field(f"x{i}", (f"({shape})" if shape else "") + dice.choice(SCALARS), "", ""))
        topic = Topic(f"case{case}", "io", tuple(fields), depth=dice.randint(2, 5))
        create_ring(system, "io", topic, {}, {})
        check_one(segment_name(system, "io", topic.name), topic, case, peek)


def test_the_newest_records_are_printed_oldest_first(ring: str, peek: Peek) -> None:
    lines = [rf'{i} {1000 + i} value={100 + i} text="a\x22\x5c\x0a"' + "\n" for i in range(4, 7)]
    system, instance, topic = ring.removeprefix("/trocar~").split("~")
    assert peek(system, instance, topic).stdout == lines[2] == peek(ring).stdout
    assert peek(ring, "--count", "2").stdout == lines[1] + lines[2]
    assert peek(ring, "--count", "99").stdout == "".join(lines)
    assert peek(ring, "text", "value", "--count", "1").stdout == lines[2]
    assert peek(ring, "value").stdout == "6 1006 value=106\n"
    assert peek(ring, "--follow", "--count", "1").stdout == lines[2]


def test_a_field_that_is_not_there_is_named(ring: str, peek: Peek) -> None:
    done = peek(ring, "value", "speed")
    assert (done.returncode, done.stdout) == (1, "") and done.stderr.endswith(": there is no field speed\n")


@pytest.mark.parametrize("words", [(), ("a",), ("a", "b"), ("a", "b", "c", "--count"), ("a", "b", "c", "--count", "x"),
                                   ("/trocar~a~b~c", "--count", "0"), ("--help",)])
def test_wrong_use_is_told_from_trouble(words: tuple[str, ...], peek: Peek) -> None:
    done = peek(*words)
    assert (done.returncode, done.stdout) == (2, "") and done.stderr.startswith("peek: used wrongly: ")


def test_an_empty_ring_and_an_absent_one_are_said(system: str, peek: Peek) -> None:
    create_ring(system, "io", NUMBER, {}, {})
    empty, absent = peek(system, "io", "number"), peek(system, "io", "state")
    assert (empty.returncode, empty.stdout) == (1, "") and "nothing to read" in empty.stderr
    assert (absent.returncode, absent.stdout) == (1, "") and "no such segment" in absent.stderr


def test_it_is_as_short_as_promised() -> None:
    lines = SOURCE.read_text(encoding="utf-8").splitlines()
    assert len(lines) < LINES and max(map(len, lines)) <= 120


def test_a_ring_of_one_slot_has_nothing_whole(system: str, peek: Peek) -> None:
    topic = Topic("one", "io", NUMBER.fields, depth=1)
    create_ring(system, "io", topic, {}, {})
    with Segment(segment_name(system, "io", "one"), write=True) as segment:
        RingWriter(segment, "io").publish(1)
    assert refused(peek(system, "io", "one"), "no whole record")


HOOK = """
#define _DEFAULT_SOURCE
#include <stdatomic.h>
#include <stdlib.h>
#undef _DEFAULT_SOURCE
#undef atomic_thread_fence
static int before;
#define atomic_thread_fence(order) (before++ ? 0 : system(getenv("COME_ROUND")))
"""
COME_ROUND = """
import sys
from trocar.shm.ring.ring import RingWriter
from trocar.shm.memory.segment import Segment
writer = RingWriter(Segment(sys.argv[1], write=True), "io")
for n in range(7, 11):
    writer.publish(1000 + n)
"""


def test_a_writer_that_comes_round_behind_the_copy_is_noticed(
    ring: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "hook.h").write_text(HOOK)  # between R2 and R3 a writer is let in, once
    (tmp_path / "round.py").write_text(COME_ROUND)
    hooked = running(build(tmp_path, "-include", str(tmp_path / "hook.h")))
    monkeypatch.setenv("COME_ROUND", f"PYTHONPATH={SOURCE.parents[1]} {sys.executable} {tmp_path / 'round.py'} {ring}")
    done = hooked(ring, "value", "--follow", "--count", "2")
    assert done.stdout == "8 1008 value=106\n9 1009 value=106\n"  # 7 is lost, too: 8 to 10 are kept
    assert done.stderr == "peek: 2 lost\n"


PAIR = (Field("first", "<u8", "", ""), Field("filler", "(8192,)<u8", "", ""), Field("last", "<u8", "", ""))
STRESS = {  # so much is kept that little can be lost; so little, and so long to copy, that most is
    "small": Topic("small", "io", (PAIR[0], PAIR[2]), depth=1 << 16),
    "large": Topic("large", "io", PAIR, depth=2),
}
TOTAL, KEPT = 100_000, (1 << 16) - 1
RESTS = {"small": 0, "large": 40}  # while the writer is at it, all that is large may be lost
WRITER = """
import os, sys, time
from trocar.shm.ring.ring import RingWriter
from trocar.shm.memory.segment import Segment
writer = RingWriter(Segment(sys.argv[2], write=True), "io")
first, last = writer.field("first"), writer.field("last")
total, rests, out = int(sys.argv[3]), int(sys.argv[4]), sys.argv[5]
sys.stdin.readline()
for n in range(1, total + 1):
    size = os.path.getsize(out) if rests and n % (total // rests) == 0 else -1
    first[...] = last[...] = n * 0x9E3779B97F4A7C15 & 0xFFFFFFFFFFFFFFFF
    writer.publish(n)
    while size >= 0 and os.path.getsize(out) == size:  # until peek has printed one more
        time.sleep(0.001)
"""


@pytest.mark.parametrize("row", STRESS)
def test_nothing_is_torn_nor_miscounted_at_full_speed(world: Any, program: Path, tmp_path: Path, row: str) -> None:
    create_ring(world.name, "io", STRESS[row], {}, {})
    name = segment_name(world.name, "io", row)
    (tmp_path / "out").touch()
    child = world.start(WRITER, name, str(TOTAL), str(RESTS[row]), str(tmp_path / "out"))
    with (tmp_path / "out").open("w") as out, (tmp_path / "err").open("w") as err:
        follower = subprocess.Popen([program, name, "first", "last", "--follow"], stdout=out, stderr=err)
        try:
            maps = Path(f"/proc/{follower.pid}/maps")
            world.until(lambda: path_of(name).name in maps.read_text(), "peek has mapped the ring")
            child.stdin.write("\n")
            world.finish(child)
            world.remove()  # which ends peek, when it has read the rest
            assert follower.wait(timeout=30) == 0
        finally:
            follower.kill()
            follower.wait()
    lines = (tmp_path / "out").read_text().splitlines()
    for line in lines:
        sequence, stamp, first, last = line.split(" ")
        value = int(sequence) * 0x9E3779B97F4A7C15 & 0xFFFFFFFFFFFFFFFF
        assert (stamp, first, last) == (sequence, f"first={value}", f"last={value}")
    lost = [int(line.split()[1]) for line in (tmp_path / "err").read_text().splitlines()]
    assert lost == sorted(lost)
    assert len(lines) + (lost[-1] if lost else 0) == TOTAL
    assert len(lines) >= KEPT if row == "small" else len(lines) > 10 and lost


@pytest.fixture
def robot(world: Any, tmp_path: Path) -> Iterator[Robot]:
    """The demo system, up."""
    system = Robot(world.name, tmp_path)
    try:
        system.up(DEMO)
        yield system
    finally:
        system.down()


def test_it_reads_the_arm_of_a_running_system(robot: Robot, peek: Peek) -> None:
    before = monotonic_ns()
    done = peek(robot.name, "PSM1", "state", "--count", "20", "--follow")
    assert (done.returncode, done.stderr) == (0, "")
    records = [fields_of(line) for line in done.stdout.splitlines()]
    sequences = [sequence for sequence, _, _ in records]
    assert sequences == list(range(sequences[0], sequences[0] + 20))
    assert before - 10**9 < records[-1][1] < monotonic_ns()
    values = records[-1][2]
    assert values["state"] == '"DISABLED"' and int(values["count"]) == 7  # discs: no instrument is engaged yet
    names = re.findall(r'"([^"]*)"', values["names"])
    assert len(names) == 8 and all(names[:7]) and not names[7]
    shown = peek(robot.name, "IO1", "state", "position", "powered")
    assert list(fields_of(shown.stdout)[2]) == ["position", "powered"]
    assert len(fields_of(shown.stdout)[2]["position"].split(",")) == 7
