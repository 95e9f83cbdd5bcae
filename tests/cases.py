"""A property of many cases in one test: each case costs a call, not a test, and all that fail are named."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import pytest


def cases(names: str | Sequence[str], rows: Iterable[Any]) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """As `pytest.mark.parametrize`, for tests whose fixtures no case changes: all rows in one test.

    Several of these on one test: every combination.
    """
    keys, table = names.replace(" ", "").split(",") if isinstance(names, str) else list(names), list(rows)
    assert table, "a property without cases cannot fail"

    def decorate(test: Callable[..., None]) -> Callable[..., None]:
        @functools.wraps(test)
        def all_cases(**fixtures: Any) -> None:
            failed = list[BaseException]()
            for row in table:
                case = dict(zip(keys, row if len(keys) > 1 else (row,), strict=True))
                try:
                    test(**case, **fixtures)
                except pytest.skip.Exception as error:
                    failed.append(AssertionError(f"a case cannot skip: {error}"))
                except (Exception, pytest.fail.Exception) as error:  # whatever it is, the other cases count too
                    failed.append(error)
                else:
                    continue
                failed[-1].add_note(f"in the case {case!r:.300}")
            if failed:
                several = BaseExceptionGroup(f"{len(failed)} of {len(table)} cases", failed)
                raise failed[0] if len(failed) == 1 else several

        own = inspect.signature(test)
        rest = [parameter for name, parameter in own.parameters.items() if name not in keys]
        assert len(rest) + len(keys) == len(own.parameters), f"{test.__name__} takes no {keys}"
        all_cases.__signature__ = own.replace(parameters=rest)  # type: ignore[attr-defined]  # pytest looks at it
        return all_cases

    return decorate
