"""All interleavings of a few processes that share memory, with the real code deciding what each does next.

The explorer walks through the product of the processes (tests/shm/process.py) with the memory: depth first, which finds
a violation sooner, or breadth first (`shortest`), for a short schedule that leads to it.

What can happen (each is one step, and the explorer tries all orders):
- a store goes into the buffer of its process, a copy as one group;
- a buffered store reaches the memory, in program order or not, as the model has it (tests/shm/buffers.py);
- a load, from the own buffer or the memory; the words of a copy in any order. In the model "weak" it may also give a
  value that was overwritten since the last fence of its process, but none older than one it gave before: loads overtake
  loads;
- a fence or a kernel call (futex, lock), when the buffer is empty: both drain it;
- death by kill -9, at any point, also in the middle of a copy. What is in the buffer still reaches the memory, then
  the kernel gives back the locks.
Not in it: a store that becomes visible before an earlier load (possible on ARM; each word store has a fence before it
there), timeouts of waits (so a lost wake-up is a process that sleeps for ever), spurious wake-ups.

Why merging states is sound: what may follow depends on the memory, the buffers, what loads may still give, and the
private state of each process, which is a function of the answers it got, that is, of its node. States that agree in all
of that have the same future, so each is followed once. `Actor.merge` lets a program name its private state where the
way there does not matter any more. `schedules` counts the paths through the merged graph.

Why some steps go first: a store into the own buffer, a fence with nothing to drain, a merge, and a death while such a
step comes next touch nothing of others, and no step of others touches them; in any schedule they can be moved to the
front without changing what anybody sees. (In "weak" an early fence leaves a load more choices, never fewer.) A death
between two loads is a death before the next thing others can notice. What is left out besides, because no other process
touches the words concerned any more, is in tests/shm/reduction.py; with `reducing` off every order is tried, and
`schedules` counts them all.
"""

from __future__ import annotations

import contextlib
import gc
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import combinations
from typing import Any, NamedTuple

from tests.shm.buffers import CELLS, Buffer, Memory, Storage
from tests.shm.process import ASLEEP, BLOCKING, Address, FakeNode, Local, Note, Op, Program, run
from tests.shm.reduction import Reduction, Touched, touched

WAITING = ("fence", "quiet")
LIMIT = 1_000_000  # states; a mutant may never end
OWNERS = 100  # the owner of a lock: process, + OWNERS * description

Stale = tuple[tuple[int, tuple[int, ...]], ...]  # by cell: overwritten values a load may still give, oldest first
Label = tuple[int, str, tuple[int, ...], Any]  # which process, what, cells, value


class Broken(AssertionError):
    """Something that must never happen, and a schedule that leads there."""


class State(NamedTuple):
    """Everything the future depends on."""

    memory: Memory
    buffers: tuple[Buffer, ...]
    actors: tuple[Local, ...]
    stale: tuple[Stale, ...]


Step = tuple[Label, State]


@dataclass(frozen=True, slots=True)
class Outcome:
    """How one schedule ended: what each process noted, who sleeps or hangs, who was killed, and the memory."""

    notes: dict[str, tuple[Any, ...]]
    asleep: tuple[str, ...]
    stuck: tuple[str, ...]
    killed: tuple[str, ...]
    cells: dict[Address, int]

    def all(self, kind: str) -> list[Any]:
        """The notes (kind, x) of all processes, the x alone."""
        return [note[1] for notes in self.notes.values() for note in notes if note[0] == kind]


@dataclass(frozen=True, slots=True)
class Explored:
    """How much was explored."""

    states: int
    schedules: int
    outcomes: int


def nothing_more(outcome: Outcome) -> None:
    """The check of programs that check themselves."""


