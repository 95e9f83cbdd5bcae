"""What several tests of shared memory begin with."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

from trocar.shm.memory.layout import schema_of
from trocar.shm.memory.segment import create, segment_name, unlink
from trocar.shm.topics import SETPOINT


@pytest.fixture
def ring(world: Any) -> Iterator[str]:
    """Name of a fresh segment: setpoints, 8 deep."""
    name = segment_name(world.name, "PSM1", "setpoint")
    create(name, "ring", schema_of(SETPOINT), 8, {"kind": "arm"})
    yield name
    unlink(name)
