"""Processes that serve sockets: what they say of themselves in simulated time."""

from __future__ import annotations

import socket
from collections.abc import Iterator, Mapping
from typing import Any

import pytest

from tests.conftest import World
from trocar.procs.config import PROJECT_CONFIGS, load_system
from trocar.procs.node.node import Node
from trocar.procs.node.serving import ServingLoop
from trocar.procs.supervisor import memory
from trocar.shm.memory.parts import remove_all
from trocar.shm.system import directory
from trocar.shm.time.clock import monotonic_ns
from trocar.shm.time.lockstep import EPOCH_NS, Timekeeper


class Serving(ServingLoop):
    """Serves nothing."""

    async def listen(self, sockets: list[socket.socket]) -> None:
        pass

    async def disconnect(self) -> None:
        pass

    def shown(self, now_ns: int) -> Mapping[str, Any]:
        return {"browsers": 2}


@pytest.fixture
def node(world: World) -> Iterator[Node]:
    """A web console in a system whose simulated time stands at its beginning."""
    loaded = load_system(PROJECT_CONFIGS / "systems" / "kinematic.yaml", name=world.name,
                         sets=["clock=lockstep", "gui.listen=127.0.0.1:8080"])
    assert loaded.system is not None, loaded.errors
    memory.create_all(loaded.system)
    clock = Timekeeper(world.name, memory.simulated(loaded.system))
    made = Node(loaded.system, "gui")
    yield made
    made.close()
    clock.close()
    remove_all(world.name)


def test_who_goes_by_real_time_stamps_in_the_system_s(node: Node) -> None:
    loop = Serving(node)
    try:
        before_ns = monotonic_ns()
        assert node.now_ns <= before_ns, "it goes by real time"
        loop.setup()
        node.events.status("listens", "gui")
        for now_ns in (before_ns, before_ns + 2_000_000_000):
            node.now_ns = now_ns
            loop.update()
    finally:
        loop.quit()
    for ring, most in (("events", 0), ("state", 1)):
        reader = directory.reader(node.system, "gui", ring, "gui")
        assert reader.newest() and EPOCH_NS <= reader.stamp_ns <= EPOCH_NS + most, ring
        reader.close()