class Explorer:
    """All schedules of `programs` under a memory model; those in `kill` may die once, at any step."""

    def __init__(
        self, programs: dict[str, Program], check: Callable[[Outcome], None] = nothing_more, *, model: str = "tso",
        kill: str = "", before: dict[Address, int] | None = None,
    ) -> None:
        """`before`: what is in the memory at the beginning, 0 elsewhere; `check` judges each outcome."""
        self.merging = self.reducing = True
        self.shortest = False
        self._names, self._programs = list(programs), list(programs.values())
        self._check, self._weak = check, model == "weak"
        self._mortal = tuple(self._names.index(name) for name in kill.split())
        self._cells: dict[Address, int] = {place: i for i, place in enumerate(before or {})}
        self._first = (*(before or {}).values(), *[0] * (CELLS - len(self._cells)))
        self._storage = Storage(model, self._cells)
        self._merged: dict[Any, FakeNode] = {}
        self._came: dict[State, tuple[State, Label] | None] = {}
        self._reduction = Reduction(self._names)
        self._narrow: dict[State, tuple[int, Touched]] = {}  # where one step, of this process, stands for all

    def explore(self) -> Explored:
        """Follow every schedule; Broken at the first thing that must not happen."""
        count = len(self._programs)
        roots = [self._run(i, ()) for i in range(count)]
        nothing, locals_ = (self._storage.buffer(()),) * count, tuple(root.at(0) for root in roots)
        start = State(self._storage.memory(self._first), nothing, locals_, ((),) * count)
        for i, node in enumerate(roots):
            start = self._enter(start, i, node)
        edges: dict[State, list[State]] = {}
        with _no_collection():
            try:
                self._follow(start, edges)
                explored = Explored(len(edges), _paths(start, edges), sum(not e for e in edges.values()))
            finally:
                edges.clear()
                self._came.clear()
                self._narrow.clear()
        assert len(self._cells) <= CELLS
        return explored

    def _follow(self, start: State, edges: dict[State, list[State]]) -> None:
        """Find all states, and those that follow each."""
        self._came[start] = None
        pending = deque([start])
        while pending:
            state = pending.popleft() if self.shortest else pending.pop()
            steps = self._steps(state)
            for label, new in steps:
                if new not in self._came:
                    self._came[new] = state, label
                    pending.append(new)
            edges[state] = [new for _, new in steps]
            if len(edges) > LIMIT:
                raise Broken(self._story(state, f"no end after {LIMIT} states"))
            if not steps:
                self._judge(state)
            if not pending:
                pending.extend(self._doubtful())

    def _doubtful(self) -> list[State]:
        """States in which the steps left out would have mattered after all."""
        if not self._reduction.learn():
            return []
        found = [s for s, step in self._narrow.items() if not self._reduction.free(*step, s.actors, s.buffers)]
        for state in found:
            del self._narrow[state]
        return found

    def _run(self, i: int, history: tuple[Any, ...]) -> FakeNode:
        node = run(self._programs[i], self._cells, history, self.merging)
        self._reduction.add(i, node)
        return node

    def _enter(self, s: State, i: int, node: FakeNode) -> State:
        """Process `i` has come to `node`; who cannot be killed stores at once what it has to store."""
        if node.op.kind == "end":  # it loads no more
            s = self._fresh(s, i)
        if i in self._mortal or not node.pushes:
            return State(s.memory, s.buffers, _with(s.actors, i, node.at(0)), s.stale)
        buffers = s.buffers
        if node.groups:
            buffers = _with(buffers, i, self._storage.buffer(buffers[i].groups + node.groups))
        return State(s.memory, buffers, _with(s.actors, i, node.at(len(node.pushes))), s.stale)

    def _answer(self, s: State, i: int, answer: Any) -> State:
        node = s.actors[i].node
        child = node.children.get(answer)
        if child is None:
            child = node.children[answer] = self._run(i, (*node.history, answer))
        return self._enter(s, i, child)

    def _merge(self, s: State, i: int, key: Any) -> State:
        node = self._merged.get((i, key))
        if node is None:
            node = self._merged[i, key] = self._run(i, (*s.actors[i].node.history, None))
        s.actors[i].node.children[None] = node
        return self._enter(s, i, node)

    # Steps.

    def _steps(self, s: State) -> list[Step]:
        """All that can happen next; or only what one process does for itself, when there is such a thing."""
        for i, local in enumerate(s.actors):
            if local.first and (local.kind != "fence" or not local.ready or not s.buffers[i]):
                return self._first_step(s, i, local)
        if self.reducing:
            for i, local in enumerate(s.actors):
                if alone := self._alone(s, i, local):
                    return alone
        found: list[Step] = []
        for i, local in enumerate(s.actors):
            if s.buffers[i].groups:
                found += self._drain(s, i)
            if local.kind == "load":
                found += self._load(s, i, local)
            elif local.kind not in WAITING and not local.asleep and not s.buffers[i].groups:
                found += self._call(self._fresh(s, i), i, local.node.op)
        if not found:
            waiting = [i for i, a in enumerate(s.actors) if a.kind == "quiet"]
            found = [((i, "goes on", (), ""), self._answer(self._fresh(s, i), i, None)) for i in waiting[:1]]
        for i in self._mortal:
            found += self._kill(s, i)
        return found

    def _alone(self, s: State, i: int, local: Local) -> list[Step]:
        """A step of process `i` that matters to no other, with its death if it may die there; if there is one."""
        for drain in self._storage.lasting(s.buffers[i]):
            if self._is_free(s, i, (0, 1 << drain[0])):
                return [self._drained(s, i, *drain)]
        if local.kind == "load":
            for k, cell in local.open():
                if self._is_free(s, i, (1 << cell, 0)):
                    return list(self._load_one(s, i, local, k))
        elif local.kind not in WAITING and not local.asleep and not s.buffers[i]:
            loads, stores = touched(local.node.op)
            returned = self._held(s, 1 + i, OWNERS) if local.kind in ("unlock", "end") else ()
            if self._is_free(s, i, (loads, stores | sum(1 << cell for cell in returned))):
                steps = list(self._call(self._fresh(s, i), i, local.node.op))
                return steps and [*steps, *self._kill(s, i)]
        return []

    def _is_free(self, s: State, i: int, step: Touched) -> bool:
        free = self._reduction.free(i, step, s.actors, s.buffers)
        if free:
            self._narrow[s] = i, step
        return free

    def _first_step(self, s: State, i: int, local: Local) -> list[Step]:
        if not local.ready:
            return [*self._push(s, i), *self._kill(s, i)]
        if local.kind == "fail":
            raise Broken(self._story(s, f"{self._names[i]}: {local.node.op.argument}"))
        if local.kind == "merge":
            return [((i, "", (), ""), self._merge(s, i, local.node.op.argument))]
        return [((i, "fence", (), ""), self._answer(self._fresh(s, i), i, None))]

    def _push(self, s: State, i: int) -> Iterator[Step]:
        local = s.actors[i]
        item = local.node.pushes[local.done]
        actors = _with(s.actors, i, local.node.at(local.done + 1))
        if isinstance(item, Note):
            yield (i, "notes", (), item.text), State(s.memory, s.buffers, actors, s.stale)
        else:
            buffers = _with(s.buffers, i, self._storage.buffer((*s.buffers[i].groups, item)))
            what = (i, "buffers", tuple(c for c, _ in item), tuple(v for _, v in item))
            yield what, State(s.memory, buffers, actors, s.stale)

    def _drain(self, s: State, i: int) -> Iterator[Step]:
        return (self._drained(s, i, *drain) for drain in self._storage.drains(s.buffers[i]))

    def _drained(self, s: State, i: int, cell: int, value: int, rest: Buffer) -> Step:
        stale = self._overwritten(s, i, cell) if self._weak else s.stale
        memory = self._storage.stored(s.memory, cell, value)
        return (i, "stores", (cell,), value), State(memory, _with(s.buffers, i, rest), s.actors, stale)

    def _overwritten(self, s: State, by: int, cell: int) -> tuple[Stale, ...]:
        """The others may still load what is in `cell` now."""
        every = []
        for i, stale in enumerate(s.stale):
            olds = dict(stale)
            if i == by:
                olds.pop(cell, None)
            elif s.actors[i].kind != "end":
                olds[cell] = (*olds.get(cell, ()), s.memory.cells[cell])
            every.append(tuple(sorted(olds.items())))
        return tuple(every)

    def _fresh(self, s: State, i: int) -> State:
        return State(s.memory, s.buffers, s.actors, _with(s.stale, i, ())) if s.stale[i] else s

    def _kill(self, s: State, i: int) -> Iterator[Step]:
        local = s.actors[i]
        if i not in self._mortal or (local.ready and local.kind not in BLOCKING):
            return
        key = i, local.notes
        dead = self._merged.get(key) or self._merged.setdefault(key,
                                                                FakeNode((), (), Op("end", (), "killed"), local.notes))
        actors, fresh = _with(s.actors, i, dead.at(0)), _with(s.stale, i, ())
        item = () if local.ready else local.node.pushes[local.done]
        size = 0 if isinstance(item, Note) else len(item)
        for count in range(max(1, size)):  # of a copy each part of it may be done
            for part in combinations(item, count):
                buffers = _with(s.buffers, i, self._storage.buffer((*s.buffers[i].groups, part))) if part else s.buffers
                yield (i, "is killed", (), part), State(s.memory, buffers, actors, fresh)

    def _call(self, s: State, i: int, op: Op) -> Iterator[Step]:
        """A kernel call of a process whose buffer is empty; or its end, at which the kernel takes its locks."""
        cell, owner = (op.cells or (0,))[0], 1 + i
        label = (i, op.kind, op.cells, op.argument)
        if op.kind == "after":
            if self._gone(s, self._names.index(op.argument)):
                yield label, self._answer(s, i, None)
        elif op.kind in ("lock", "claim"):
            owner += OWNERS * op.argument
            if s.memory.cells[cell] == 0:
                memory = self._storage.stored(s.memory, cell, owner)
                yield label, self._answer(State(memory, s.buffers, s.actors, s.stale), i, True)
            elif op.kind == "lock":
                yield label, self._answer(s, i, s.memory.cells[cell] == owner)
        elif op.kind == "unlock":
            yield label, self._answer(self._unlocked(s, owner + OWNERS * op.argument, OWNERS**3), i, None)
        elif op.kind == "sleep":
            if s.memory.cells[cell] == op.argument:
                asleep = s.actors[i].node.at(s.actors[i].done, ASLEEP)
                yield label, State(s.memory, s.buffers, _with(s.actors, i, asleep), s.stale)
            else:
                yield label, self._answer(s, i, -1)
        elif op.kind == "wake":
            sleepers = [j for j, a in enumerate(s.actors) if a.asleep and a.node.op.cells == op.cells]
            for j in sleepers:
                s = self._answer(s, j, 0)
            yield (i, f"wakes {len(sleepers)}", (cell,), ""), self._answer(s, i, len(sleepers))
        elif op.kind == "end" and not self._gone(s, i):
            yield label, self._unlocked(s, owner, OWNERS)

    def _held(self, s: State, owner: int, modulus: int) -> list[int]:
        return [cell for cell, holder in s.memory.locks if holder % modulus == owner]

    def _unlocked(self, s: State, owner: int, modulus: int) -> State:
        memory = s.memory
        for cell in self._held(s, owner, modulus):
            memory = self._storage.stored(memory, cell, 0)
        return State(memory, s.buffers, s.actors, s.stale)

    def _gone(self, s: State, i: int) -> bool:
        local = s.actors[i]
        ended = local.kind == "end" and local.ready and not s.buffers[i]
        return ended and not self._held(s, 1 + i, OWNERS)

    def _load(self, s: State, i: int, local: Local) -> Iterator[Step]:
        for k, _ in local.open():
            yield from self._load_one(s, i, local, k)

    def _load_one(self, s: State, i: int, local: Local, k: int) -> Iterator[Step]:
        """Load the word `k` of a copy."""
        node = local.node
        cell, partial = node.op.cells[k], local.partial or (None,) * len(node.op.cells)
        for value, stale in self._values(s, i, cell):
            loaded = _with(partial, k, value)
            after = s if stale is s.stale else State(s.memory, s.buffers, s.actors, stale)
            if None in loaded:
                after = State(after.memory, after.buffers, _with(s.actors, i, node.at(local.done, loaded)), stale)
            else:
                after = self._answer(after, i, loaded)
            yield (i, "loads", (cell,), value), after

    def _values(self, s: State, i: int, cell: int) -> Iterator[tuple[int, tuple[Stale, ...]]]:
        """What a load may give, and what later loads of the process may give then."""
        own = s.buffers[i].own.get(cell)
        if own is not None or not s.stale[i]:
            yield s.memory.cells[cell] if own is None else own, s.stale
            return
        olds = dict(s.stale[i])
        values = olds.pop(cell, ())
        yield s.memory.cells[cell], _with(s.stale, i, tuple(sorted(olds.items())))
        for k, value in enumerate(values):
            yield value, _with(s.stale, i, tuple(sorted({**olds, cell: values[k:]}.items())))

    # Judging.

    def _judge(self, s: State) -> None:
        actors = dict(zip(self._names, s.actors, strict=True))
        asleep = tuple(n for n, a in actors.items() if a.asleep)
        stuck = tuple(n for n, a in actors.items() if a.kind != "end" and not a.asleep)
        killed = tuple(n for n, a in actors.items() if a.node.op.argument == "killed")
        cells = {place: s.memory.cells[cell] for place, cell in self._cells.items()}
        try:
            assert not stuck, f"stuck: {stuck}"
            self._check(Outcome({n: a.notes for n, a in actors.items()}, asleep, stuck, killed, cells))
        except AssertionError as error:
            raise Broken(self._story(s, f"at the end: {error}")) from None

    def _story(self, s: State, what: str) -> str:
        """The schedule that led here."""
        places = {cell: place for place, cell in self._cells.items()}
        lines = []
        came = self._came[s]
        while came is not None:
            s, (who, did, cells, value) = came
            where = " ".join(f"{places[c][0]}+{places[c][1]:#x}" for c in cells)
            if did:
                lines.append(f"  {self._names[who]}: {did} {where} {'' if value is None else value}".rstrip())
            came = self._came[s]
        return "\n".join([what, *reversed(lines)])


@contextlib.contextmanager
def _no_collection() -> Iterator[None]:
    """The collector would walk through all states again and again; there are no cycles among them."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


def _with(items: tuple[Any, ...], i: int, item: Any) -> tuple[Any, ...]:
    return (*items[:i], item, *items[i + 1 :])


def _paths(start: State, edges: dict[State, list[State]]) -> int:
    """How many ways lead from `start` to an end."""
    paths: dict[State, int] = {}
    begun: set[State] = set()
    pending = [start]
    while pending:
        state = pending[-1]
        if state in paths:
            pending.pop()
        elif state in begun:
            paths[pending.pop()] = sum(paths[new] for new in edges[state]) if edges[state] else 1
        else:
            begun.add(state)
            following = [new for new in edges[state] if new not in paths]
            if not begun.isdisjoint(following):
                raise Broken("a process goes round and round")
            pending += following
    return paths[start]
