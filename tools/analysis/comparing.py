"""Two recordings side by side: differences topic by topic, and the data left out because it is real time."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from trocar.procs.recordings.reading import RecordedTopic, RecordingReader, Records
from trocar.tools.analysis.choosing import TIMED, Stretch, chosen_topics, spans
from trocar.tools.analysis.common_time import CommonTime, common_time
from trocar.tools.analysis.differences import TopicDifference, compared
from trocar.tools.analysis.tolerances import AllowedDifference, tolerance_of
from trocar.tools.output.printing import Say

REAL_TIME: Final = ("monotonic_ns", "local_ns", "write_ns", "since_ns", "pid", "place", "id", "origin",
                    "desired_origin", "sender")
"""Fields with wall-clock times, or names of a process and its commands: they differ between any two runs."""
EQUAL, WITHIN, DIFFERENT = "equal", "within", "different"


@dataclass(frozen=True, slots=True)
class RecordingDifference:
    """All compared topics, those that only one recording has, and the omissions, in words."""

    topics: tuple[TopicDifference, ...]
    only_a: tuple[str, ...]
    only_b: tuple[str, ...]
    left_out: tuple[str, ...]
    problems: tuple[str, ...]

    @property
    def compared(self) -> int:
        """Number of compared pairs of records; 0: their similarity is unknown."""
        return sum(topic.compared for topic in self.topics)

    @property
    def outcome(self) -> str:
        """EQUAL bit for bit, WITHIN the tolerances, or DIFFERENT."""
        if self.only_a or self.only_b or not self.compared:
            return DIFFERENT
        if all(topic.is_equal for topic in self.topics):
            return EQUAL
        return WITHIN if all(topic.is_within for topic in self.topics) else DIFFERENT


@dataclass(frozen=True, slots=True)
class Comparing:
    """How two recordings are compared."""

    how: str
    topics: Sequence[str] | None = None
    tolerances: Sequence[AllowedDifference] = ()
    common: bool = False
    """Only the time that both have."""
    as_a: bool = False
    """Only A's topics: B is the same run, recorded completely."""

    def of(self, a: RecordingReader, b: RecordingReader, stretches: tuple[Stretch, Stretch] = (Stretch(), Stretch()),
           say: Say = lambda text, fraction: None) -> RecordingDifference:
        """All differences; Problem if a named topic is in neither."""
        every = list(dict.fromkeys((*a.record_topics, *b.record_topics)))
        wanted = chosen_topics(every, self.topics)
        real = [] if self.topics else [name for name in wanted if not _in_time(a, b, name)]
        absent = _not_recorded(a, wanted) if self.as_a else []
        wanted = [name for name in wanted if name not in (*real, *absent)]
        both = [name for name in wanted if name in a.record_topics and name in b.record_topics]
        shared = common_time(a, b, stretches, self.how) if self.common else None
        found, unwanted = [], list[str]()
        for done, name in enumerate(both):
            say(name, done / len(both))
            found.append(self._topic(a, b, name, stretches, shared, unwanted))
        return RecordingDifference(
            tuple(found), tuple(name for name in wanted if name not in b.record_topics),
            tuple(name for name in wanted if name not in a.record_topics),
            _left_out(both, real, unwanted, absent, a, shared),
            tuple(f"{one.path.name}: {text}" for one in (a, b) for text in one.problems))

    def _topic(self, a: RecordingReader, b: RecordingReader, name: str, stretches: tuple[Stretch, Stretch],
               shared: CommonTime | None, unwanted: list[str]) -> TopicDifference:
        records = a.records(name, stamps=stretches[0].stamps), b.records(name, stamps=stretches[1].stamps)
        if shared is not None:
            records = shared.of(*records, a.topics[name].rate_hz > 0.0)
        absent = [field for field in on_demand(a.topics[name]) if any(_lacks(each, field) for each in records)]
        unwanted += [f"{name}.{field}" for field in absent]
        return compared(name, *records, self.how, (*REAL_TIME, *absent), units(a.topics[name]),
                        lambda field, unit: tolerance_of(self.tolerances, name, field, unit))


def units(topic: RecordedTopic) -> dict[str, str]:
    """The units of a topic's fields."""
    rows = json.loads(topic.schema)["fields"] if topic.schema else []
    return {str(row["name"]): str(row.get("unit", "")) for row in rows}


def on_demand(topic: RecordedTopic) -> list[str]:
    """Fields that are computed only while subscribed."""
    return [str(row["name"]) for row in json.loads(topic.schema)["fields"] if row.get("group")] if topic.schema else []


def _lacks(records: Records, field: str) -> bool:
    """Whether a number is missing in either recording."""
    known = field in (records.rows.dtype.names or ()) and records.rows[field].dtype.kind == "f"
    return known and bool(np.isnan(records.rows[field]).any())


def _in_time(a: RecordingReader, b: RecordingReader, name: str) -> bool:
    """Whether simulated time waits for the process, or its kind is unknown."""
    topic = a.topics.get(name) or b.topics[name]
    return topic.kind in TIMED or not topic.kind


def _not_recorded(a: RecordingReader, wanted: Sequence[str]) -> list[str]:
    """Named but unselected topics; for all topics it is known that no events or commands occurred."""
    found = spans(a, a.record_topics)
    return [name for name in wanted if name not in found
            and (name not in a.topics or a.topics[name].ring not in ("events", "audit"))]


def _left_out(both: Sequence[str], real: Sequence[str], unwanted: Sequence[str], absent: Sequence[str],
              a: RecordingReader, shared: CommonTime | None) -> tuple[str, ...]:
    """The data that was not compared, in words."""
    there = sorted({field for name in both for field in (_names(a, name)) if field in REAL_TIME}, key=REAL_TIME.index)
    said = [f"fields that depend on real time, or identify a process: {', '.join(there)}"] if there else []
    said += [f"time that only one has; compared: {shared.text}"] if shared is not None else []
    said += [f"computed on demand, and not requested all the time: {', '.join(unwanted)}"] if unwanted else []
    said += [f"not recorded: {', '.join(absent)}"] if absent else []
    return (*said, *([f"processes that run in real time: {', '.join(real)} (--topics compares them)"] if real else []))


def _names(recording: RecordingReader, topic: str) -> tuple[str, ...]:
    dtype = recording.topics[topic].dtype
    return (dtype.names or ()) if dtype is not None else ()


def as_dict(comparison: RecordingDifference) -> dict[str, Any]:
    """For programs."""
    def field(row: Any) -> dict[str, Any]:
        return {"field": row.name, "unit": row.unit, "differing": row.count, "beyond_tolerance": row.beyond,
                "tolerance": row.tolerance, "max": row.most, "rms": row.rms, "first": row.first, "worst": row.worst}

    return {
        "outcome": comparison.outcome, "equal": comparison.outcome == EQUAL, "compared": comparison.compared,
        "topics": [{"topic": row.name, "compared": row.compared, "only_a": row.only_a, "only_b": row.only_b,
                    "first_only_a_ns": row.first_only_a_ns, "first_only_b_ns": row.first_only_b_ns,
                    "equal": row.is_equal, "within": row.is_within, "other_layout": list(row.unknown),
                    "fields": [field(each) for each in row.fields]} for row in comparison.topics],
        "only_a": list(comparison.only_a), "only_b": list(comparison.only_b),
        "left_out": list(comparison.left_out), "problems": list(comparison.problems)}
