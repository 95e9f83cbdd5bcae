"""Both halves of io's cycle, and every stage of boards, by native code and by numpy from the same memory: they must
leave the same, to the bit.

As a plug-in of pytest (`-p tests.native.shadow`) it does so for every cycle of all tests that are run.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import ClassVar

import numpy as np

from trocar.procs.io import cycle
from trocar.procs.io.halves import Halves
from trocar.procs.native import library
from trocar.procs.native.bound import BoundStruct
from trocar.procs.native.fields import CStruct
from trocar.procs.native.io_fields import IO
from trocar.procs.native.library import bind, chosen

LARGE = 10_000  # elements: tables of potentiometers, which nobody writes
SELDOM = 101  # calls from one look at all addresses to the next


class Compared:
    """Counts what was compared, so that nobody takes nothing for success."""

    calls = 0
    names: ClassVar[set[str]] = set()


def bits(array: np.ndarray) -> np.ndarray:
    """What is compared: zeros have a sign, but one that is not a number is as good as another."""
    if array.dtype.kind == "f":
        array = np.where(np.isnan(array), np.nan, array)
    return np.ascontiguousarray(array).view(np.uint8)


class StructMemory:
    """All arrays of a struct that its functions may write, copied as one piece: that is cheap in every cycle."""

    def __init__(self, bound: BoundStruct) -> None:
        self.bound = bound
        self.arrays = {key: array for key, array in bound.arrays.items()
                       if array.flags.writeable and 0 < array.size < LARGE}
        self.pieces = [array.reshape(-1).view(np.uint8) for array in self.arrays.values()]
        self.starts = np.cumsum([0, *(piece.size for piece in self.pieces[:-1])])

    def copy(self) -> np.ndarray:
        """The bytes of all arrays, one after the other."""
        return np.concatenate(self.pieces)

    def restore(self, was: np.ndarray, now: np.ndarray) -> None:
        """Write back the arrays that have changed from `was` to `now`."""
        for index in np.flatnonzero(np.bitwise_or.reduceat(was ^ now, self.starts)).tolist():
            piece, start = self.pieces[index], self.starts[index]
            piece[...] = was[start : start + piece.size]

    def compare(self, name: str, by_native: np.ndarray) -> None:
        """AssertionError names the first array that differs."""
        for start, (key, array) in zip(self.starts, self.arrays.items(), strict=True):
            made = by_native[start : start + array.nbytes].copy().view(array.dtype).reshape(array.shape)
            if not np.array_equal(bits(made), bits(array)):
                where = np.flatnonzero(bits(made) != bits(array))[0] // array.itemsize
                raise AssertionError(f"{name}: {key}[{where}] is {made.flat[where]!r} by native code, "
                                     f"{array.flat[where]!r} by numpy")


def both(name: str, memory: StructMemory, native_code: Callable[..., int], by_numpy: Callable[..., int], *given: float,
         exact: bool = False) -> int:
    """Call both with the same memory, and compare.

    `exact`: they return the same number, else the same truth.
    """
    before = memory.copy()
    found = native_code(*given)
    after = memory.copy()
    memory.restore(before, after)
    with np.errstate(all="ignore"):
        wanted = by_numpy(*given)
    agreed = found == wanted if exact else bool(found) == bool(wanted)
    assert agreed, f"{name}: {found} by native code, {wanted} by numpy"
    if not np.array_equal(after, memory.copy()):
        memory.compare(name, after)
    Compared.calls += 1
    Compared.names.add(name)
    if Compared.calls % SELDOM == 1:
        moved = memory.bound.moved()
        assert not moved, f"{name}: elsewhere now: {moved}"
    return wanted


class ShadowedHalves(Halves):
    """Halves that are done both ways."""

    def __init__(self, parts, *given) -> None:
        super().__init__(parts, *given, native=False)
        bound = bind(IO, parts)
        assert isinstance(bound, BoundStruct), f"no native library to compare with: {bound}"
        memory = StructMemory(bound)
        for name in IO.functions:
            setattr(self, name, partial(both, name, memory, bound.function(name), getattr(self, name),
                                        exact=name != "show"))


def chosen_both(table: CStruct, source: object, prefix: str = "") -> tuple[Callable[..., int], ...]:
    """Stages of boards that are done both ways; arms' kinematics (with a prefix) differ in their last bits."""
    if prefix:
        return chosen(table, source, prefix)
    bound = bind(table, source)
    assert isinstance(bound, BoundStruct), f"no native library to compare with: {bound}"
    memory = StructMemory(bound)
    return tuple(partial(both, name, memory, bound.function(name), getattr(source, name), exact=True)
                 for name in table.functions)


def pytest_configure() -> None:
    """From now on every io and all boards are compared."""
    cycle.Halves = ShadowedHalves
    library.chosen = chosen_both


def pytest_sessionfinish() -> None:
    """So that the caller knows that something was."""
    print(f"\ncompared {Compared.calls} stages: {' '.join(sorted(Compared.names))}")
