"""What a program wants of an instance: what it reads is computed from its first use on, until it is closed."""

from __future__ import annotations

from trocar.procs.crtk.views import OpenTopic
from trocar.shm.mailbox.origins import program_name
from trocar.shm.system.subscriptions import Subscriber
from trocar.shm.time.clock import monotonic_ns, pause

POLL_S = 0.001


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
