"""Processes that serve sockets: what they say of themselves in simulated time."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import pytest

from tests.conftest import World
from trocar.procs.config import PROJECT_CONFIGS, load_system
from trocar.procs.node import runtime
from trocar.procs.node.serving import ServingLoop
from trocar.procs.supervisor import memory
from trocar.shm.system import directory
from trocar.shm.time.clock import monotonic_ns
from trocar.shm.time.lockstep import EPOCH_NS, Timekeeper


class Serving(ServingLoop):
    """Serves nothing."""

    def shown(self, now_ns: int) -> Mapping[str, Any]:
        return {"browsers": 2}

    def cycle(self, now_ns: int, wall_ns: int) -> None:
        self.show(now_ns)


@pytest.fixture
def node(world: World) -> Iterator[runtime.Node]:
    """A web console in a system whose simulated time stands at its beginning."""
    loaded = load_system(PROJECT_CONFIGS / "systems" / "kinematic.yaml", name=world.name,
                         sets=["clock=lockstep", "gui.listen=127.0.0.1:8080"])
    assert loaded.system is not None, loaded.errors
    memory.create_all(loaded.system)
    clock = Timekeeper(world.name, memory.simulated(loaded.system))
    made = runtime.Node(loaded.system, "gui")
    yield made
    made.close()
    clock.close()
    memory.remove_all(world.name)


def test_who_goes_by_real_time_stamps_in_the_system_s(node: runtime.Node) -> None:
    loop = Serving(node)
    try:
        before_ns = monotonic_ns()
        assert node.now_ns <= before_ns, "it goes by real time"
        node.events.status("listens", "gui")
        loop.cycle(before_ns, 0)
        loop.cycle(before_ns + 2_000_000_000, 0)
    finally:
        loop.close()
        loop.events.close()
    for ring, most in (("events", 0), ("state", 1)):
        reader = directory.reader(node.system, "gui", ring, "gui")
        assert reader.newest() and EPOCH_NS <= reader.stamp_ns <= EPOCH_NS + most, ring
        reader.close()
