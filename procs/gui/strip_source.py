"""State of all arms, setup joints and teleoperations in a word each, and of the clock: for the strip of every page."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from typing import Any, Final

from trocar.procs.crtk.plain import plain
from trocar.procs.document.system import SystemConfig
from trocar.shm.memory.segment import SegmentError
from trocar.shm.system import directory
from trocar.shm.time.system_time import SystemTime

LATE_NS: Final = 1_000_000_000
"""As for all values on pages."""
ARM: Final = ("state", "is_homed", "is_busy", "reason")
TELEOP: Final = ("state", "masters", "slave", "following", "reason")
CONSOLE: Final = ("teleop_enabled",)
SYSTEM: Final = ("task", "waiting")


def word_of(state: str, *, is_homed: bool, is_busy: bool) -> str:
    """An arm's state in a word; `procs/gui/static/strip.js` has an icon for each."""
    if state == "ENABLED":
        return ("moving" if is_busy else "ready") if is_homed else "homing" if is_busy else "powered"
    return {"DISABLED": "powering" if is_busy else "off", "PAUSED": "paused", "FAULT": "fault"}.get(state, "no data")


class WatchedRecord:
    """Some fields of an instance's newest record, and its age."""

    def __init__(self, system: str, instance: str, fields: Sequence[str]) -> None:
        """Attach; SegmentError when it cannot be read."""
        self._reader = directory.reader(system, instance, "state", often=False)
        self._cells = {name: self._reader.field(name) for name in fields}
        self._sequence, self._seen_ns = 0, 0

    def read(self, now_ns: int) -> dict[str, Any]:
        """Empty: there is no record yet. `late`: its age in s, 0 while it is fresh."""
        if not self._reader.newest():
            return {}
        if self._reader.sequence != self._sequence:
            self._sequence, self._seen_ns = self._reader.sequence, now_ns
        late_s = (now_ns - self._seen_ns) // LATE_NS
        return {"late": late_s, **{name: plain(cell) for name, cell in self._cells.items()}}

    def close(self) -> None:
        """Unmap."""
        self._reader.close()


class StripSource:
    """`arms` by name: `word`, `late` (s), `reason`; `links`: teleoperations; `consoles`: whether they request
    teleoperation; `clock`, `speed`, and the system's `task`, and what it is `waiting` for.
    """

    def __init__(self, document: SystemConfig) -> None:
        self._records: dict[str, WatchedRecord] = {}
        self._arms = [row.name for rows in (document.arms, document.carts) for row in rows]
        self._teleops = [row.name for rows in (document.teleop_psms, document.teleop_ecms) for row in rows]
        self._consoles = [row.name for row in document.consoles]
        watched = ((self._arms, ARM), (self._teleops, TELEOP), (self._consoles, CONSOLE), (["system"], SYSTEM))
        for names, fields in watched:
            for name in names:
                with contextlib.suppress(SegmentError):
                    self._records[name] = WatchedRecord(document.name, name, fields)
        self._time = SystemTime(document.name)

    def read(self, now_ns: int) -> dict[str, Any]:
        """Changes with the states, not with time."""
        found = {name: record.read(now_ns) for name, record in self._records.items()}
        return {"age": 0.0, "arms": {name: _arm(found.get(name) or {}) for name in self._arms},
                "links": [{"name": name, **found[name]} for name in self._teleops if found.get(name)],
                "consoles": {name: bool(found.get(name, {}).get("teleop_enabled")) for name in self._consoles},
                "clock": self._time.clock, "speed": round(self._time.speed, 2),
                **{name: found.get("system", {}).get(name) for name in SYSTEM}}

    def close(self) -> None:
        """Unmap."""
        for record in self._records.values():
            record.close()
        self._time.close()


def _arm(found: dict[str, Any]) -> dict[str, Any]:
    if not found or found["late"]:
        return {"word": "no data", "late": found.get("late", 0), "reason": ""}
    word = word_of(found["state"], is_homed=found["is_homed"], is_busy=found["is_busy"])
    return {"word": word, "late": 0, "reason": found["reason"]}
