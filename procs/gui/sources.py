"""Data for pages: records of instances and values derived from them, read once a tick for all pages."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final, Protocol

import numpy as np
import orjson

from trocar.procs.crtk.names import none_such
from trocar.procs.gui.rings import Rings, present
from trocar.shm.memory.segment import SegmentError
from trocar.shm.system.subscriptions import Subscriber

PROGRAM: Final = "gui"
OPTIONS: Final = orjson.OPT_SERIALIZE_NUMPY
UNSEEN: Final = frozenset({"stamp_ns", "jacobian", "spatial_jacobian", "bias_generation", "pid_generation"})
"""Fields of records that no page shows."""
AGAIN_NS: Final = 500_000_000
"""Between two attempts to attach to an unreadable source."""

MADE: Final = 16
"""The most sources of families (plots and logs) that one page may open: each costs CPU time of the robot."""
OPENED: Final = 2
"""The most of them that are opened in a tick: a plot begins with the whole history of its ring."""


class Source(Protocol):
    """Data that pages show; open while a page does."""

    def read(self, now_ns: int) -> dict[str, Any]:
        """Its current value; `age` is that of its data, s."""

    def close(self) -> None:
        """No page uses it any more."""


class WantedRing:
    """A ring that is read; a present one with a subscription while it is open."""

    def __init__(self, system: str, instance: str, ring: str, *groups: str, kind: str | None = None,
                 rings: Rings = present) -> None:
        """Attach, and subscribe with these groups of fields; SegmentError if it cannot be read.

        `kind`: the layout must be that of this kind of process.
        """
        self._reader = rings(system, instance, ring, kind)
        self._subscriber: Subscriber | None = None
        if rings is not present:
            return
        try:
            self._subscriber = Subscriber(system, instance, PROGRAM)
            self._subscriber.want(ring, *groups)
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Unmap and unsubscribe."""
        self._reader.close()
        if self._subscriber is not None:
            self._subscriber.close()


class RecordSource(WantedRing):
    """The newest record of a ring, its fields by their names."""

    def __init__(self, system: str, instance: str, ring: str, *, simulated: bool,
                 cuts: Mapping[str, Any] | None = None, ages: bool = True, rings: Rings = present) -> None:
        """Attach and subscribe; SegmentError if it cannot be read.

        `cuts`: only these fields, and of each the value at this index. `ages`: not for records written on change only.
        """
        super().__init__(system, instance, ring, rings=rings)
        names = [name for name in self._reader.dtype.names or () if name not in UNSEEN]
        self._fields = [(name, _encoder(self._reader.field(name), None if cuts is None else cuts[name]))
                        for name in names if name != "sequence" and (cuts is None or name in cuts)]
        self._sequence, self._seen_ns, self._ages = 0, 0, ages
        self._simulated = simulated and rings is present

    def read(self, now_ns: int) -> dict[str, Any]:
        """Fields of the newest record; only `age` where there is none yet."""
        if not self._reader.newest():
            return {"age": None}
        if self._reader.sequence != self._sequence:
            is_first, self._sequence = not self._sequence, self._reader.sequence
            # In simulated time the age of a record is unknown: use the time of its last change.
            self._seen_ns = self._reader.stamp_ns if is_first and not self._simulated else now_ns
        age_s = max(0.0, (now_ns - self._seen_ns) * 1e-9) if self._ages else 0.0
        found: dict[str, Any] = {"age": round(age_s, 1), "gone": bool(self._reader.gone)}
        for name, encode in self._fields:
            found[name] = encode()
        return found


def _encoder(cell: np.ndarray[Any, Any], cut: Any = None) -> Callable[[], Any]:
    """JSON conversion of a field, or of its part at `cut`: non-finite numbers become null, bytes become text."""
    if isinstance(cut, np.ndarray):
        return lambda: cell[cut]
    if cut is not None:
        cell = cell[cut, ...] if isinstance(cut, int) else cell[cut]
    if cell.dtype.kind == "S":
        if cell.shape:
            return lambda: [word.decode(errors="replace") for word in cell.tolist()]
        return lambda: cell.item().decode(errors="replace")
    return cell.item if not cell.shape else lambda: cell


Maker = Callable[[], Source]


class Sources:
    """All sources for pages, by name; those in use by a page are open."""

    def __init__(self, makers: Mapping[str, Maker],
                 families: Mapping[str, Callable[[str], Maker]] | None = None) -> None:
        """`makers`: sources with fixed names. `families`: for each FAMILY, a factory for sources named `FAMILY:rest`.

        The factory gets `rest`; it raises ValueError if there is no such source.
        """
        self._makers, self._families = dict(makers), dict(families or {})
        self._made: dict[str, Maker] = {}
        self._open: dict[str, Source | None] = {}
        self._users: dict[str, int] = {}
        self._encoded: dict[str, bytes] = {}
        self._retry_ns: dict[str, int] = {}
        self._problems: dict[str, str] = {}
        self._now_ns = self._opened = 0

    def change(self, before: Sequence[str], after: Sequence[str]) -> None:
        """A page replaces its sources by these, each once; ValueError, and no change, if one of them does not exist."""
        makes = [name for name in after if ":" in name]
        if len(makes) > MADE:
            raise ValueError(f"{len(makes)} plots and logs on one page; allowed are {MADE}")
        taken: list[str] = []
        try:
            for name in after:
                self._take(name)
                taken.append(name)
        except ValueError:
            self.leave(taken)
            raise
        self.leave(before)

    def leave(self, names: Sequence[str]) -> None:
        """A page no longer uses these sources; those without users are deleted, because the number of names of a family
        is unlimited.
        """
        for name in names:
            self._users[name] -= 1
            if self._users[name]:
                continue
            del self._users[name]
            for known in (self._made, self._retry_ns, self._problems):
                known.pop(name, None)
            source = self._open.pop(name, None)
            if source is not None:
                source.close()

    def _take(self, name: str) -> None:
        """Another page uses it; ValueError if there is no such source."""
        family, _, rest = name.partition(":")
        if name not in self._users and family in self._families:
            self._made[name] = self._families[family](rest)
        if name not in self._makers and name not in self._made:
            raise ValueError(none_such("source", name[:80], self._makers))
        self._users[name] = self._users.get(name, 0) + 1

    def begin(self, now_ns: int) -> None:
        """A new tick: sources used from now on are read again."""
        self._now_ns, self._opened = now_ns, 0
        self._encoded.clear()

    def part(self, name: str) -> bytes:
        """A source as a part of a JSON object: `"name":{…}`; an unreadable one gives the reason in `problem`."""
        encoded = self._encoded.get(name)
        if encoded is None:
            encoded = self._encoded[name] = orjson.dumps(name) + b":" + orjson.dumps(self._read(name), option=OPTIONS)
        return encoded

    def _read(self, name: str) -> dict[str, Any]:
        source = self._open.get(name)
        try:
            if source is None:
                is_made = name in self._made
                if self._now_ns < self._retry_ns.get(name, 0) or (is_made and self._opened >= OPENED):
                    return {"age": None, "problem": self._problems.get(name, "")}
                self._opened += is_made
                self._retry_ns[name] = self._now_ns + AGAIN_NS
                source = self._open[name] = (self._made.get(name) or self._makers[name])()
            return source.read(self._now_ns)
        except (SegmentError, OSError, ValueError) as error:
            self._problems[name] = str(error)
            return {"age": None, "problem": str(error)}

    def close(self) -> None:
        """Close all sources."""
        for source in self._open.values():
            if source is not None:
                source.close()
        self._open.clear()
        self._users.clear()
