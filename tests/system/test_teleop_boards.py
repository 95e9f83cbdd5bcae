"""The teleoperation of a real site on emulated boards: pedals, gripper and hand are those of the emulation."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.system.robot import Robot, wait_for
from tests.system.robot_in_host import HOSTED
from trocar.shm.system import directory
from trocar.tools.client.remote import Remote
from trocar.tools.examples.operator_sim import OperatorSim, SeenRecord

pytestmark = [pytest.mark.slow, pytest.mark.simulated(HOSTED)]
PINCH = 0.75  # rad, more than the 40° that the file asks for
NAME = "MTML_PSM1"
STILL_M = 1e-4
Array = np.ndarray[Any, np.dtype[np.float64]]


class Surgeon:
    """Pedals, gripper and hand at the master; what arms and the teleoperation show."""

    def __init__(self, robot: Robot) -> None:
        self.robot, name = robot, robot.name
        self.boards = Remote(name, "boards")
        self.master, self.slave = SeenRecord(name, "MTML", "arm"), SeenRecord(name, "PSM1", "arm")
        self.seat = OperatorSim(name, "console1")
        self.teleop = self.seat.teleops[0]
        self._is_open = True
        self.gripper = float(self.master.value("gripper_position"))

    def press(self, pedal: str, on: bool) -> None:
        self.boards.ask("press", (float(on),), pedal)

    def pinch(self) -> None:
        self._is_open = not self._is_open
        self.boards.ask("set_position", (self.gripper - (0.0 if self._is_open else PINCH),), "MTML_gripper")

    def pull(self, far_m: float, *by: float) -> None:
        """The hand at the tip goes there, from where the tip is; wait until the master has come so far."""
        begin = self.away()
        pose = np.array(self.master.value("local_measured_cp"))
        pose[:3] += by
        self.boards.ask("pull_tip", pose, "MTML")
        wait_for(lambda: np.linalg.norm(self.away() - begin) > far_m, 60, f"the master {far_m} m further")

    def let_go(self) -> None:
        self.boards.ask("release_tip", text="MTML")

    def place(self) -> Array:
        """Of the slave's setpoint."""
        return np.array(self.slave.value("setpoint_cp")[:3])

    def away(self) -> Array:
        return np.array(self.master.value("measured_cp")[:3])

    def waits_for(self, what: str) -> None:
        wait_for(lambda: what in self.teleop.value("reason"), 60, f"{what!r}")
        assert not self.teleop.is_following

    def follows(self) -> None:
        wait_for(lambda: self.teleop.is_following, 60, f"following; {self.teleop.reported}")

    def close(self) -> None:
        for part in (self.seat, self.boards):
            part.__exit__()
        for part in (self.master, self.slave):
            part.ring.close()


@pytest.fixture
def operator(robot: Robot, data: Callable[[str], Path]) -> Iterator[Surgeon]:
    robot.up(data("dvrk-site/jhu-dVRK/system-MTML-PSM1-Teleop.json"), "--boards", "emulated", "--path",
             str(data("dvrk-share")), "--set", f"processes.{NAME}.period_s=0.002")
    with Remote(robot.name, "boards") as boards, Remote(robot.name, "PSM1") as slave:
        boards.ask("insert_instrument", text="PSM1 LARGE_NEEDLE_DRIVER:400006")
        wait_for(lambda: slave.answered("set_tool_type", (), "LARGE_NEEDLE_DRIVER:400006").outcome == "done", 60,
                 "an instrument")
    with Remote(robot.name, "system") as system:
        assert system.settled("home", timeout=120.0).outcome == "done"
    made = Surgeon(robot)
    yield made
    made.close()


def followed(operator: Surgeon) -> tuple[Array, Array]:
    """Places of the master and of the slave's goal in every cycle of the last second that was followed in."""
    ring = directory.reader(operator.robot.name, NAME, "state", "teleop")
    rows = ring.last(1000)
    ring.close()
    rows = rows[rows["following"] & (rows["sent_ns"] == rows["stamp_ns"])]
    return rows["mtm_measured_cp"][:, :3], rows["goal_cp"][:, :3]


