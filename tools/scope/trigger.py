"""When a condition is true: evaluated at every record of its rings, on their stamps.

Between two records a field has the value of the first; an event is at its stamp alone. If rings are read at different
times, the evaluation ends at the newest stamp that all still active rings have.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from trocar.procs.crtk.field_paths import FieldCells
from trocar.procs.tables.code_row import ERROR
from trocar.procs.tables.codes import FAULTS
from trocar.shm.system.events import SEVERITIES
from trocar.tools.inspect.enumerations import words_of
from trocar.tools.output.errors import Misuse
from trocar.tools.scope.grammar import Comparison, Condition, EventSeen, FaultSeen, Joined, Leaf

Flags = NDArray[np.bool_]
Stamps = NDArray[np.int64]
Test = Callable[[NDArray[Any]], Flags]

COMPARE: Final[Mapping[str, Callable[[Any, Any], Any]]] = {
    ">": operator.gt, ">=": operator.ge, "<": operator.lt, "<=": operator.le, "==": operator.eq, "!=": operator.ne}
LAGS_NS: Final = 250_000_000
"""A ring whose newest record is this much older than others', or than the present time, is not waited for."""
IO_FAULTS: Final = [fault.code.encode() for fault in FAULTS]
YES: Final = {"true": 1.0, "yes": 1.0, "false": 0.0, "no": 0.0}


def field_test(leaf: Comparison, cells: FieldCells) -> Test:
    """A function that tests a comparison at each record; Misuse if field and value are incompatible."""
    if cells.is_text:
        if leaf.operator not in ("", "==", "!=") or leaf.of_size:
            raise Misuse(f"{leaf.path.text} is text: allowed are == and !=")
        word = b"" if not leaf.operator else leaf.written.encode()
        compare = COMPARE[leaf.operator or "!="]

        def says(records: NDArray[Any]) -> Flags:
            found: Flags = np.any(compare(cells.raw(records), word) & cells.valid(records)[:, None], axis=1)
            return found

        return says
    value, compare = _number(leaf, cells), COMPARE[leaf.operator or "!="]

    def holds(records: NDArray[Any]) -> Flags:
        numbers = cells.numbers(records)
        found = compare(np.abs(numbers) if leaf.of_size else numbers, value)
        some: Flags = np.any(found & np.isfinite(numbers), axis=1)
        return some

    return holds


def _number(leaf: Comparison, cells: FieldCells) -> float:
    if not isinstance(leaf.value, str):
        return leaf.value
    words = {word.partition(" (")[0]: float(number) for number, word in words_of(cells.field.text).items()}
    words |= YES if cells.field.dtype.endswith("?") else {}
    if leaf.value not in words:
        allowed = f"; its words are {', '.join(words)}" if words else ""
        raise Misuse(f"{leaf.path.text} is a number, {leaf.value!r} is none of its words{allowed}")
    return words[leaf.value]


def event_test(leaf: EventSeen | FaultSeen, words: Sequence[str]) -> Test:
    """A function that tests each event for a match; `words` are those except the name of the owner."""
    if isinstance(leaf, FaultSeen):
        return _FaultBegins()
    wanted = [word.encode() for word in words]
    severities = [SEVERITIES.index(word) if word in SEVERITIES[1:] else -1 for word in words]

    def seen(rows: NDArray[Any]) -> Flags:
        found = np.ones(len(rows), np.bool_)
        for word, severity in zip(wanted, severities, strict=True):
            found &= rows["severity"] == severity if severity > 0 else (
                (rows["code"] == word) | (rows["event"] == word) | (rows["component"] == word))
        if leaf.text:
            found &= np.array([leaf.text.encode() in text for text in rows["text"].tolist()], np.bool_)
        return found

    return seen


@dataclass(slots=True)
class _FaultBegins:
    """Test of the events of one process, called with all of them in order: in FAULT it repeats its state."""

    in_fault: bool = False

    def __call__(self, rows: NDArray[Any]) -> Flags:
        begins: Flags = (rows["severity"] == ERROR) & np.isin(rows["code"], IO_FAULTS)
        states = np.flatnonzero(rows["event"] == b"operating_state")
        faulty = np.append(self.in_fault, rows["state"][states] == b"FAULT")
        begins[states] |= faulty[1:] & ~faulty[:-1]
        self.in_fault = bool(faulty[-1])
        return begins


