"""The topics that clients read: each is attached and wanted once, however many clients subscribe to it."""

from __future__ import annotations

import json
from typing import Any, Final

from trocar.procs.crtk.demand import Wanted
from trocar.procs.crtk.names import Unknown, none_such
from trocar.procs.crtk.topics import EVENT, RECORD, TopicEntry, catalogue
from trocar.procs.crtk.views import OpenTopic, state_as_event

PROGRAM: Final = "socket_bridge"
STATE: Final = ("stamp_ns", "sequence", "state", "sub_state", "is_homed", "is_busy")
_INF: Final = float("inf")


class SharedTopic:
    """One topic, its newest record as a message: made once for all subscribers."""

    def __init__(self, system: str, entry: TopicEntry) -> None:
        """Attach; SegmentError when its ring cannot be read."""
        self.topic, self.entry, self.users = OpenTopic(system, entry), entry, 0
        self.sequence, self._begin, self._turn = 0, "", 0

    def look(self, turn: int) -> bool:
        """Take the newest record, once in each turn; whether there is one."""
        if turn != self._turn:
            self._turn = turn
            if self.topic.newest() and self.topic.sequence != self.sequence:
                self.sequence = self.topic.sequence
                self._begin = message_of(self.topic, self.topic.as_dict())
        return bool(self.sequence)

    def message(self, lost: int) -> bytes:
        """The record that was taken last, with how many the client has missed before it."""
        return ended(self._begin, lost)


def age_of(topic: OpenTopic) -> float | None:
    """Age of the record, s."""
    age_s = topic.age_s
    return round(age_s, 6) if 0 <= age_s < _INF else None


def message_of(topic: OpenTopic, row: dict[str, Any]) -> str:
    """A record as the beginning of a message, which `ended` completes."""
    known = {"op": "record", "topic": topic.entry.name, **row, "age_s": age_of(topic)}
    return json.dumps(known, allow_nan=False, separators=(",", ":"))[:-1]


def ended(begin: str, lost: int) -> bytes:
    """The whole message."""
    return f'{begin},"lost":{lost}}}'.encode() if lost else f"{begin}}}".encode()


class Topics:
    """All topics of the system, and those that are open."""

    def __init__(self, system: str) -> None:
        """Which there are is settled when a system starts."""
        self.system, self._wanted = system, Wanted(system, PROGRAM)
        self.entries = {entry.name: entry for entry in catalogue(system)}
        self._open: dict[str, SharedTopic] = {}

    def find(self, name: str) -> TopicEntry:
        """The topic of this name; Unknown has the nearest ones."""
        if name not in self.entries:
            raise Unknown(none_such("topic", name[:80], self.entries))
        return self.entries[name]

    def share(self, entry: TopicEntry) -> SharedTopic:
        """A topic, open for one client more; SegmentError when it cannot be read."""
        source = self._open.get(entry.name)
        if source is None:
            source = SharedTopic(self.system, entry)
            try:
                self._wanted.take(entry)
            except BaseException:
                source.topic.close()
                raise
            self._open[entry.name] = source
        source.users += 1
        return source

    def leave(self, source: SharedTopic) -> None:
        """That client has left it."""
        source.users -= 1
        if not source.users:
            del self._open[source.entry.name]
            self._wanted.leave(source.entry)
            source.topic.close()

    def each(self, entry: TopicEntry) -> OpenTopic:
        """A topic of which one client gets each record, in order."""
        return OpenTopic(self.system, entry)

    def last_state(self, entry: TopicEntry) -> dict[str, Any] | None:
        """For an arm that has not emitted any operating_state yet: the one in its record."""
        state = self.entries.get(f"{entry.instance}/state")
        found = state_as_event(self.system, state) if entry.event == "operating_state" and state is not None else None
        return found and {key: found[key] for key in STATE}

    def close(self) -> None:
        """Release everything."""
        self._wanted.close()
        for source in self._open.values():
            source.topic.close()
        self._open.clear()


def comes_each(entry: TopicEntry) -> bool:
    """Whether its records are occasional, so that each counts."""
    return entry.kind == EVENT or (entry.kind == RECORD and not entry.rate_hz)
