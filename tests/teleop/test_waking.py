"""Who sleeps between its cycles is woken by a command."""

from __future__ import annotations

import threading
from collections.abc import Iterator

import pytest

from tests.conftest import World
from trocar.procs.config import PROJECT_CONFIGS, load_system
from trocar.procs.node.life import document_of
from trocar.procs.node.node import Node
from trocar.procs.supervisor.memory import create_all
from trocar.procs.teleop.loop import TeleopLoop
from trocar.shm.mailbox.client import Client, LoopClient
from trocar.shm.memory.parts import remove_all
from trocar.shm.time.clock import monotonic_ns, pause
from trocar.shm.time.control_page import ControlPage

PERIOD_NS = 6_000_000_000


@pytest.fixture
def system(world: World) -> Iterator[str]:
    """The memory of a system with a teleoperation, MTMR_PSM1, and a console."""
    loaded = load_system(PROJECT_CONFIGS / "systems/kinematic-teleop.yaml", name=world.name, sets=["clock=wall"])
    assert loaded.system is not None, loaded.errors
    create_all(loaded.system)
    yield world.name
    remove_all(world.name)


@pytest.mark.parametrize("kind", [Client, LoopClient])
@pytest.mark.parametrize(("name", "command"), [("MTMR_PSM1", "clutch"), ("console", "emulate_clutch"),
                                               ("PSM1", "hold"), ("system", "beep")])
def test_a_command_wakes_who_sleeps(system: str, kind: type[Client], name: str, command: str) -> None:
    page, client = ControlPage(system, name, write=True), kind(system, name)
    page.field("wakeup")[...] = 1  # it sleeps
    assert client.send(command, (1.0,))
    assert page.get("wakeup") == 0
    client.close()
    page.close()


@pytest.mark.slow
def test_a_tele_operation_at_rest_begins_a_cycle_when_it_is_asked(system: str) -> None:
    node = Node(document_of(system), "MTMR_PSM1")
    loop, client = TeleopLoop(node), Client(system, "MTMR_PSM1")
    node.pacing.period_ns = PERIOD_NS
    loop.begin()

    def ask() -> None:
        while not node.page.get("wakeup"):
            pause(0.001)
        client.send("clutch", (1.0,))

    asking, begun_ns = threading.Thread(target=ask), monotonic_ns()
    asking.start()
    loop.tick()
    asking.join()
    assert monotonic_ns() - begun_ns < loop.rest_periods * PERIOD_NS, "it slept on"
    loop.update()
    assert client.poll(), "it was not answered"
    client.close()
    loop.quit()
    node.give_back()
    node.close()
