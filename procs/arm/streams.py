"""Who streams setpoints to an arm, and who may.

Goals of the arm's joints are one stream, those of its jaw another, efforts a third: they may come from different
programs. Of each of the first two there is one at a time: another program's goals are refused until the first has
paused for 0.1 s or has ended, so that they cannot end it. A stop ends the streams of all others than its sender, a goal
that is out of reach its own. What was ended stays ended, whatever it goes on to ask for, until it has paused for 0.5 s
and for three of its periods.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable
from dataclasses import dataclass
from enum import Enum
from typing import Final

from trocar.procs.node.requests import STREAM_ENDED, STREAM_PAUSE_NS, Request
from trocar.shm.mailbox.command_row import FREE

STREAM_NS: Final = 100_000_000  # a goal older than this is of no stream
PERIODS: Final = 3
MAX_PERIOD_NS: Final = 1_000_000_000  # goals that come more slowly are single ones
KEPT: Final = 32


class StreamKind(Enum):
    """What is streamed, in the words of the table of commands."""

    POSITION = "position"
    JAW = "jaw"
    EFFORT = "effort"

    __hash__ = object.__hash__  # a third of what an Enum's own takes


WORDS: Final = {StreamKind.POSITION: "positions", StreamKind.JAW: "jaw positions", StreamKind.EFFORT: "efforts"}


@dataclass(slots=True, eq=False)
class Stream:
    """What one program streams, of one kind; `ended` says why it is over."""

    kind: StreamKind
    sender: Hashable
    program: str
    asked_ns: int
    taken_ns: int = -STREAM_NS
    period_ns: int = 0
    ended: str = ""

    def has_paused(self, now_ns: int) -> bool:
        """It is over by itself."""
        return now_ns - self.asked_ns >= max(STREAM_PAUSE_NS, PERIODS * self.period_ns)


class Streams:
    """Of one arm. A sender is any value that is another one for another program."""

    def __init__(self) -> None:
        self._streams: dict[tuple[StreamKind, Hashable], Stream] = {}
        self._owners: dict[StreamKind, Stream] = {}
        """Of each kind the one whose goal was taken last."""
        self._leader: Hashable = None
        """Whose stream or move the arm follows."""
        self.asking: Stream | None = None
        """The stream whose goal is being looked at."""
        self._restarted_ns = -STREAM_PAUSE_NS

    def restart(self, now_ns: int) -> None:
        """The process restarts: what asks within STREAM_PAUSE_NS may be a stream that it does not know, and ends."""
        self._restarted_ns = now_ns

    def objection(self, kind: StreamKind, sender: Hashable, request: Request, now_ns: int) -> str:
        """Why the next goal of a stream is not taken, "": it is.

        What takes efforts away is not refused to those that a restart has interrupted.
        """
        stream = self._streams.get((kind, sender))
        if stream is None:
            stream = self._begin(kind, sender, request, now_ns)
        gap_ns = now_ns - stream.asked_ns
        if gap_ns >= STREAM_PAUSE_NS and stream.has_paused(now_ns):
            stream.ended, stream.period_ns = "", 0
        elif not stream.ended and gap_ns <= MAX_PERIOD_NS:
            stream.period_ns = gap_ns
        stream.asked_ns, self.asking = now_ns, stream
        owner = self._owners.get(kind)
        if owner is stream and not stream.ended:
            return ""
        if stream.ended:
            return f"{STREAM_ENDED}: {stream.ended}; pause for {STREAM_PAUSE_NS * 1e-9:g} s before the next one"
        if owner is not None and kind is not StreamKind.EFFORT and now_ns - owner.taken_ns <= STREAM_NS:
            return f"{owner.program} is streaming {WORDS[kind]}; stop it first (hold)"
        return ""

    def take(self, now_ns: int) -> None:
        """The goal that is asked for is followed."""
        stream = self.asking
        if stream is not None:
            stream.taken_ns = now_ns
            self._owners[stream.kind] = stream
            if stream.kind is not StreamKind.JAW:
                self._leader = stream.sender

    def is_running(self, now_ns: int) -> bool:
        """A goal of the stream that asks was taken not long ago, and no other program's since."""
        stream = self.asking
        return (stream is not None and now_ns - stream.taken_ns <= STREAM_NS
                and self._owners.get(stream.kind) is stream)

    def leads(self, sender: Hashable) -> bool:
        """What the arm follows is a stream or a move of this sender."""
        return self._leader is not None and self._leader == sender

    def lead(self, sender: Hashable) -> None:
        """It is a move of this sender."""
        self._leader = sender

    def interrupt(self) -> None:
        """The arm does something else now."""
        self._leader = self.asking = None

    def end(self, reason: str, now_ns: int, kinds: Iterable[StreamKind] = tuple(StreamKind), *,
            spared: Hashable = None) -> None:
        """End the streams of all programs, or of all but one that is `spared`."""
        for stream in self._streams.values():
            if stream.kind in kinds and stream.sender != spared and not stream.has_paused(now_ns):
                self.end_one(stream, reason)

    def end_one(self, stream: Stream, reason: str) -> None:
        """End this stream; why it ended first stays the reason."""
        stream.ended = stream.ended or reason
        self._leave(stream)

    def leave(self, sender: Hashable) -> None:
        """This sender streams no more: another program may begin at once."""
        for stream in tuple(self._owners.values()):
            if stream.sender == sender:
                self._leave(stream)

    def _leave(self, stream: Stream) -> None:
        if self._owners.get(stream.kind) is stream:
            del self._owners[stream.kind]

    def _begin(self, kind: StreamKind, sender: Hashable, request: Request, now_ns: int) -> Stream:
        if len(self._streams) >= KEPT:
            self._streams = {key: stream for key, stream in self._streams.items() if not stream.has_paused(now_ns)}
        program = request.origin.program or "another program"
        stream = self._streams[kind, sender] = Stream(kind, sender, program, now_ns)
        if (now_ns - self._restarted_ns < STREAM_PAUSE_NS
                and request.command.effect_for(request.text, request.values) > FREE):
            stream.ended = "the arm's process was restarted"
        return stream
