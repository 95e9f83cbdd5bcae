"""Subscriptions of users' processes: the newest record of a topic, and whether there is a newer one."""

from __future__ import annotations

from typing import Any, Final

from trocar.shm.ring.ring import RingReader
from trocar.shm.system.subscriptions import Subscriber

FASTEST_NS: Final = 2_000_000
SLOWEST_NS: Final = 10_000_000
"""Polling intervals for records, which wake no reader, and for commands while files are watched."""


class Subscription:
    """A topic of another process: the newest record, after `look`."""

    def __init__(self, ring: RingReader, subscriber: Subscriber, topic: str) -> None:
        """`topic` is INSTANCE/TOPIC."""
        self.ring, self.subscriber, self.topic = ring, subscriber, topic
        self._seen = 0
        rate_hz = float(ring.info.get("rate_hz") or 0.0)
        self.slice_ns = min(max(round(0.5e9 / rate_hz), FASTEST_NS), SLOWEST_NS) if rate_hz else SLOWEST_NS
        """Polling interval for its records."""
        names = (name for name in ring.dtype.names or () if name != "sequence")
        self._fields = {name: ring.field(name) for name in names}

    @property
    def has_news(self) -> bool:
        """Whether there is a record newer than at the last `look`."""
        return self.ring.head > self._seen

    def look(self) -> bool:
        """Take the newest record; False when there is none."""
        if self.ring.newest():
            self._seen = self.ring.sequence
            return True
        return False

    def __getitem__(self, field: str) -> Any:
        """A field of the record of the last `look`; KeyError lists the existing fields."""
        if field not in self._fields:
            raise KeyError(f"{self.topic} has no field {field}; it has: {', '.join(self._fields)}")
        return self._fields[field][()]