def test_a_slave_that_slides_along_a_wall_still_follows(operator: Surgeon) -> None:
    operator.seat.ask("teleop_enable", 1)
    operator.press("coag", True)
    operator.waits_for("waiting: pinch or twist MTML's gripper a bit")
    operator.pinch()
    operator.follows()
    centre, radius = np.array(operator.slave.value("local_setpoint_cp")[:3]), 0.004

    def away() -> float:
        return float(np.linalg.norm(np.array(operator.slave.value("local_setpoint_cp")[:3]) - centre))

    with Remote(operator.robot.name, "PSM1") as slave:
        slave.ask("add_wall", (*centre, 0.0, 0.0, 0.0, 1.0, radius), "ball sphere in tip")
    operator.pull(0.04, 0.05, 0.03, 0.0)
    wait_for(lambda: away() > 0.9 * radius, 60, "the slave at the wall")
    wait_for(lambda: operator.teleop.value("reason") == "PSM1 is at wall ball", 60, "the reason")
    for _ in range(20):
        operator.robot.passes(0.02)
        assert away() <= radius + 1e-6 and operator.teleop.is_following
    operator.pull(0.03, -0.05, -0.03, 0.0)
    wait_for(lambda: away() < 0.7 * radius, 60, "the slave to come back with the hand")
    wait_for(lambda: operator.teleop.value("reason") == "", 60, "no reason")
    assert operator.teleop.is_following
    operator.let_go()


def test_the_slave_follows_a_hand_and_deaths_end_that(operator: Surgeon) -> None:
    robot = operator.robot
    operator.seat.ask("teleop_enable", 1)
    operator.press("coag", True)
    operator.waits_for("waiting: pinch or twist MTML's gripper a bit")  # though it was turned by half a turn meanwhile
    operator.pinch()
    operator.follows()

    for sign in (1, -1, 1, -1, 1):  # where we are held up meanwhile, what is kept begins when it is there
        operator.pull(0.04, sign * 0.05, sign * 0.03, 0.0)
        masters, goals = followed(operator)
        assert np.abs((goals - goals[0]) - 0.2 * (masters - masters[0])).max() < 1e-6
        if np.linalg.norm(goals[-1] - goals[0]) > 0.004:
            break
    else:
        pytest.fail("the slave does not go a fifth of the master's way")
    wait_for(lambda: np.linalg.norm(np.array(operator.slave.value("measured_cp")[:3]) - operator.place()) < 1e-3, 60,
             "the slave at its setpoint")

    operator.press("clutch", True)
    wait_for(lambda: not operator.teleop.is_following, 60, "the clutch")
    before = operator.place()
    operator.pull(0.05, -0.05, -0.05, 0.0)
    operator.let_go()
    assert np.abs(operator.place() - before).max() < STILL_M
    operator.press("clutch", False)
    operator.follows()  # nobody has to pinch again
    assert np.abs(operator.place() - before).max() < STILL_M

    operator.press("coag", False)
    wait_for(lambda: not operator.teleop.is_following, 60, "the pedal let go of")
    for victim, reason in ((NAME, "align only"), ("console1", "align only"), ("MTML", "pinch or twist")):
        operator.press("coag", False)
        wait_for(lambda: operator.seat.console.value("present_inputs") == 0, 60, "nobody there")
        operator.press("coag", True)
        operator.waits_for("pinch or twist")
        operator.pinch()
        operator.follows()
        operator.pull(0.01, 0.0, 0.04, 0.02)
        old = robot.kill(victim)
        wait_for(lambda: not operator.teleop.is_following or robot.pid(victim) != old, 60, "the end of following")  # noqa: B023
        before = operator.place()
        operator.let_go()  # a hand that holds on shows presence by the roll
        wait_for(lambda victim=victim, old=old: robot.pid(victim) != old and robot.state(victim) == "RUNNING", 60,  # type: ignore[misc]
                 f"{victim}'s restart")
        operator.waits_for(reason)
        assert np.linalg.norm(operator.place() - before) < 1e-3, f"the slave went on when {victim} had died"
