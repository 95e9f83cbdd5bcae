"""A program's demand for topics of instances: they are computed from the first use on, until it is closed."""

from __future__ import annotations

from collections import Counter

from trocar.procs.crtk.views import OpenTopic
from trocar.shm.mailbox.origins import program_name
from trocar.shm.system.subscriptions import Subscriber
from trocar.shm.time.clock import monotonic_ns, pause

POLL_S = 0.001


class Wanted:
    """The common demand of all clients of a bridge; topics without clients need not be computed."""

    def __init__(self, system: str, program: str) -> None:
        """`program`: the name that other programs see as subscriber."""
        self.system, self._program = system, program
        self._counts: Counter[tuple[str, str, str]] = Counter()
        self._subscribers: dict[str, Subscriber] = {}

    def take(self, source: OpenTopic) -> None:
        """Add a client for a topic with its groups; SegmentError when that fails."""
        entry = source.entry
        if entry.instance not in self._subscribers:
            self._subscribers[entry.instance] = Subscriber(self.system, entry.instance, self._program)
        self._subscribers[entry.instance].want(entry.ring, *source.groups)
        self._counts.update((entry.instance, entry.ring, group) for group in ("", *source.groups))

    def leave(self, source: OpenTopic) -> None:
        """Remove a client of a topic."""
        instance, ring, groups = source.entry.instance, source.entry.ring, source.groups
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


class OnDemand:
    """The demand of one program at one instance; a context manager. It takes a place there at the first `want`."""

    def __init__(self, system: str, instance: str) -> None:
        self._address = system, instance
        self._subscriber: Subscriber | None = None
        self._wanted: set[tuple[str, tuple[str, ...]]] = set()

    def want(self, source: OpenTopic) -> None:
        """Request a topic, with its groups that are computed on demand; SegmentError when that fails."""
        wish = topic, groups = source.entry.ring, source.groups
        if wish in self._wanted:
            return
        if self._subscriber is None:
            self._subscriber = Subscriber(*self._address, program_name())
        self._subscriber.want(topic, *groups)
        self._wanted.add(wish)

    def close(self) -> None:
        """Drop all demand."""
        if self._subscriber is not None:
            self._subscriber.close()

    def __enter__(self) -> OnDemand:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()


def wait_until_computed(source: OpenTopic, seconds: float) -> bool:
    """Read new records until values on demand are computed, at most for `seconds`; returns whether they are."""
    end = monotonic_ns() + round(seconds * 1e9)
    while not source.is_computed:
        if monotonic_ns() >= end:
            return False
        pause(POLL_S)
        source.newest()
    return True
