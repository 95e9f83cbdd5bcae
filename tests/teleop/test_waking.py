"""Who sleeps between its cycles is woken by a command."""

from __future__ import annotations

import pytest

from procs.lib.config import PROJECT_CONFIGS, load_system
from procs.supervisor.memory import create_all, remove_all
from shm.client import Client, LoopClient
from shm.pulse import Pulse
from tests.conftest import World


@pytest.mark.parametrize("kind", [Client, LoopClient])
@pytest.mark.parametrize(("name", "command"), [("MTMR_PSM1", "clutch"), ("console", "emulate_clutch")])
def test_a_command_wakes_who_sleeps(world: World, kind: type[Client], name: str, command: str) -> None:
    loaded = load_system(PROJECT_CONFIGS / "systems/kinematic-teleop.yaml", name=world.name)
    assert loaded.system is not None, loaded.errors
    create_all(loaded.system)
    try:
        page, client = Pulse(world.name, name, write=True), kind(world.name, name)
        page.field("nap")[...] = 1  # it sleeps
        assert client.send(command, (1.0,))
        assert page.get("nap") == 0
        client.close()
        page.close()
    finally:
        remove_all(world.name)
