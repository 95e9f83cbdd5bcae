"""Finds processes without heartbeat: late ones are reported, hung ones killed. Pure: all times come from outside.

A running process changes its mark, the heartbeat. Its silence is measured in real time on every clock. One beat of the
supervisor counts for at most a QUARTER of the allowed silence: a stall of the supervisor may have stalled the others,
too, so each process gets several beats to change its mark. In a beat in which the supervisor itself was late, no
process is reported late.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Final

OWN_LATE_NS: Final = 60_000_000  # three of our beats
QUARTER: Final = 0.25
CALM_NS: Final = 1_000_000_000  # late again within this time: the same episode
WAITING_BEATS: Final = 8  # a process that waits for time reads it more often
LATE, HUNG, RESUMED = "late", "hung", "resumed"


@dataclass(frozen=True, slots=True)
class JudgedProcess:
    """One process to be judged in this beat: its mark and its limits, ns.

    Its silence does not count while the process `waits_for` is silent, too.
    """

    name: str
    mark: int
    late_ns: float
    hung_ns: float
    waits_for: str = ""


@dataclass(frozen=True, slots=True)
class Verdict:
    """`what` is LATE (once an episode), HUNG, or RESUMED after it was reported late; `silent_s`: duration, s."""

    name: str
    what: str
    silent_s: float


@dataclass(slots=True)
class _Silence:
    mark: int
    silent_ns: float = 0.0
    quiet_beats: int = 0
    reported: bool = False
    calm_at_ns: int = 0


class Judge:
    """Measures the silence of each process."""

    def __init__(self) -> None:
        self._silences: dict[str, _Silence] = {}
        self._last_ns: int | None = None

    def forget(self, names: Iterable[str]) -> None:
        """Restart the measurement for these processes, whose silence had an external cause."""
        for name in names:
            self._silences.pop(name, None)

    def beat(self, now_ns: int, members: Iterable[JudgedProcess]) -> Iterator[Verdict]:
        """One beat, at real time `now_ns`; processes that are not among the members are forgotten."""
        passed_ns = 0 if self._last_ns is None else now_ns - self._last_ns
        self._last_ns, known, self._silences = now_ns, self._silences, {}
        for member in members:
            silence = known.get(member.name) or _Silence(member.mark)
            self._silences[member.name] = silence
            if silence.mark != member.mark:
                if silence.reported:
                    yield Verdict(member.name, RESUMED, silence.silent_ns * 1e-9)
                silence.mark, silence.silent_ns, silence.reported = member.mark, 0.0, False
                silence.quiet_beats = 0
                continue
            silence.quiet_beats += 1
            if not _is_quiet(known.get(member.waits_for)):
                silence.silent_ns += min(passed_ns, member.hung_ns * QUARTER)
                yield from _judged(now_ns, member, silence, we_are_late=passed_ns > OWN_LATE_NS)


def _is_quiet(silence: _Silence | None) -> bool:
    return silence is not None and silence.quiet_beats >= WAITING_BEATS


def _judged(now_ns: int, member: JudgedProcess, silence: _Silence, *, we_are_late: bool) -> Iterator[Verdict]:
    silent_s = silence.silent_ns * 1e-9
    if silence.silent_ns > member.late_ns and not we_are_late:
        if not silence.reported and now_ns >= silence.calm_at_ns:
            silence.reported = True
            yield Verdict(member.name, LATE, silent_s)
        silence.calm_at_ns = now_ns + CALM_NS
    if silence.silent_ns > member.hung_ns:
        silence.silent_ns, silence.reported = 0.0, False
        yield Verdict(member.name, HUNG, silent_s)
