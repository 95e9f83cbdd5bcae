"""Which steps need not be tried in every order: those on words that no other process will touch (persistent sets).

A step may be the only one tried in a state if nothing that the other processes can do without it, now or later, loads
what it stores, or stores what it touches: whatever they do, the step stays possible and leads to the same state. So
every end of every schedule is still reached, every failure, and a schedule without an end if there is one.

What a process may still touch is what the known part of its tree of answers touches, up to its next `quiet`, which
comes when no process can do anything else. The unknown part is guessed from nodes with the same operation. If a process
may touch more than was assumed (`learn`, at the end of a search), the search continues in the states in which steps
were left out.
"""

from __future__ import annotations

from tests.shm.buffers import CELLS, Buffer
from tests.shm.process import FakeNode, Local, Op

Touched = tuple[int, int]  # bits of the cells loaded, and of those stored
NOTHING: Touched = 0, 0


def touched(op: Op) -> Touched:
    """What an operation touches; the list of those who sleep at a cell is a cell, too."""
    bits = sum(1 << cell for cell in op.cells)
    if op.kind in ("sleep", "wake"):
        return bits, bits << CELLS
    return (bits, 0) if op.kind == "load" else (0, bits)


class Reduction:
    """What each process may still touch."""

    def __init__(self, names: list[str]) -> None:
        self._names = names
        self._nodes: list[list[FakeNode]] = [[] for _ in names]
        self._guesses: list[dict[Op, Touched]] = [{} for _ in names]
        self._locks = [0] * len(names)  # that a process takes; it may give them back at any time, by dying

    def add(self, i: int, node: FakeNode) -> None:
        """A node of process `i` has been found."""
        node.ahead = self._guesses[i].get(node.op, NOTHING)
        self._nodes[i].append(node)

    def learn(self) -> bool:
        """Whether a process may touch more than was assumed; from now on that is assumed."""
        grown = [self._learn(i, nodes) for i, nodes in enumerate(self._nodes)]
        return any(grown)

    def _learn(self, i: int, nodes: list[FakeNode]) -> bool:
        ahead: dict[FakeNode, Touched] = {}
        for node in nodes:
            loads, stores = touched(node.op)
            ahead[node] = loads, stores | sum({1 << cell for group in node.groups for cell, _ in group})
            if node.op.kind in ("lock", "claim"):
                self._locks[i] |= stores
        changed = True
        while changed:
            changed = False
            for node in reversed(nodes):
                if node.op.kind != "quiet":
                    loads, stores = ahead[node]
                    for child in node.children.values():
                        loads, stores = loads | ahead[child][0], stores | ahead[child][1]
                    changed = changed or ahead[node] != (loads, stores)
                    ahead[node] = loads, stores
        grown = False
        guesses = self._guesses[i] = {}
        for node, (loads, stores) in ahead.items():
            grown = grown or bool(loads & ~node.ahead[0] or stores & ~node.ahead[1])
            node.ahead = loads, stores
            known = guesses.get(node.op, NOTHING)
            guesses[node.op] = known[0] | loads, known[1] | stores
        return grown

    def free(self, i: int, step: Touched, actors: tuple[Local, ...], buffers: tuple[Buffer, ...]) -> bool:
        """Whether nothing that another process may still do matters to a step of process `i`."""
        loads, stores = step
        both = loads | stores
        for j, local in enumerate(actors):
            if j != i:
                after = local.kind == "after" and local.node.op.argument == self._names[i]  # it does nothing before
                theirs = NOTHING if after else local.node.ahead
                if stores & theirs[0] or both & (theirs[1] | buffers[j].mask | self._locks[j]):
                    return False
        return True
