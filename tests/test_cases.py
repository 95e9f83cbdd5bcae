"""Cases in one test: every one runs, and those that fail are named."""

from __future__ import annotations

import inspect

import pytest

from tests.cases import cases


def test_every_combination_runs_with_the_fixtures() -> None:
    seen = []

    @cases("a", (1, 2))
    @cases(("b", "c"), [(3, 4), (5, 6)])
    def numbers(a: int, b: int, c: int, world: str) -> None:
        seen.append((a, b, c, world))

    assert list(inspect.signature(numbers).parameters) == ["world"]
    numbers(world="w")
    assert seen == [(1, 3, 4, "w"), (1, 5, 6, "w"), (2, 3, 4, "w"), (2, 5, 6, "w")]


def test_all_that_fail_are_named() -> None:
    seen = []

    @cases("a, b", [(1, 1), (2, 3), (4, 4), (5, 6)])
    def equal(a: int, b: int) -> None:
        seen.append(a)
        assert a == b

    with pytest.raises(ExceptionGroup, match="2 of 4 cases") as caught:
        equal()
    assert seen == [1, 2, 4, 5]
    assert [error.__notes__ for error in caught.value.exceptions] == [
        ["in the case {'a': 2, 'b': 3}"], ["in the case {'a': 5, 'b': 6}"]]


def test_what_pytest_itself_raises_hides_no_other_case() -> None:
    seen = []

    @cases("a", range(4))
    def odd(a: int) -> None:
        seen.append(a)
        if a == 0:
            pytest.fail("told to")
        if a == 1:
            pytest.skip("told to")
        with pytest.raises(ZeroDivisionError):
            1 / (a - 2)

    with pytest.raises(BaseExceptionGroup, match="3 of 4 cases"):
        odd()
    assert seen == [0, 1, 2, 3]


def test_one_that_fails_is_its_own_error() -> None:
    with pytest.raises(ZeroDivisionError):
        cases("a", [1, 0])(lambda a: 1 / a)()


def test_a_property_without_cases_is_a_mistake() -> None:
    with pytest.raises(AssertionError, match="cannot fail"):
        cases("a", [])
