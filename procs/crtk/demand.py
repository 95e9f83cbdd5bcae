"""A program's demand for topics of instances: they are computed from the first use on, until it is closed."""

from __future__ import annotations

from collections import Counter

from trocar.procs.crtk.topics import TopicEntry
from trocar.procs.crtk.views import OpenTopic
from trocar.shm.mailbox.origins import program_name
from trocar.shm.memory.closable import Closable
from trocar.shm.system.subscriptions import Subscriber
from trocar.shm.time.clock import monotonic_ns, pause

POLL_S = 0.001


class Wanted(Closable):
    """The common demand of all clients of a bridge; topics without clients need not be computed. A context manager."""

    def __init__(self, system: str, program: str = "", *, every: bool = False) -> None:
        """`program`: the name that other programs see as subscriber; default: that of this program.

        `every`: every record is read, also those of arms at rest, which otherwise write fewer.
        """
        self.system, self._program, self._every = system, program or program_name(), every
        self._counts: Counter[tuple[str, str, str]] = Counter()
        self._subscribers: dict[str, Subscriber] = {}

    def take(self, entry: TopicEntry) -> None:
        """Add a client for a topic with its groups; SegmentError when that fails."""
        if entry.instance not in self._subscribers:
            self._subscribers[entry.instance] = Subscriber(self.system, entry.instance, self._program,
                                                           every=self._every)
        self._subscribers[entry.instance].want(entry.ring, *entry.groups)
        self._counts.update((entry.instance, entry.ring, group) for group in ("", *entry.groups))

    def want(self, entry: TopicEntry) -> None:
        """The same, if there is no client for it yet."""
        if any((entry.instance, entry.ring, group) not in self._counts for group in ("", *entry.groups)):
            self.take(entry)

    def leave(self, entry: TopicEntry) -> None:
        """Remove a client of a topic."""
        instance, ring, groups = entry.instance, entry.ring, entry.groups
        self._counts.subtract((instance, ring, group) for group in ("", *groups))
        self._counts = +self._counts
        subscriber = self._subscribers[instance]
        over = [group for group in groups if (instance, ring, group) not in self._counts]
        if (instance, ring, "") not in self._counts:
            subscriber.drop(ring)
        elif over:
            subscriber.drop(ring, *over)
        if not any(key[0] == instance for key in self._counts):
            self._subscribers.pop(instance).close()

    def close(self) -> None:
        """Drop all demand."""
        for subscriber in self._subscribers.values():
            subscriber.close()
        self._subscribers.clear()


def wait_until_computed(source: OpenTopic, seconds: float) -> bool:
    """Read new records until values on demand are computed, at most for `seconds`; returns whether they are."""
    end = monotonic_ns() + round(seconds * 1e9)
    while not source.is_computed:
        if monotonic_ns() >= end:
            return False
        pause(POLL_S)
        source.newest()
    return True
