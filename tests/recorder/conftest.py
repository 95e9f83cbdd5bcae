"""A recorder's parts on rings of the test's own."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.conftest import World
from tests.recorder.harness import RingsOfATest


@pytest.fixture
def rings(world: World, tmp_path: Path) -> Iterator[RingsOfATest]:
    """See there."""
    made = RingsOfATest(world.name, tmp_path)
    yield made
    made.close()
    world.remove()
