"""Every stage of io and boards by native code and by numpy, from the same memory: they must leave the same, to the bit.

As a plug-in of pytest (`-p tests.native.shadow`) it does so for every cycle of all tests that are run.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from functools import partial
from typing import ClassVar

import numpy as np

from trocar.procs.io import cycle
from trocar.procs.io.cycle import RobotIo
from trocar.procs.io.stages import Stages, native_stages, numpy_stages
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


def both(name: str, bound: BoundStruct, native_code: Callable[..., int], by_numpy: Callable[..., int], *given: float,
         exact: bool = False) -> int:
    """Call both with the same memory; AssertionError names the first array in which they differ.

    `exact`: they return the same number, else the same truth.
    """
    arrays = [(key, array) for key, array in bound.arrays.items() if array.flags.writeable and array.size < LARGE]
    before = [array.copy() for _, array in arrays]
    found = native_code(*given)
    after = [array.copy() for _, array in arrays]
    for (_, array), was in zip(arrays, before, strict=True):
        array[...] = was
    with np.errstate(all="ignore"):
        wanted = by_numpy(*given)
    agreed = found == wanted if exact else bool(found) == bool(wanted)
    assert agreed, f"{name}: {found} by native code, {wanted} by numpy"
    for (key, array), made in zip(arrays, after, strict=True):
        if made.tobytes() != array.tobytes() and not np.array_equal(bits(made), bits(array)):
            where = np.flatnonzero(bits(made) != bits(array))[0] // array.itemsize
            raise AssertionError(f"{name}: {key}[{where}] is {made.flat[where]!r} by native code, "
                                 f"{array.flat[where]!r} by numpy")
    Compared.calls += 1
    Compared.names.add(name)
    if Compared.calls % SELDOM == 1:
        assert not bound.moved(), f"{name}: elsewhere now: {bound.moved()}"
    return wanted


def shadowed(parts: RobotIo) -> Stages:
    """Stages that are done both ways."""
    bound = bind(IO, parts)
    assert isinstance(bound, BoundStruct), f"no native library to compare with: {bound}"
    native_code, by_numpy = native_stages(bound, "not here", parts), numpy_stages(parts, "")
    return dataclasses.replace(native_code, **{
        name: partial(both, name, bound, getattr(native_code, name), getattr(by_numpy, name), exact=name == "at_once")
        for name in IO.functions}, bound=None)


def chosen_both(table: CStruct, source: object, prefix: str = "") -> tuple[Callable[..., int], ...]:
    """Stages of boards that are done both ways; arms' kinematics (with a prefix) differ in their last bits."""
    if prefix:
        return chosen(table, source, prefix)
    bound = bind(table, source)
    assert isinstance(bound, BoundStruct), f"no native library to compare with: {bound}"
    return tuple(partial(both, name, bound, bound.function(name), getattr(source, name), exact=True)
                 for name in table.functions)


def pytest_configure() -> None:
    """From now on every io and all boards are compared."""
    cycle.stages = shadowed
    library.chosen = chosen_both


def pytest_sessionfinish() -> None:
    """So that the caller knows that something was."""
    print(f"\ncompared {Compared.calls} stages: {' '.join(sorted(Compared.names))}")
