"""The supervisor clears what dead clients wanted, of every instance, several times a second."""

from __future__ import annotations

from tests.conftest import World
from trocar.procs.document.system import Process, SystemConfig
from trocar.procs.supervisor import memory
from trocar.procs.supervisor.memory import CLEAR_NS, Clearings
from trocar.shm.memory.parts import remove_all
from trocar.shm.system.subscriptions import Subscriber, Subscriptions
from trocar.shm.time.control_page import ControlPage


def test_what_the_dead_wanted_is_cleared_when_it_is_time(world: World) -> None:
    system = SystemConfig(world.name, "", "wall", (), (), None, (Process("PSM1", "teleop", 1 / 1500),))
    memory.create_all(system)
    clearings = Clearings(system)
    clearings.beat(1)
    pages = [ControlPage(world.name, name) for name in ("supervisor", "PSM1")]
    seen = [Subscriptions(page) for page in pages]
    for name in ("supervisor", "PSM1"):
        subscriber = Subscriber(world.name, name)
        subscriber.want("events")
        subscriber._page.close()  # as if killed
    clearings.beat(CLEAR_NS)
    assert all(one.look() and one.wanted for one in seen), "it is not time yet"
    clearings.beat(CLEAR_NS + 1)
    assert all(one.look() and not one.wanted for one in seen)
    for page in pages:
        page.close()
    remove_all(world.name)
