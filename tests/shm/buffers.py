"""Memory and store buffers of the interleaving test: which store may reach the memory next, under which model.

"tso" (x86-64): stores in program order, only the words of one copy in any order. "streams": as tso, but a copy may
overtake the single stores before it, as very large copies do. "pso": stores to different words in any order. "weak": as
pso; loads are out of order there, too (tests/shm/interleave.py).
"""

from __future__ import annotations

from collections.abc import Iterator

from tests.shm.process import Address, Group

CELLS = 64  # of the memory
MODELS = ("tso", "streams", "pso", "weak")


class Memory:
    """What all see; one object for each content, compared by identity."""

    __slots__ = ("after", "cells", "locks")

    def __init__(self, cells: tuple[int, ...], locks: list[tuple[int, int]]) -> None:
        self.cells, self.locks = cells, locks  # (cell, owner) of those taken
        self.after: dict[tuple[int, int], Memory] = {}


class Buffer:
    """Stores on their way to the memory: groups of (cell, value); one object for each content."""

    __slots__ = ("drains", "groups", "mask", "own")

    def __init__(self, groups: tuple[Group, ...]) -> None:
        self.groups = groups
        self.own = {cell: value for group in groups for cell, value in group}  # what its process loads from it
        self.mask = sum(1 << cell for cell in self.own)
        self.drains: list[tuple[int, int, Buffer]] | None = None

    def __bool__(self) -> bool:
        return bool(self.groups)


class Storage:
    """All memories and buffers there have been, under one model."""

    def __init__(self, model: str, cells: dict[Address, int]) -> None:
        assert model in MODELS
        self._model, self._places = model, cells
        self._memories: dict[tuple[int, ...], Memory] = {}
        self._buffers: dict[tuple[Group, ...], Buffer] = {}

    def memory(self, cells: tuple[int, ...]) -> Memory:
        """The memory of that content."""
        found = self._memories.get(cells)
        if found is None:
            locks = [(c, cells[c]) for place, c in self._places.items() if place[0] == "lock" and cells[c]]
            found = self._memories[cells] = Memory(cells, locks)
        return found

    def stored(self, memory: Memory, cell: int, value: int) -> Memory:
        """The memory after a store."""
        after = memory.after.get((cell, value))
        if after is None:
            after = self.memory((*memory.cells[:cell], value, *memory.cells[cell + 1 :]))
            memory.after[cell, value] = after
        return after

    def buffer(self, groups: tuple[Group, ...]) -> Buffer:
        """The buffer of that content."""
        return self._buffers.get(groups) or self._buffers.setdefault(groups, Buffer(groups))

    def drains(self, buffer: Buffer) -> list[tuple[int, int, Buffer]]:
        """What may reach the memory next: (cell, value, what is left then)."""
        if buffer.drains is None:
            buffer.drains = list(self._drains(buffer.groups))
        return buffer.drains

    def lasting(self, buffer: Buffer) -> list[tuple[int, int, Buffer]]:
        """Those that stay possible whatever else drains; the last word of a copy does not overtake any more."""
        drains = self.drains(buffer)
        return drains[: len(buffer.groups[0])] if self._model == "streams" and drains else drains

    def _drains(self, groups: tuple[Group, ...]) -> Iterator[tuple[int, int, Buffer]]:
        seen: set[int] = set()
        for g, group in enumerate(groups):
            if g and len(group) == 1 and self._model == "streams":
                continue
            for k, (cell, value) in enumerate(group):
                if cell not in seen:
                    rest = group[:k] + group[k + 1 :]
                    yield cell, value, self.buffer(groups[:g] + ((rest,) if rest else ()) + groups[g + 1 :])
            if self._model == "tso" or (len(group) > 1 and self._model == "streams"):
                return
            seen.update(cell for cell, _ in group)
