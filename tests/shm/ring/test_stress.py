"""One writer and eight readers, real processes: no record is torn, and every one that is lost is counted."""

from __future__ import annotations

import json
import subprocess
from typing import Any

import pytest

from tests.shm.witness import topic
from tests.shm.wrongs import TEARING
from trocar.shm.system.directory import create_ring

WRITE = "from tests.shm.ring.crowd import write; write()"
READ = "from tests.shm.ring.crowd import read; read()"
CROWD = ("next", "next", "next", "next", "newest", "newest", "newest", "history")
SIZES = {216: 256, 4096: 64}  # bytes of payload: slots
FULL_SPEED, TABLED = 0, 1500
SHORT, LONG = 24_000, 1_000_000  # reads by all eight together


def meet(world: Any, size: int, rate_hz: int, reads: int) -> list[dict[str, Any]]:
    """The reports of the writer and of all readers; four come before the writer, four when it is at work."""
    create_ring(world.name, "io", topic(SIZES[size], size), {}, {})
    few = reads // 32  # who takes each record gets at most as many as there are, and is always behind at full speed
    if rate_hz:
        few = min(few, rate_hz // 2)
    quotas = [few if verb == "next" else (reads - 4 * few) // 4 + 1 for verb in CROWD]

    readers = [world.start(READ, "", *map(str, pair)) for pair in zip(CROWD, quotas, strict=True)]
    writer = world.start(WRITE, "", str(rate_hz))
    let(*readers[::2])
    assert all(reported(r) == "attached" for r in readers[::2])
    let(writer, *readers[1::2])
    assert all(reported(r) == "attached" for r in readers[1::2])
    assert all(reported(r) == "enough" for r in readers)
    ended = world.finish(writer)
    let(*readers)
    reports = [json.loads(report) for report in (ended, *map(world.finish, readers))]
    world.remove()
    for report in reports:
        print(json.dumps(report))
    return reports


def let(*children: subprocess.Popen[str]) -> None:
    """Let them attach, or end: all at once, because those that run leave the others little of the processors."""
    for child in children:
        assert child.stdin is not None
        child.stdin.write("x")
        child.stdin.flush()


def reported(child: subprocess.Popen[str]) -> str:
    assert child.stdout is not None
    return child.stdout.readline().strip()


def exact(reports: list[dict[str, Any]], reads: int) -> None:
    """All has been counted; that nothing was torn the readers have seen to themselves."""
    writer, readers = reports[0], reports[1:]
    assert sum(r["reads"] for r in readers) >= reads and all(r["reads"] > 0 for r in readers), reports
    followers = [r for r in readers if r["verb"] == "next"]
    assert all(r["received"] + r["lost"] == r["passed"] for r in followers), reports
    first = [r for r in followers if r["passed"] == writer["published"]]
    assert len(first) >= 2 and all(r["passed"] <= writer["published"] for r in readers), reports


@pytest.mark.slow
@pytest.mark.parametrize(("size", "rate_hz"), [*((size, FULL_SPEED) for size in SIZES), (min(SIZES), TABLED)])
def test_eight_readers_see_whole_records_and_count_drops(world: Any, size: int, rate_hz: int) -> None:
    exact(meet(world, size, rate_hz, SHORT), SHORT)


@pytest.mark.soak
@pytest.mark.parametrize("rate_hz", [FULL_SPEED, TABLED])
@pytest.mark.parametrize("size", SIZES)
def test_a_million_reads_are_whole_and_drops_counted(world: Any, size: int, rate_hz: int) -> None:
    exact(meet(world, size, rate_hz, LONG), LONG)


@pytest.mark.slow
@pytest.mark.parametrize("wrong", TEARING)
def test_a_record_torn_by_a_mistake_is_seen(world: Any, wrong: str) -> None:
    create_ring(world.name, "io", topic(3, 4096), {}, {})
    writer = world.start(WRITE, wrong, str(FULL_SPEED))
    reader = world.start(READ, wrong, "next", str(LONG))  # it reads where the writer is about to write
    let(writer, reader)
    assert reported(reader) == "attached"
    assert " is torn: " in reported(reader)
    assert reader.wait(timeout=30) == 1
    world.finish(writer)
    world.remove()
