"""Arms of real sites that were homed, for all tests that begin with one."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cache

import pytest

from tests.arm.on_boards import HomedOnBoards


@pytest.fixture(scope="session")
def homed_on_boards() -> Iterator[Callable[[str, str], HomedOnBoards]]:
    """By system file and name, each homed once; released at the end, because ruckig reports objects that outlive it."""
    kept = cache(HomedOnBoards.of_site)
    yield kept
    kept.cache_clear()
