"""Arms brought to a state: every step that is asked of them belongs to one command of the person."""

from __future__ import annotations

import threading

import pytest

from tests.conftest import World
from tests.tools.robot import ScriptedRobot, nothing_ages, robot
from trocar.procs.tables.bring_up import HOMED
from trocar.shm.mailbox.origins import Origin
from trocar.shm.time.clock import pause
from trocar.tools.client.bring_up import bring, silent


def served(kinematic: ScriptedRobot, origins: list[Origin], over: threading.Event) -> None:
    """The arm does at once what it is asked for."""
    words: list[str] = []
    while not over.is_set():
        for command in kinematic.mailbox.drain():
            words.append(command.text)
            origins.append(command.origin)
            command.done()
            kinematic.show_arm(state="ENABLED", homed="home" in words)
        pause(0.001)


def test_power_and_homing_are_one_command(world: World, monkeypatch: pytest.MonkeyPatch) -> None:
    nothing_ages(monkeypatch)
    with robot(world.name) as kinematic:
        kinematic.show_arm()
        origins: list[Origin] = []
        over = threading.Event()
        arm = threading.Thread(target=served, args=(kinematic, origins, over))
        arm.start()
        try:
            assert bring(world.name, ["PSM1"], HOMED, 10.0, silent) == {"PSM1": ""}
        finally:
            over.set()
            arm.join()
    assert len(origins) == 2 and origins[0] == origins[1] and origins[0].id
