"""Data sent without further requests: subscriptions, and reads that wait for their value."""

from __future__ import annotations

from typing import Any, Final, Protocol

from trocar.procs.crtk.messages import said
from trocar.procs.crtk.topics import EVENT
from trocar.procs.socket_bridge.connection import Connection
from trocar.procs.socket_bridge.topics import SharedTopic, Topics, age_of, comes_each, ended, message_of

EACH_NS: Final = 5_000_000
"""Between two checks of occasional topics."""
BURST: Final = 32
"""Of those at a time."""
READ_NS: Final = 2_000_000_000
"""That a read waits for a first record."""
COMPUTED_NS: Final = 200_000_000
"""And for values that are computed on demand."""
AGAIN_NS: Final = 2_000_000


class Feed(Protocol):
    """Something that is looked at when it is due."""

    due_ns: int
    """When that is."""

    def serve(self, link: Connection, now_ns: int, turn: int) -> tuple[int, int]:
        """Send the available records; returns the number sent and the number lost."""

    def close(self) -> None:
        """The client ends the feed."""


class Periodic:
    """The newest record of a topic, at a rate."""

    def __init__(self, topics: Topics, source: SharedTopic, rate_hz: float) -> None:
        """`source` is shared, and released at the end."""
        self._topics, self._source, self._period_ns = topics, source, round(1e9 / rate_hz)
        self.due_ns = self._seen = self._lost = 0

    def serve(self, link: Connection, now_ns: int, turn: int) -> tuple[int, int]:
        """Subscriptions of one rate are due together: their grid is the clock's."""
        self.due_ns = now_ns - now_ns % self._period_ns + self._period_ns
        source = self._source
        if not source.look(turn) or source.sequence == self._seen:
            return 0, 0
        self._seen = source.sequence
        if link.is_slow:
            self._lost += 1
            return 0, 1
        link.send(source.message(self._lost))
        self._lost = 0
        return 1, 0

    def close(self) -> None:
        """Release the topic."""
        self._topics.leave(self._source)


class Each:
    """Every record of a topic, the last earlier one first. Records that a client does not read wait in the ring."""

    def __init__(self, topics: Topics, source: SharedTopic, wants_last: bool) -> None:
        """`source` is the shared one, held so that the topic is wanted."""
        self._topics, self._source, self._topic = topics, source, topics.each(source.entry)
        self.due_ns = self._seen = self._lost = 0
        self._is_first = wants_last

    def serve(self, link: Connection, now_ns: int, turn: int) -> tuple[int, int]:
        """A few at a time."""
        self.due_ns, count, topic = now_ns + EACH_NS, 0, self._topic
        if self._is_first:
            self._is_first = False
            count += self._last(link)
        while count < BURST and not link.is_slow and topic.next():
            if topic.sequence > self._seen:
                lost, self._lost = topic.lost - self._lost, topic.lost
                link.send(ended(message_of(topic, topic.as_dict()), lost))
                count += 1
        return count, 0

    def _last(self, link: Connection) -> int:
        """The last one of before; of the operating state there always is one."""
        row = self._topic.as_dict() if self._topic.newest() else self._topics.last_state(self._source.entry)
        if row is None:
            return 0
        if self._topic.sequence:
            self._seen = self._topic.sequence
        link.send(ended(message_of(self._topic, row), 0))
        return 1

    def close(self) -> None:
        """Release the topic."""
        self._topic.close()
        self._topics.leave(self._source)


class Reading:
    """One record, when there is one and its values on demand have been computed."""

    def __init__(self, topics: Topics, source: SharedTopic, number: Any, now_ns: int) -> None:
        """`number`: the client's for its question."""
        self._topics, self._source, self._number, self._begun_ns = topics, source, number, now_ns
        self.due_ns, self.is_done = now_ns, False

    def serve(self, link: Connection, now_ns: int, turn: int) -> tuple[int, int]:
        """Answer, or look again soon."""
        self.due_ns, waited_ns, topic = now_ns + AGAIN_NS, now_ns - self._begun_ns, self._source.topic
        if self._source.look(turn) and (waited_ns > COMPUTED_NS or not topic.groups or topic.is_computed):
            link.send(said("answer", self._number, topic=topic.entry.name, **topic.as_dict(), age_s=age_of(topic)))
        elif waited_ns > (COMPUTED_NS if topic.entry.kind == EVENT else READ_NS):
            link.send(said("error", self._number, error=f"{topic.entry.name}: nothing yet"
                           + (f" ({problem})" if (problem := topic.problem()) else "")))
        else:
            return 0, 0
        self.is_done = True
        return 1, 0

    def close(self) -> None:
        """Release the topic."""
        self._topics.leave(self._source)


def subscribed(topics: Topics, name: str, rate_hz: float, wants_last: bool = True) -> Feed:
    """A subscription; SegmentError where there is no topic."""
    entry = topics.find(name)
    source = topics.share(entry)
    try:
        return Each(topics, source, wants_last) if comes_each(entry) else Periodic(topics, source, rate_hz)
    except BaseException:
        topics.leave(source)
        raise
