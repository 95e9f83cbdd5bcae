"""Arms of real sites that were homed, for all tests that begin with one."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import pytest

from tests.arm.on_boards import HomedOnBoards


@pytest.fixture(scope="session")
def homed_on_boards() -> Callable[[str, str], HomedOnBoards]:
    """By system file and name, each homed once."""
    return cache(HomedOnBoards.of_site)
