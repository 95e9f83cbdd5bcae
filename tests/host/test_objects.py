"""Objects that are put back: every kind of them is as it was, and is the same object; what cannot be is named."""

from __future__ import annotations

import array
import ctypes
import itertools
import random
from collections import OrderedDict, deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import pytest

from tests.cases import cases
from trocar.procs.host.objects import RememberedObjects, UnknownTypeError


class Plain:
    """Attributes only."""

    def __init__(self, **given: Any) -> None:
        self.__dict__.update(given)


class Slotted:
    """Slots, one of them empty as yet; and a private one."""

    __slots__ = ("__own", "later", "value")

    def __init__(self, value: object) -> None:
        self.value, self.__own = value, [value]

    @property
    def own(self) -> list[object]:
        return self.__own


class Named(dict[str, int]):
    """A container with an attribute."""

    unit = ""


@dataclass(frozen=True)
class Frozen:
    """It never changes, what it holds does."""

    rows: list[int]


class OneNumber(ctypes.Structure):
    """As the kernel has."""

    _fields_ = [("x", ctypes.c_double)]


def counter() -> Callable[[], int]:
    """One that counts in a cell."""
    count = 0

    def step() -> int:
        nonlocal count
        count += 1
        return count

    return step


def changed(one: Any, change: Callable[[Any], object]) -> Any:
    """Remember, change, put back."""
    remembered = RememberedObjects({"it": one})
    change(one)
    remembered.put_back()
    return one


def test_attributes_are_as_they_were_also_those_that_came_and_went() -> None:
    inner = [1]
    one = Plain(kept=inner, gone=2)

    def change(one: Plain) -> None:
        one.kept, one.new = [9], 3  # type: ignore[attr-defined]
        inner.append(2)
        del one.gone  # type: ignore[attr-defined]

    changed(one, change)
    assert vars(one) == {"kept": [1], "gone": 2} and one.kept is inner  # type: ignore[attr-defined]


def test_an_object_without_attributes_has_none_again() -> None:
    assert not vars(changed(Plain(), lambda one: setattr(one, "new", 1)))


def test_slots_are_as_they_were_also_empty_and_private_ones() -> None:
    one = Slotted(1)

    def change(one: Slotted) -> None:
        one.value, one.later = 2, 3
        one.own.append(4)

    changed(one, change)
    assert one.value == 1 and one.own == [1] and not hasattr(one, "later")


@cases(("one", "change"), [
    ([1, 2], lambda one: one.append(3)), ({1, 2}, lambda one: one.discard(1)),
    (deque([1, 2], maxlen=2), lambda one: one.append(3)), (bytearray(b"ab"), lambda one: one.__setitem__(0, 9)),
    (array.array("d", [1.0]), lambda one: one.__setitem__(0, 9.0)), (np.arange(4.0), lambda one: one.fill(9.0)),
    (OrderedDict(a=1, b=2), lambda one: one.move_to_end("a")), (OneNumber(1.0), lambda one: setattr(one, "x", 2.0)),
])
def test_containers_and_memory_are_as_they_were(one: Any, change: Callable[[Any], object]) -> None:
    def shown() -> str:
        return repr(list(one.items()) if isinstance(one, dict) else one.x if isinstance(one, OneNumber) else one)

    before = shown()
    changed(one, change)
    assert shown() == before


def test_the_order_of_keys_is_as_it_was() -> None:
    one = {"a": 1, "b": 2}
    changed(one, lambda one: (one.pop("a"), one.update(a=1)))
    assert list(one) == ["a", "b"]


def test_a_container_that_has_attributes_keeps_both() -> None:
    one = Named(a=1)
    one.unit = "m"
    changed(one, lambda one: (one.update(b=2), setattr(one, "unit", "rad")))
    assert one == {"a": 1} and one.unit == "m"


def test_views_show_what_their_owner_says_whoever_wrote_it() -> None:
    memory = bytearray(16)
    views = [np.frombuffer(memory, dtype=np.float64), memoryview(memory)]
    owner = np.zeros((2, 3))
    rows = list(owner)

    def change(_: object) -> None:
        views[0][...] = 5.0
        rows[1][...] = 7.0

    changed([views, rows], change)
    assert not any(memory) and not owner.any()


def test_what_functions_and_frozen_values_hold_is_found() -> None:
    step, frozen, bound = counter(), Frozen([1]), partial([1].append, 5)
    step()
    changed((step, frozen, bound), lambda _: (step(), step(), frozen.rows.append(2), bound()))
    assert step() == 2 and frozen.rows == [1] and bound.func.__self__ == [1]  # type: ignore[attr-defined]


def test_chance_begins_where_it_was() -> None:
    numbers, chance = np.random.default_rng(1), random.Random(1)
    draw = chance.random  # as somebody has it who does not know the generator
    remembered = RememberedObjects({"numbers": numbers, "draw": draw})
    first = numbers.normal(size=3).tobytes(), draw(), chance.gauss(0.0, 1.0)
    remembered.put_back()
    assert first == (numbers.normal(size=3).tobytes(), draw(), chance.gauss(0.0, 1.0))


def test_circles_end() -> None:
    one = Plain(name="one")
    one.itself = [one]  # type: ignore[attr-defined]
    changed(one, lambda one: setattr(one, "name", "other"))
    assert one.name == "one"  # type: ignore[attr-defined]


def made() -> Iterator[int]:
    """A generator."""
    yield 1


@pytest.mark.parametrize(("one", "kind"), [
    (itertools.count(), "itertools.count"), (made(), "builtins.generator"), (iter([1]), "builtins.list_iterator"),
    (ValueError("x"), "builtins.ValueError")], ids=lambda one: one if isinstance(one, str) else type(one).__name__)
def test_what_cannot_be_put_back_is_named_with_the_way_to_it(one: object, kind: str) -> None:
    root = {"held": Plain(by=[0, one])}
    with pytest.raises(UnknownTypeError, match=rf"^root\['held'\]\.by\[1\] is a {kind}, and no rule"):
        RememberedObjects({"root": root})
