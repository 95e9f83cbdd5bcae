"""What a program wants of instances: what it reads is computed from its first use on, until it is closed."""

from __future__ import annotations

from collections import Counter

from trocar.procs.crtk.views import OpenTopic
from trocar.shm.mailbox.origins import program_name
from trocar.shm.system.subscriptions import Subscriber
from trocar.shm.time.clock import monotonic_ns, pause

POLL_S = 0.001


class Wanted:
    """What all clients of a bridge together want of all instances; what none of them wants need not be computed."""

    def __init__(self, system: str, program: str) -> None:
        """`program`: what others are told who wants it."""
        self.system, self._program = system, program
        self._counts: Counter[tuple[str, str, str]] = Counter()
        self._subscribers: dict[str, Subscriber] = {}

    def take(self, source: OpenTopic) -> None:
        """One more wants a topic, with its groups; SegmentError when that cannot be asked for."""
        entry = source.entry
        if entry.instance not in self._subscribers:
            self._subscribers[entry.instance] = Subscriber(self.system, entry.instance, self._program)
        self._subscribers[entry.instance].want(entry.ring, *source.groups)
        self._counts.update((entry.instance, entry.ring, group) for group in ("", *source.groups))

    def leave(self, source: OpenTopic) -> None:
        """One wants it no more."""
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
        """Nothing is wanted any more."""
        for subscriber in self._subscribers.values():
            subscriber.close()
        self._subscribers.clear()


class OnDemand:
    """The wishes of one program at one instance; a context manager. It has no place there before the first of them."""

    def __init__(self, system: str, instance: str) -> None:
        self._address = system, instance
        self._subscriber: Subscriber | None = None
        self._wanted: set[tuple[str, tuple[str, ...]]] = set()

    def want(self, source: OpenTopic) -> None:
        """A topic of it, and what of that is computed on demand; SegmentError when it cannot be asked for."""
        wish = topic, groups = source.entry.ring, source.groups
        if wish in self._wanted:
            return
        if self._subscriber is None:
            self._subscriber = Subscriber(*self._address, program_name())
        self._subscriber.want(topic, *groups)
        self._wanted.add(wish)

    def close(self) -> None:
        """Nothing is wanted any more."""
        if self._subscriber is not None:
            self._subscriber.close()

    def __enter__(self) -> OnDemand:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()


def wait_until_computed(source: OpenTopic, seconds: float) -> bool:
    """Read new records until values on demand are there, for so long at most; whether they are."""
    end = monotonic_ns() + round(seconds * 1e9)
    while not source.is_computed:
        if monotonic_ns() >= end:
            return False
        pause(POLL_S)
        source.newest()
    return True
