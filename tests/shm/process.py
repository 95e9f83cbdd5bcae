"""A process in the interleaving test: real code whose next step is found by running it again.

A program is a function that does its work on stand-ins for shared memory (tests/shm/simulated.py). It is deterministic
but for what it loads (and what the kernel answers). So it is run again from its beginning with the answers it got so
far, and stops where it asks for one more: that gives its next operation, and the stores before it. What is known of a
process is a tree of answers, `FakeNode`.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from types import FrameType
from typing import Any, NamedTuple

REAL = "real "  # names of files the real code comes from begin so
PLAIN = (int, float, str, bytes, tuple, type(None))
FIRST = ("fail", "merge", "fence")  # operations that others do not notice
BLOCKING = ("lock", "unlock", "claim", "sleep", "wake", "after", "quiet")

Address = tuple[str, int]
Group = tuple[tuple[int, int], ...]  # (cell, value) of one copy


class Pause(BaseException):
    """A program asked for something that is not known yet."""


class Note(NamedTuple):
    """Something a program has done, for the checks at the end."""

    text: Any


class Op(NamedTuple):
    """What a program asks for."""

    kind: str
    cells: tuple[int, ...] = ()
    argument: Any = None


class Actor:
    """One run of a program with the answers known so far; the stand-ins end in its methods."""

    def __init__(self, cells: dict[Address, int], history: tuple[Any, ...], merging: bool) -> None:
        self._cells, self._history, self._given, self._merging = cells, history, 0, merging
        self.pushes: list[Group | Note] = []
        self.notes: list[Any] = []
        self.op: Op | None = None
        self.private: Callable[[], Any] | None = None  # a program that merges says here what its objects have in them

    def _ask(self, kind: str, places: tuple[Address, ...] = (), argument: Any = None) -> Any:
        if self._given < len(self._history):
            self._given += 1
            self.pushes.clear()
            return self._history[self._given - 1]
        if self.op is None:
            self.op = Op(kind, tuple(map(self._cell, places)), argument)
        raise Pause

    def _cell(self, place: Address) -> int:
        return self._cells.setdefault(place, len(self._cells))

    def load(self, *places: Address) -> tuple[int, ...]:
        """The values there; those of several are loaded in any order."""
        loaded: tuple[int, ...] = self._ask("load", places)
        return loaded

    def store(self, *pairs: tuple[Address, int]) -> None:
        """Store values; those of one call reach the memory in any order."""
        self._push(tuple((self._cell(place), value) for place, value in pairs))

    def note(self, *text: Any) -> None:
        """Say what has been done; said even when the process is killed at its next step."""
        self._push(Note(text))

    def _push(self, item: Group | Note) -> None:
        if self.op is not None:  # a `finally` on the way out of a Pause: not reached yet
            raise Pause
        self.pushes.append(item)
        if isinstance(item, Note):
            self.notes.append(item.text)

    def merge(self, key: Any = ()) -> None:
        """Forget how we came here. Our private state is, all of it, `key`, what `private` gives, what was noted, where
        we are in the code, and plain local variables, but for those of the real code, which says what it has in `key`.
        """
        if not self._merging:
            return
        if self._given < len(self._history):
            self._ask("merge")
            return
        assert self.private is not None
        where: list[Any] = [key, self.private(), tuple(self.notes)]
        frame: FrameType | None = sys._getframe(1)
        while frame is not None and frame.f_code is not RUN:
            where.append((frame.f_code, frame.f_lasti))
            if not frame.f_code.co_filename.startswith(REAL):
                where += [item for item in frame.f_locals.items() if isinstance(item[1], PLAIN)]
            frame = frame.f_back
        self._ask("merge", (), tuple(where))

    def fence(self) -> None:
        """Wait until every store of ours is in the memory."""
        self._ask("fence")

    def lock(self, place: Address, description: int) -> bool:
        """Take a lock if it is free (as fcntl does it)."""
        return bool(self._ask("lock", (place,), description))

    def unlock(self, description: int) -> None:
        """Give back all locks of one description."""
        self._ask("unlock", (), description)

    def claim(self, place: Address) -> None:
        """Take a lock, waiting until it is free."""
        self._ask("claim", (place,), 0)

    def sleep(self, place: Address, value: int) -> None:
        """Futex wait."""
        self._ask("sleep", (place,), value)

    def wake(self, place: Address) -> int:
        """Futex wake, everybody."""
        return int(self._ask("wake", (place,)))

    def after(self, name: str) -> None:
        """Wait until another process is gone, its stores out and its locks free."""
        self._ask("after", (), name)

    def quiet(self) -> None:
        """Wait until nobody else can do anything; of several who wait so the first goes on."""
        self._ask("quiet")


Program = Callable[[Actor], None]


class FakeNode:
    """What a process does next, after one history of answers: `pushes` (stores and notes), then `op`."""

    __slots__ = ("_locals", "ahead", "before", "children", "groups", "history", "op", "pushes")

    def __init__(self, history: tuple[Any, ...], pushes: tuple[Group | Note, ...], op: Op, before: tuple[Any, ...]
                 ) -> None:
        """`before`: what was noted before `pushes`."""
        self.history, self.pushes, self.op, self.before = history, pushes, op, before
        self.groups = tuple(p for p in pushes if not isinstance(p, Note))
        self.ahead = (0, 0)  # what the process may touch from here (tests/shm/reduction.py)
        self.children: dict[Any, FakeNode] = {}
        self._locals: dict[Any, Local] = {}

    def at(self, done: int, partial: tuple[Any, ...] = ()) -> Local:
        """A process that has done so many of the pushes, and of a copy what `partial` says."""
        found = self._locals.get((done, partial))
        if found is None:
            found = self._locals[done, partial] = Local(self, done, partial)
        return found


class Local:
    """Where a process is; one object for each place, compared by identity. `partial`: what of a copy is loaded."""

    __slots__ = ("asleep", "done", "first", "kind", "node", "partial", "ready")

    def __init__(self, node: FakeNode, done: int, partial: tuple[Any, ...]) -> None:
        self.node, self.done, self.partial = node, done, partial
        self.ready = done == len(node.pushes)  # its operation is what comes next
        self.asleep = partial == ASLEEP
        self.kind = node.op.kind
        self.first = not self.ready or self.kind in FIRST

    def open(self) -> list[tuple[int, int]]:
        """What of a copy is not loaded yet: number and cell."""
        return [(k, cell) for k, cell in enumerate(self.node.op.cells) if not self.partial or self.partial[k] is None]

    @property
    def notes(self) -> tuple[Any, ...]:
        """All that was noted so far."""
        return self.node.before + tuple(p.text for p in self.node.pushes[: self.done] if isinstance(p, Note))


ASLEEP = ("asleep",)


def run(program: Program, cells: dict[Address, int], history: tuple[Any, ...], merging: bool = True) -> FakeNode:
    """What `program` does after the answers `history`; whatever the real code raises is a failure."""
    actor = Actor(cells, history, merging)
    try:
        program(actor)
        op = Op("end")
    except Pause:
        assert actor.op is not None
        op = actor.op
    except Exception as error:
        op = Op("fail", (), f"{type(error).__name__}: {error}")
    count = sum(isinstance(p, Note) for p in actor.pushes)
    return FakeNode(history, tuple(actor.pushes), op, tuple(actor.notes[: len(actor.notes) - count]))


RUN = run.__code__
