"""Arbitration between programs that stream setpoints to an arm.

An arm has three kinds of streams, perhaps from different programs: goals of its joints, goals of its jaw, efforts. Of
each of the first two there is one at a time: another program's goals are refused until the first has paused for 0.1 s
or has ended, so that they cannot end it. A stop ends the streams of all programs but its sender's; a goal that is out
of reach ends its own stream. An ended stream stays ended, whatever it sends, until it has paused for 0.5 s and for
three of its periods. Where a bridge stalls, the stream of its client only seems to pause: it keeps its origin.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable
from dataclasses import dataclass
from enum import Enum
from typing import Final

from trocar.procs.node.requests import STREAM_ENDED, STREAM_PAUSE_NS
from trocar.shm.mailbox.command_row import FREE
from trocar.shm.mailbox.received import Request

STREAM_NS: Final = 100_000_000  # an older goal belongs to no stream
PERIODS: Final = 3
MAX_PERIOD_NS: Final = 1_000_000_000  # goals at longer intervals are single ones
KEPT: Final = 32


class StreamKind(Enum):
    """Kind of stream, in the words of the table of commands."""

    POSITION = "position"
    JAW = "jaw"
    EFFORT = "effort"

    __hash__ = object.__hash__  # takes a third of the time of Enum's own


POSITION, JAW, EFFORT = StreamKind
WORDS: Final = {POSITION: "positions", JAW: "jaw positions", EFFORT: "efforts"}


@dataclass(slots=True, eq=False)
class Stream:
    """A stream of one kind from one program; `ended` is the reason for its end."""

    kind: StreamKind
    sender: Hashable
    program: str
    asked_ns: int
    taken_ns: int = -STREAM_NS
    period_ns: int = 0
    ended: str = ""
    origin: int = 0
    """Number of the operator's command that its newest goal came from."""

    def has_paused(self, now_ns: int) -> bool:
        """Whether the stream has ended because its program sent no goals for a while."""
        return now_ns - self.asked_ns >= max(STREAM_PAUSE_NS, PERIODS * self.period_ns)


class Streams:
    """The streams of one arm. A sender is any hashable value that differs between programs."""

    def __init__(self, *, simulated: bool = False) -> None:
        """`simulated`: the system's time, in which pauses are measured, is simulated."""
        time = " of the system's time" if simulated else ""
        self._pause = f"pause for {STREAM_PAUSE_NS * 1e-9:g} s{time}"
        self._streams: dict[tuple[StreamKind, Hashable], Stream] = {}
        self._owners: dict[StreamKind, Stream] = {}
        """For each kind the stream whose goal was accepted last."""
        self._leader: Hashable = None
        """The sender of the stream or move that the arm follows."""
        self.asking: Stream | None = None
        """The stream whose goal is being checked."""
        self._restarted_ns, self._restart = -STREAM_PAUSE_NS, ""

    def restart(self, now_ns: int, reason: str) -> None:
        """The process restarts: a stream within STREAM_PAUSE_NS may be one from before, and is ended with `reason`."""
        self._restarted_ns, self._restart = now_ns, reason

    def objection(self, kind: StreamKind, sender: Hashable, request: Request, now_ns: int) -> str:
        """Why the next goal of a stream is refused, "": it is accepted.

        After a restart, commands that remove efforts are not refused.
        """
        stream = self._streams.get((kind, sender))
        if stream is None:
            stream = self._begin(kind, sender, request, now_ns)
        gap_ns = now_ns - stream.asked_ns
        origin = request.origin.id
        if gap_ns >= STREAM_PAUSE_NS and stream.has_paused(now_ns) and not (
                stream.ended and origin == stream.origin and request.sender.peer):
            stream.ended, stream.period_ns = "", 0
        elif not stream.ended and gap_ns <= MAX_PERIOD_NS:
            stream.period_ns = gap_ns
        stream.asked_ns, stream.origin, self.asking = now_ns, origin, stream
        owner = self._owners.get(kind)
        if owner is stream and not stream.ended:
            return ""
        if stream.ended:
            return f"{STREAM_ENDED}: {stream.ended}; {self._pause} before the next one"
        if owner is not None and kind is not EFFORT and now_ns - owner.taken_ns <= STREAM_NS:
            return f"{owner.program} is streaming {WORDS[kind]}; stop it first (hold)"
        return ""

    def take(self, now_ns: int) -> None:
        """Accept the goal that was checked."""
        stream = self.asking
        if stream is not None:
            stream.taken_ns = now_ns
            self._owners[stream.kind] = stream
            if stream.kind is not JAW:
                self._leader = stream.sender

    def is_running(self, now_ns: int) -> bool:
        """Whether a goal of this stream was accepted recently, and none of another program since."""
        stream = self.asking
        return (stream is not None and now_ns - stream.taken_ns <= STREAM_NS
                and self._owners.get(stream.kind) is stream)

    def leads(self, sender: Hashable) -> bool:
        """Whether the arm follows a stream or a move of this sender."""
        return self._leader is not None and self._leader == sender

    def lead(self, sender: Hashable) -> None:
        """The arm follows a move of this sender."""
        self._leader = sender

    def interrupt(self) -> None:
        """The arm no longer follows a stream or move."""
        self._leader = self.asking = None

    def end(self, reason: str, kinds: Iterable[StreamKind] = tuple(StreamKind), *, spared: Hashable = None) -> None:
        """End the streams of all programs, except one that is `spared`; also those that pause, or whose bridge stalls.
        """
        for stream in self._streams.values():
            if stream.kind in kinds and stream.sender != spared:
                self.end_one(stream, reason)

    def end_one(self, stream: Stream, reason: str) -> None:
        """End this stream; the first reason is kept."""
        stream.ended = stream.ended or reason
        self._leave(stream)

    def leave(self, sender: Hashable) -> None:
        """This sender's streams are over: another program may begin at once."""
        for stream in tuple(self._owners.values()):
            if stream.sender == sender:
                self._leave(stream)

    def _leave(self, stream: Stream) -> None:
        if self._owners.get(stream.kind) is stream:
            del self._owners[stream.kind]

    def _begin(self, kind: StreamKind, sender: Hashable, request: Request, now_ns: int) -> Stream:
        if len(self._streams) >= KEPT:
            self._streams = {key: stream for key, stream in self._streams.items() if not stream.has_paused(now_ns)}
        stream = self._streams[kind, sender] = Stream(kind, sender, request.sent_by, now_ns)
        if (now_ns - self._restarted_ns < STREAM_PAUSE_NS
                and request.command.effect_for(request.text, request.values) > FREE):
            stream.ended = self._restart
        return stream