@dataclass(slots=True)
class _LeafState:
    """State of a leaf: unused stamps and values of its evaluation, and the value before."""

    is_event: bool
    tests: dict[str, Test]
    stamps: list[Stamps] = field(default_factory=list)
    flags: list[Flags] = field(default_factory=list)
    before: bool = False

    def take(self, topic: str, records: NDArray[Any], from_ns: int) -> None:
        if topic in self.tests and len(records):
            flags, stamps = self.tests[topic](records), records["stamp_ns"].astype(np.int64)
            self.stamps.append(stamps[stamps >= from_ns])
            self.flags.append(flags[stamps >= from_ns])

    def sorted(self) -> tuple[Stamps, Flags]:
        if not self.stamps:
            return np.zeros(0, np.int64), np.zeros(0, np.bool_)
        stamps, flags = np.concatenate(self.stamps), np.concatenate(self.flags)
        order = np.argsort(stamps, kind="stable")
        return stamps[order], flags[order]


class Trigger:
    """One condition, fed with the records of its rings."""

    def __init__(self, condition: Condition, tests: Sequence[tuple[Leaf, dict[str, Test]]], rates: Mapping[str, float]
                 ) -> None:
        """`tests`: for each leaf, as listed by `grammar.leaves`, the test functions by topic; `rates`, Hz."""
        self._condition = condition
        self._leaves = [_LeafState(not isinstance(leaf, Comparison), dict(made)) for leaf, made in tests]
        self._newest = {topic: 0 for topic, rate in rates.items() if rate > 0.0}

    def take(self, topic: str, records: NDArray[Any], from_ns: int = 0) -> None:
        """New records of a ring; those before `from_ns` are no triggers themselves."""
        for leaf in self._leaves:
            leaf.take(topic, records, from_ns)
        if len(records) and topic in self._newest:
            self._newest[topic] = int(records["stamp_ns"][-1])

    def begin(self, topic: str, record: NDArray[Any]) -> None:
        """Initial values: `record` (1,) is the newest of a ring before the start, which is no trigger itself."""
        for leaf in self._leaves:
            if not leaf.is_event and topic in leaf.tests and len(record):
                leaf.before = bool(leaf.tests[topic](record)[-1])

    def look(self, now_ns: int = 0, *, to_end: bool = False) -> tuple[Stamps, Flags]:
        """New stamps, in order, and whether the condition is true there; `to_end`: no more records will follow."""
        newest_ns = max(now_ns, *self._newest.values(), 0)
        moving = [stamp for stamp in self._newest.values() if stamp > newest_ns - LAGS_NS]
        horizon = np.iinfo(np.int64).max if to_end or not moving else min(moving)
        parts = [leaf.sorted() for leaf in self._leaves]
        looked = [stamps[stamps <= horizon] for stamps, _ in parts]
        # An event is over right after its stamp: two of them are two triggers.
        looked += [stamps[flags & (stamps <= horizon)] + 1 for leaf, (stamps, flags) in zip(
            self._leaves, parts, strict=True) if leaf.is_event]
        grid = np.unique(np.concatenate(looked))
        columns = [_on(grid, leaf, *part) for leaf, part in zip(self._leaves, parts, strict=True)]
        for leaf, (stamps, flags), column in zip(self._leaves, parts, columns, strict=True):
            later = stamps > horizon
            leaf.stamps, leaf.flags = [stamps[later]], [flags[later]]
            if len(column) and not leaf.is_event:
                leaf.before = bool(column[-1])
        found, rest = _evaluated(self._condition, columns)
        assert not rest
        return grid, found


def _on(grid: Stamps, leaf: _LeafState, stamps: Stamps, flags: Flags) -> Flags:
    """A leaf at the stamps of a grid."""
    if leaf.is_event:
        return np.isin(grid, stamps[flags])
    place = np.searchsorted(stamps, grid, "right") - 1
    held = np.append(flags, leaf.before)  # the last one is for -1
    return np.asarray(held[place], np.bool_)


def _evaluated(condition: Condition, columns: Sequence[Flags]) -> tuple[Flags, Sequence[Flags]]:
    """A tree over its leaves' columns, which it takes from the left; and those that are left."""
    if not isinstance(condition, Joined):
        return columns[0], columns[1:]
    found, columns = _evaluated(condition.parts[0], columns)
    for part in condition.parts[1:]:
        other, columns = _evaluated(part, columns)
        found = found & other if condition.word == "and" else found | other
    return (~found if condition.word == "not" else found), columns
