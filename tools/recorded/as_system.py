"""A recording as a system that has died, in memory of this process alone: what looks at rings looks at recordings."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Final

import numpy as np
import typer

from procs.recordings.reading import RecordedTopic, RecordingReader
from shm import directory, private
from shm.layout import MAX_DEPTH, schema_from_json
from shm.lockstep import SCHEMA as CLOCK
from shm.lockstep import Table, create_clock
from shm.ring import HEAD
from shm.segment import Segment, create, segment_name
from tools.errors import Problem
from tools.printing import note
from tools.recorded.choosing import Stretch, opened, start_ns, stretch

NAME = "recording"
MOST: Final = MAX_DEPTH - 2
"""Records of a ring."""
RecordingOption = Annotated[Path | None, typer.Option(
    "--recording", metavar="FILE", help="Instead of a system: what a recording has.")]


@dataclass(frozen=True, slots=True)
class LookedAt:
    """What of a recording is looked at: `--from` and `--to`, s after its start."""

    from_s: float = 0.0
    to_s: float | None = None


@contextlib.contextmanager
def recording_as_system(file: Path, wanted: Callable[[RecordedTopic], bool] = lambda topic: True,
                        part: LookedAt = LookedAt()) -> Iterator[str]:
    """The name of a system with the rings of a recording that are `wanted`; Problem where it is none, or open already.

    Their records are counted anew: what the recording has not is told, and leaves no gap. Stamps are those of the
    system that was recorded. Rings have at most MOST records: of what has more the last stretch is looked at, and
    that is told.
    """
    name = re.sub(r"[^A-Za-z0-9_-]", "_", f"{NAME}-{file.stem}")[:64]
    with opened(file) as recording, contextlib.ExitStack() as held:
        try:
            private.keep(name)
        except KeyError:
            raise Problem(f"{file}: is open already") from None
        held.callback(private.forget, name)
        topics = [topic for topic in recording.topics.values() if topic.dtype is not None and wanted(topic)]
        shown = _that_fits(recording, topics, stretch(recording, part.from_s, part.to_s), file)
        newest = max((_fill(name, recording, topic, shown) for topic in topics), default=(0, 0))
        _tell_time(name, *(newest if any(newest) else (0, recording.end_ns)))
        for problem in recording.problems:
            note(f"{file}: {problem}")
        yield name


def _that_fits(recording: RecordingReader, topics: Sequence[RecordedTopic], part: Stretch, file: Path) -> Stretch:
    """The end of `part` of which rings can hold all records with a rate; said where that is not all of it."""
    begin_ns = part.begin_ns
    for topic in topics:
        stamps = part.of(recording.records(topic.name)).rows["stamp_ns"] if topic.rate_hz else ()
        if len(stamps) > MOST:
            begin_ns = max(begin_ns, int(np.sort(stamps)[-MOST]))
    if begin_ns > part.begin_ns:
        note(f"{file}: it has more than {MOST} records of a topic; looked at is what comes from "
             f"{(begin_ns - start_ns(recording)) * 1e-9:.1f} s on; --from and --to choose")
    return Stretch(begin_ns, part.end_ns)


def _fill(system: str, recording: RecordingReader, topic: RecordedTopic, part: Stretch) -> tuple[int, int]:
    """Its newest stamp, and the time of day at that moment; 0 where it has no record.

    What is written seldom is how things are: it is taken from before `part`, too.
    """
    steady = topic.rate_hz or topic.ring in ("events", "audit")
    found = (part if steady else Stretch(end_ns=part.end_ns)).of(recording.records(topic.name))
    rows = found.rows[-MOST:].copy()
    rows["sequence"] = np.arange(1, len(rows) + 1)
    schema, depth = schema_from_json(topic.schema.encode()), len(rows) + 2
    name = segment_name(system, topic.instance, topic.ring)
    create(name, directory.RING, schema, depth, {"kind": topic.kind, **topic.info})
    slots = np.zeros((depth, schema.stride), np.uint8)
    slots[1 : len(rows) + 1, : rows.dtype.itemsize] = rows.view(np.uint8).reshape(len(rows), rows.dtype.itemsize)
    with Segment(name, write=True) as segment:
        segment.claim(topic.instance)
        segment.view[segment.header.first : segment.header.first + slots.nbytes] = slots.reshape(-1).data
        segment.words()[HEAD] = len(rows)
    return (int(rows["stamp_ns"][-1]), int(found.local_ns[-1])) if len(rows) else (0, 0)


def _tell_time(system: str, now_ns: int, local_ns: int) -> None:
    """A clock page that stands at the end of what is looked at: stamps are in time of its own."""
    create_clock(system, Table(()), create)
    with Segment(segment_name(system, "supervisor", "clock"), write=True) as page:
        words, first = page.words(), page.header.first
        for field, value in (("now_ns", now_ns), ("local_ns", local_ns)):
            words[(first + CLOCK.offset(field)) // 8] = value


@contextlib.contextmanager
def system_or_recording(chosen: Callable[[str | None], str], system: str | None, recording: Path | None,
                        wanted: Callable[[RecordedTopic], bool] = lambda topic: True,
                        part: LookedAt = LookedAt()) -> Iterator[str]:
    """The system that is meant, or the recording in its place."""
    if recording is None:
        yield chosen(system)
        return
    with recording_as_system(recording, wanted, part) as name:
        yield name
