"""Recordings by name, and the selected part of one: topics by name or pattern, a stretch of its time."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Annotated, Final

import numpy as np
import typer
from numpy.typing import NDArray

from trocar.procs.crtk.names import none_such
from trocar.procs.machine.paths import given_file, not_found
from trocar.procs.recordings.reading import RecordingError, RecordingReader, Records, open_recording
from trocar.procs.tables.manifest import IN_TIME
from trocar.tools.analysis.places import all_folders
from trocar.tools.output.errors import Misuse, Problem

END_NS: Final = 1 << 62
FAST_HZ: Final = 10.0
APART_NS: Final = 3_000_000_000
"""A topic that ended this long before the others began is not part of their run."""
TIMED: Final = IN_TIME - {"supervisor"}
"""Kinds of processes that do the same in the same simulated time."""

TopicsOption = Annotated[
    list[str] | None,
    typer.Option(
        "--topics", metavar="TOPIC", help="Topic to read, e.g. PSM1/state or 'PSM*/*'; repeatable; default: all."),
]
FromOption = Annotated[float, typer.Option(
    "--from", min=0.0, metavar="S", help="Start of the range, in seconds after the start of the recording.")]
ToOption = Annotated[float | None, typer.Option(
    "--to", min=0.0, metavar="S", help="End, in seconds after the start of the recording.")]


@dataclass(frozen=True, slots=True)
class Stretch:
    """From one stamp to before another, ns of the system's time."""

    begin_ns: int = -END_NS
    end_ns: int = END_NS

    @property
    def stamps(self) -> tuple[int, int]:
        """Both ends, as they are read of a recording."""
        return self.begin_ns, self.end_ns

    def of(self, records: Records) -> Records:
        """Records in this stretch."""
        stamps = records.rows["stamp_ns"]
        chosen = (stamps >= self.begin_ns) & (stamps < self.end_ns)
        return Records(records.rows[chosen], records.local_ns[chosen], records.epoch[chosen])


def opened(path: Path) -> RecordingReader:
    """A recording by its path, or by its name in the list of `trocar recordings`; Problem if there is none."""
    found = given_file(path, all_folders())
    if not found.is_file():
        raise Problem(f"{path}: {not_found(path)}; trocar recordings lists those of a system")
    try:
        return open_recording(found)
    except RecordingError as error:
        raise Problem(str(error)) from None


def chosen_topics(known: Iterable[str], wanted: Sequence[str] | None) -> list[str]:
    """The selected topics of `known`, in their order; all without a selection. Problem if a pattern matches nothing."""
    names = list(known)
    for pattern in wanted or ():
        if not any(fnmatchcase(name, pattern) for name in names):
            raise Problem(none_such("topic", pattern, names))
    return [name for name in names if not wanted or any(fnmatchcase(name, pattern) for pattern in wanted)]


def tables_of(recording: RecordingReader, wanted: Sequence[str] | None, form: str) -> list[str]:
    """The selected topics with records; Problem if a pattern matches only topics with ROS messages, as views."""
    for pattern in wanted or ():
        found = [recording.topics[name] for name in chosen_topics(recording.topics, [pattern])]
        if all(topic.dtype is None for topic in found):
            origins = dict.fromkeys(f"{topic.instance}/{topic.ring}" for topic in found if topic.ring)
            raise Problem(f"{', '.join(topic.name for topic in found)}: {form} is for records, not for ROS messages; "
                          f"choose {' or '.join((*origins, '--format rosbag2'))}")
    return chosen_topics(recording.record_topics, wanted)


def start_ns(recording: RecordingReader) -> int:
    """Its start in the system's time (`run_begin_ns`); 0: it has no record."""
    rates = {name: recording.topics[name].rate_hz for name in recording.record_topics}
    return run_begin_ns(spans(recording, _of_the_run(rates)), rates)


def run_begin_ns(extents: Mapping[str, tuple[int, int]], rates: Mapping[str, float]) -> int:
    """Begin of the run itself, from the first and last stamps of its topics: older records were only kept in a ring.

    Records written by command (gains) or once a second stay in rings for minutes to hours, and the last records of a
    stopped process as long as the system is up. So the run begins with the first record of the topics with a high rate,
    without those that ended before the others began. 0: there is no record.
    """
    chosen = _of_the_run({name: rates[name] for name in extents})
    begin = END_NS
    for first, last in sorted((extents[name] for name in chosen), key=lambda each: each[1], reverse=True):
        if begin < END_NS and last < begin - APART_NS:
            break
        begin = min(begin, first)
    return begin if begin < END_NS else 0


def _of_the_run(rates: Mapping[str, float]) -> list[str]:
    """Topics with a high rate; where there is none those with any, else all."""
    found = list[str]()
    for least_hz in (FAST_HZ, 1e-9, 0.0):
        found = found or [name for name, rate in rates.items() if rate >= least_hz]
    return found


def spans(recording: RecordingReader, topics: Sequence[str], part: Stretch = Stretch()) -> dict[str, tuple[int, int]]:
    """The first and the last stamp of each topic in a stretch; those without a record or message there are left out."""
    found: dict[str, tuple[int, int]] = {}
    with_records = set(recording.record_topics)
    for name, piece in recording.pieces([name for name in topics if name in with_records], stamps=part.stamps):
        stamps = piece.rows["stamp_ns"]
        first, last = found.get(name, (END_NS, -END_NS))
        found[name] = min(first, int(stamps.min())), max(last, int(stamps.max()))
    for name in (name for name in topics if name not in with_records):
        if sent := [stamp for _, stamp, _ in recording.messages(name) if part.begin_ns <= stamp < part.end_ns]:
            found[name] = min(sent), max(sent)
    return found


def stretch(recording: RecordingReader, from_s: float = 0.0, to_s: float | None = None) -> Stretch:
    """The stretch given by `--from` and `--to`; without both all of it."""
    if to_s is not None and to_s <= from_s:
        raise Misuse(f"--to {to_s:g} is not after --from {from_s:g}")
    if not from_s and to_s is None:
        return Stretch()
    start = start_ns(recording)
    return Stretch(start + round(from_s * 1e9) if from_s else -END_NS,
                   start + round(to_s * 1e9) if to_s is not None else END_NS)


def no_records(recording: RecordingReader, topics: Sequence[str]) -> Problem:
    """Report for a stretch without records of these topics: the times for which there are some."""
    found, start = spans(recording, topics).values(), start_ns(recording)
    if not found:
        return Problem(f"{recording.path.name} has no record of {', '.join(topics)}")
    first, last = min(first for first, _ in found), max(last for _, last in found)
    return Problem(f"{recording.path.name} has no record there; it has some from {(first - start) * 1e-9:.3f} to "
                   f"{(last - start) * 1e-9:.3f} s")


def numbers(rows: NDArray[np.void], field: str) -> NDArray[np.float64]:
    """A field's values as numbers, a row for each record and a column for each element; of texts none."""
    values = rows[field].reshape(len(rows), -1) if len(rows) else np.zeros((0, 0))
    return values.astype(np.float64) if values.dtype.kind in "biuf" else np.zeros((len(rows), 0))
