"""A recording as a system that has died, in memory of this process alone: what looks at rings looks at recordings."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from procs.recordings.reading import RecordedTopic, RecordingReader
from shm import directory, private
from shm.layout import schema_from_json
from shm.lockstep import SCHEMA as CLOCK
from shm.lockstep import Table, create_clock
from shm.ring import HEAD
from shm.segment import Segment, create, segment_name
from tools.errors import Problem
from tools.printing import note
from tools.recorded.choosing import opened

NAME = "recording"
RecordingOption = Annotated[Path | None, typer.Option(
    "--recording", metavar="FILE", help="Instead of a system: what a recording has.")]


@contextlib.contextmanager
def recording_as_system(file: Path, wanted: Callable[[RecordedTopic], bool] = lambda topic: True) -> Iterator[str]:
    """The name of a system with the rings of a recording that are `wanted`; Problem where it is none.

    Their records are counted anew: what the recording has not is told, and leaves no gap. Stamps are those of the
    system that was recorded.
    """
    name = f"{NAME}-{file.stem}"[:64].translate(str.maketrans(". ", "__"))
    with opened(file) as recording, contextlib.ExitStack() as held:
        private.keep(name)
        held.callback(private.forget, name)
        for topic in recording.topics.values():
            if topic.dtype is not None and wanted(topic):
                _fill(name, recording, topic)
        _tell_time(name, recording)
        for problem in recording.problems:
            note(f"{file}: {problem}")
        yield name


def _fill(system: str, recording: RecordingReader, topic: RecordedTopic) -> None:
    rows = recording.records(topic.name).rows.copy()
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


def _tell_time(system: str, recording: RecordingReader) -> None:
    """A clock page that stands at the recording's end: stamps are in time of its own."""
    stamps = [int(rows["stamp_ns"].max()) for name in recording.record_topics
              if len(rows := recording.records(name).rows)]
    create_clock(system, Table(()), create)
    with Segment(segment_name(system, "supervisor", "clock"), write=True) as page:
        words, first = page.words(), page.header.first
        for field, value in (("now_ns", max(stamps, default=0)), ("local_ns", recording.end_ns)):
            words[(first + CLOCK.offset(field)) // 8] = value


@contextlib.contextmanager
def system_or_recording(chosen: Callable[[str | None], str], system: str | None, recording: Path | None,
                        wanted: Callable[[RecordedTopic], bool] = lambda topic: True) -> Iterator[str]:
    """The system that is meant, or the recording in its place."""
    if recording is None:
        yield chosen(system)
        return
    try:
        with recording_as_system(recording, wanted) as name:
            yield name
    except KeyError:
        raise Problem(f"{recording}: is open already") from None
