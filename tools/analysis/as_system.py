"""A recording as a crashed system, in memory private to this process: tools that read rings can read recordings."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Final

import numpy as np
import typer
from numpy.typing import NDArray

from trocar.procs.recordings.reading import RecordedTopic, RecordingReader, Records
from trocar.procs.recordings.records import joined
from trocar.shm.memory import private
from trocar.shm.memory.layout import MAX_DEPTH, schema_from_json
from trocar.shm.memory.segment import Segment, create, segment_name
from trocar.shm.ring.ring import HEAD
from trocar.shm.system import directory
from trocar.shm.time.lockstep import SCHEMA as CLOCK
from trocar.shm.time.lockstep import Table, create_clock
from trocar.tools.analysis.choosing import END_NS, Stretch, opened, start_ns, stretch
from trocar.tools.output.errors import Problem
from trocar.tools.output.printing import note

NAME = "recording"
MOST: Final = MAX_DEPTH - 2
"""Records of a ring."""
AT_ONCE: Final = 1000
RecordingOption = Annotated[Path | None, typer.Option(
    "--recording", metavar="FILE", help="Read a recording instead of a system.")]


@dataclass(frozen=True, slots=True)
class LookedAt:
    """The part of a recording to read: `--from` and `--to`, s after its start."""

    from_s: float = 0.0
    to_s: float | None = None


@contextlib.contextmanager
def recording_as_system(file: Path, wanted: Callable[[RecordedTopic], bool] = lambda topic: True,
                        part: LookedAt = LookedAt()) -> Iterator[str]:
    """The name of a system with the rings of a recording that are `wanted`; Problem if it is none, or already open.

    Their records are renumbered: records missing in the recording are reported, and leave no gap. Stamps are those of
    the recorded system. Rings have at most MOST records: of longer topics only the last stretch is read, which is
    reported.
    """
    name = re.sub(r"[^A-Za-z0-9_-]", "_", f"{NAME}-{file.stem}")[:64]
    with opened(file) as recording, contextlib.ExitStack() as held:
        try:
            private.keep(name)
        except KeyError:
            raise Problem(f"{file}: is open already") from None
        held.callback(private.forget, name)
        topics = [topic for topic in recording.topics.values() if topic.dtype is not None and wanted(topic)]
        kept = _newest(recording, topics, stretch(recording, part.from_s, part.to_s))
        begin_ns = max((each.begin_ns for each in kept if each.topic.rate_hz), default=-END_NS)
        if begin_ns > -END_NS:
            note(f"{file}: it has more than {MOST} records of a topic; only those from "
                 f"{(begin_ns - start_ns(recording)) * 1e-9:.1f} s on are read; --from and --to choose others")
        newest = max((_fill(name, each, begin_ns) for each in kept), default=(0, 0))
        _tell_time(name, *(newest if any(newest) else (0, recording.end_ns)))
        for problem in recording.problems:
            note(f"{file}: {problem}")
        yield name


class NewestRecords:
    """The newest records of a topic, as many as a ring can hold."""

    def __init__(self, topic: RecordedTopic, dtype: np.dtype[np.void]) -> None:
        self.topic, self._dtype = topic, dtype
        self.begin_ns = -END_NS
        """From here on all its records are present; it has older ones, too, unless this is -END_NS."""
        self._pieces: list[Records] = []
        self._count = 0

    @property
    def is_steady(self) -> bool:
        """Whether the topic is written continuously, or has events or commands. All others are written seldom, and
        stay valid until they are written again.
        """
        return bool(self.topic.rate_hz) or self.topic.ring in ("events", "audit")

    def add(self, piece: Records) -> None:
        """Its records in a chunk."""
        self._pieces.append(piece)
        self._count += len(piece.rows)
        if self._count > MOST + MOST // 4:
            self.records()

    def records(self) -> Records:
        """Those that are left, in the order of their numbers."""
        found = joined(self._pieces, self._dtype)
        if len(found.rows) > MOST:
            self.begin_ns = int(np.partition(found.rows["stamp_ns"], -MOST)[-MOST])
            found = Stretch(self.begin_ns).of(found)
        self._pieces, self._count = [found], len(found.rows)
        return found


def _newest(recording: RecordingReader, topics: Sequence[RecordedTopic], part: Stretch) -> list[NewestRecords]:
    """The part of `part` that rings can hold; for topics written seldom also from before it. Reads the file once."""
    kept = {topic.name: NewestRecords(topic, topic.dtype) for topic in topics if topic.dtype is not None}
    for name, piece in recording.pieces(list(kept), stamps=(-END_NS, part.end_ns)):
        found = part.of(piece) if kept[name].is_steady else piece
        if len(found.rows):
            kept[name].add(found)
    return list(kept.values())


def _fill(system: str, kept: NewestRecords, begin_ns: int) -> tuple[int, int]:
    """Its newest stamp, and the time of day at that moment; 0 if it has no record.

    Steady topics begin at `begin_ns`, from which all of them are present.
    """
    topic, found = kept.topic, kept.records()
    found = Stretch(begin_ns).of(found) if kept.is_steady and begin_ns > -END_NS else found
    rows = found.rows[-MOST:]
    rows["sequence"] = np.arange(1, len(rows) + 1)
    schema, depth = schema_from_json(topic.schema.encode()), len(rows) + 2
    name = segment_name(system, topic.instance, topic.ring)
    create(name, directory.RING, schema, depth, {"kind": topic.kind, **topic.info})
    with Segment(name, write=True) as segment:
        segment.claim(topic.instance)
        for begin in range(0, len(rows), AT_ONCE):
            _put(segment, schema.stride, begin + 1, rows[begin : begin + AT_ONCE])
        segment.words()[HEAD] = len(rows)
    return (int(rows["stamp_ns"][-1]), int(found.local_ns[-1])) if len(rows) else (0, 0)


def _put(segment: Segment, stride: int, number: int, rows: NDArray[Any]) -> None:
    """Records into their slots, the first of which has this number."""
    slots = np.zeros((len(rows), stride), np.uint8)
    slots[:, : rows.dtype.itemsize] = rows.view(np.uint8).reshape(len(rows), rows.dtype.itemsize)
    at = segment.header.first + number * stride
    segment.view[at : at + slots.nbytes] = slots.reshape(-1).data


def _tell_time(system: str, now_ns: int, local_ns: int) -> None:
    """A clock page that is stopped at the end of the part read: stamps are in a time of their own."""
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
