"""A master on a PSM as a whole system: it follows, and what happens when one of its processes is killed."""

from __future__ import annotations

import numpy as np
import pytest

from tests.system.robot import ROOT, Robot, wait_for
from trocar.shm.mailbox.client import Client
from trocar.shm.ring.ring import RingReader
from trocar.shm.system import directory

pytestmark = [pytest.mark.slow, pytest.mark.simulated]
TELEOP = ROOT / "configs/systems/kinematic-teleop.yaml"
NAME = "MTMR_PSM1"


def says(ring: RingReader, name: str) -> str:
    assert ring.newest()
    return bytes(ring.field(name).item()).decode()


def test_a_slave_follows_and_deaths_end_that_without_a_jump(robot: Robot) -> None:
    robot.up(TELEOP)
    robot.trocar("send", "system", "home", "--wait")
    teleop = directory.reader(robot.name, NAME, "state", "teleop")
    slave = directory.reader(robot.name, "PSM1", "state", "arm")
    seen = directory.reader(robot.name, "console", "state", "console")
    master, console = Client(robot.name, "MTMR"), Client(robot.name, "console")

    def following(wanted: bool, seconds: float = 60.0) -> None:
        wait_for(lambda: teleop.newest() and bool(teleop.field("following")) is wanted, seconds,
                 f"following is {wanted}; {says(teleop, 'state')}, {says(teleop, 'reason')}")

    def place() -> np.ndarray:
        assert slave.newest()
        return slave.field("setpoint_cp").copy()

    def show_presence() -> None:
        console.send("emulate_operator_present", (0,))
        wait_for(lambda: seen.newest() and not seen.field("operator_present"), 60, "the operator is seen to have gone")
        console.send("emulate_operator_present", (1,))
        following(True)

    console.send("teleop_enable", (1,))
    wait_for(lambda: says(teleop, "state") == "ALIGNING_MTM", 60, "alignment without an operator")
    console.send("emulate_operator_present", (1,))
    following(True)
    before = place()
    assert teleop.newest()
    goal = teleop.field("mtm_measured_cp").copy()
    goal[0] += 0.02
    master.send("move_cp", goal)
    wait_for(lambda: abs(place()[0] - before[0] - 0.004) < 1e-5, 60, "a fifth of the master's way")

    for victim in (NAME, "MTMR", "console"):
        before = place()
        old = robot.kill(victim)
        wait_for(lambda victim=victim, old=old: robot.pid(victim) != old and robot.state(victim) == "RUNNING", 60,  # type: ignore[misc]
                 f"{victim}'s restart")
        if victim == "console":  # it finds nobody there
            following(False)
            console.close()
            console = Client(robot.name, "console")
        show_presence()
        assert np.abs(place() - before).max() < 1e-4, f"jumped when {victim} came back"
    for part in (teleop, slave, seen, master, console):
        part.close()
    assert robot.down() == 0
