"""The common time of two recordings: one stretch of each, the same for all topics with a rate.

A topic that ended in only one of them, because its process crashed, is not in common: this is reported.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from trocar.procs.recordings import names
from trocar.procs.recordings.reading import RecordingReader, Records
from trocar.tools.analysis.choosing import Stretch, spans, start_ns
from trocar.tools.analysis.differences import SEQUENCE, START, in_common
from trocar.tools.output.errors import Problem

SLACK_NS: Final = 3_000_000_000
"""Depth of rings, which are dumped one after the other: within it topics of one recording begin and end."""


@dataclass(frozen=True, slots=True)
class CommonTime:
    """Of two recordings, paired by `how`: the part that is compared."""

    how: str
    a: Stretch
    b: Stretch
    text: str
    """Its description in words."""

    def of(self, a: Records, b: Records, is_steady: bool) -> tuple[Records, Records]:
        """Records of one topic in the common time.

        Event-driven topics are older in many rings: they are compared as far back as both recordings have them.
        """
        if self.how == SEQUENCE:
            return in_common(a, b)
        begins = [self.a.begin_ns, self.b.begin_ns]
        if self.how != START and not is_steady and len(a.rows) and len(b.rows):
            begins = [min(begins[0], max(int(each.rows["stamp_ns"].min()) for each in (a, b)))] * 2
        return Stretch(begins[0], self.a.end_ns).of(a), Stretch(begins[1], self.b.end_ns).of(b)


def common_time(a: RecordingReader, b: RecordingReader, parts: tuple[Stretch, Stretch], how: str) -> CommonTime:
    """Common time of `parts` of both; Problem if there is none."""
    if how == SEQUENCE:
        return CommonTime(how, *parts, "the record numbers that both have, topic by topic")
    ours, theirs = (_extent(each, part) for each, part in zip((a, b), parts, strict=True))
    if how == START:
        whole_ns = min(ours[1] - ours[0], theirs[1] - theirs[0])
        ends = (ours[0], ours[0] + whole_ns), (theirs[0], theirs[0] + whole_ns)
    else:
        both = max(ours[0], theirs[0]), min(ours[1], theirs[1])
        ends = both, both
    if ends[0][1] < ends[0][0]:
        raise Problem(f"{a.path.name} and {b.path.name} have no time in common; --align start compares other runs")
    said = " and ".join(f"{(begin - start_ns(each)) * 1e-9:.3f} to {(end - start_ns(each)) * 1e-9:.3f} s of {name}"
                        for name, each, (begin, end) in (("A", a, ends[0]), ("B", b, ends[1])))
    stretches = [Stretch(begin, end + 1) for begin, end in ends]
    return CommonTime(how, stretches[0], stretches[1], said)


def _extent(recording: RecordingReader, part: Stretch) -> tuple[int, int]:
    """Time in which all topics with a rate are present, except those that began or ended apart from the others."""
    found = spans(recording, recording.record_topics, part)
    steady = [each for name, each in found.items() if recording.topics[name].rate_hz] or list(found.values())
    if not steady:
        raise Problem(f"{recording.path.name} has no records in this time")
    first, last = np.array(steady, np.int64).T
    is_of_rings = recording.metadata.get(names.SYSTEM, {}).get("kind") in (names.DUMP, names.FAULT)
    begin = first if is_of_rings else first[first <= first.min() + SLACK_NS]
    return int(begin.max()), int(last[last >= last.max() - SLACK_NS].min())
