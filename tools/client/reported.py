"""What the instances of this machine report: events, read from shared memory."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from trocar.procs.crtk.topics import EVENT, TopicEntry, catalogue
from trocar.procs.crtk.views import OpenTopic


class SharedEvents:
    """The events of one instance that somebody follows."""

    def __init__(self, system: str, name: str) -> None:
        """Nothing is opened yet."""
        self._system, self._name = system, name
        self._open: dict[str, OpenTopic] = {}

    def _entries(self) -> dict[str, TopicEntry]:
        return {entry.event: entry for entry in catalogue(self._system)
                if entry.instance == self._name and entry.kind == EVENT}

    def names(self) -> list[str]:
        """Events that there are."""
        return list(self._entries())

    def follow(self, event: str) -> None:
        """Take in each event of this name, one of `names`, from now on."""
        if event not in self._open:
            self._open[event] = OpenTopic(self._system, self._entries()[event])

    def leave(self, event: str) -> None:
        """No more."""
        if event in self._open:
            self._open.pop(event).close()

    def taken(self) -> list[tuple[str, Mapping[str, Any]]]:
        """Those that came since the last call, with their names, in order; `lost`: so many before one were not seen."""
        found: list[tuple[str, Mapping[str, Any]]] = []
        for event, topic in self._open.items():
            lost = topic.lost
            while topic.next():
                found.append((event, topic.as_dict() | ({"lost": topic.lost - lost} if topic.lost > lost else {})))
                lost = topic.lost
        return sorted(found, key=lambda row: int(row[1]["sequence"]))

    def close(self) -> None:
        """Unmap."""
        for topic in self._open.values():
            topic.close()
        self._open.clear()
