"""A master on a PSM in lock-step: every record of the way is known in advance, at the slave's limits as well."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from tests.system.robot import ROOT, Robot, wait_for
from trocar.procs.kinematics.poses import inverse, matrix_from_pose
from trocar.shm.mailbox.client import Client
from trocar.shm.system import directory

pytestmark = [pytest.mark.slow, pytest.mark.simulated("hosted")]
NAME = "MTMR_PSM1"
IO_NS, MS = 1e9 / 1500, 1_000_000
ROUNDED_NS = 2_000  # periods are whole ns: two that make a third ms come apart by 1 ns every 2 ms
AT_1500_HZ = [word for part in ("io", "arm") for word in ("--set", f"{part}.period_s={1 / 1500}")]
INSERTION, DEEPEST = 2, 0.24


class FollowingPair:
    """The system, homed, its teleoperation following."""

    def __init__(self, robot: Robot, folder: Path, *options: str, cart: bool = False) -> None:
        """`cart`: setup joints carry the slave, and an ECM."""
        system = yaml.safe_load((ROOT / "configs/systems/kinematic-teleop.yaml").read_text())
        (row,) = system["consoles"][0]["teleop_PSMs"]
        row["configure_parameter"]["align_MTM"] = False  # turning it takes seconds
        if cart:
            carried = yaml.safe_load((ROOT / "configs/systems/kinematic-cart.yaml").read_text())["arms"]
            system["arms"] = [system["arms"][0], *carried[:3]]
            row["PSM_base_frame"] = {"component": "SUJ", "interface": "PSM1"}
        for arm in system["arms"]:
            arm["arm_file"] = f"{ROOT}/configs/{arm['arm_file']}"
        file = folder / "pair.yaml"
        file.write_text(yaml.safe_dump(system))
        robot.up(file, *options)
        robot.trocar("send", "system", "home", "--wait")
        self.teleop = directory.reader(robot.name, NAME, "state", "teleop")
        self.master, self.slave = (directory.reader(robot.name, name, "state", "arm") for name in ("MTMR", "PSM1"))
        self.hand, self.console = Client(robot.name, "MTMR"), Client(robot.name, "console")
        self.console.send("teleop_enable", (1,))
        self.console.send("emulate_operator_present", (1,))
        wait_for(self.follows, 60, "following")
        self.begin = self.shown(self.master, "measured_cp")

    def follows(self) -> bool:
        return bool(self.shown(self.teleop, "following") and np.isfinite(self.teleop.field("goal_cp")).all())

    def shown(self, ring: Any, name: str) -> Any:
        assert ring.newest()
        return ring.field(name).copy()

    def scale(self, scale: float) -> None:
        self.console.send("set_scale", (scale,))
        wait_for(lambda: self.shown(self.teleop, "scale") == scale, 60, "the scale")

    def lead(self, *by: float) -> Any:
        """Move the master by that much from where it began; the teleoperation's records of the way."""
        goal = self.begin.copy()
        goal[:3] += by
        stamp_ns = self.teleop.stamp_ns if self.teleop.newest() else 0
        number = self.hand.send("move_cp", goal)
        ended = []
        wait_for(lambda: ended.extend(r for r in self.hand.poll() if r.id == number and r.outcome == "done") or ended,
                 60, "the master's move")
        end_ns = self.teleop.stamp_ns if self.teleop.newest() else 0
        wait_for(lambda: self.teleop.newest() and self.teleop.stamp_ns > end_ns + 10 * MS, 60, "ten cycles more")
        return self.teleop.since(stamp_ns)

    def close(self) -> None:
        for part in (self.teleop, self.master, self.slave, self.hand, self.console):
            part.close()


@pytest.fixture
def pair(robot: Robot, tmp_path: Path) -> Iterator[FollowingPair]:
    made = FollowingPair(robot, tmp_path, *AT_1500_HZ)
    yield made
    made.close()


def test_every_cycle_follows_exactly_and_at_the_limits_without_a_jump(pair: FollowingPair) -> None:
    way = pair.lead(0.02, -0.01, 0.0)
    assert way["following"].all() and not way["reason"].astype(bool).any()
    assert set(np.diff(way["stamp_ns"])) == {MS}
    # the slave's goal: a fifth of what the master's record of that cycle says
    hands, goals = way["mtm_measured_cp"][:, :3], way["goal_cp"][:, :3]
    assert np.abs(goals - goals[0] - 0.2 * (hands - hands[0])).max() < 1e-12
    assert goals[-1] - goals[0] == pytest.approx((0.004, -0.002, 0.0), abs=1e-9)
    # its way through the stack takes the same time every time: one cycle of the arms from record to record
    ages = way["stamp_ns"] - way["master_stamp_ns"][:, 0]
    assert np.abs(ages[1:] + ages[:-1] - ages[1] - ages[0]).max() < ROUNDED_NS  # an old and a young one in turn
    assert abs(ages[1] - ages[0]) == pytest.approx(IO_NS / 2, abs=ROUNDED_NS)
    slave = pair.slave.since(int(way["stamp_ns"][0]))
    for row in way[:-3:7]:
        place = np.searchsorted(slave["stamp_ns"], row["stamp_ns"])
        assert slave["stamp_ns"][place] - row["master_stamp_ns"][0] == pytest.approx(IO_NS, abs=ROUNDED_NS)
        # the setpoint that the arm shows is the one that io has accepted, a cycle later
        assert slave["setpoint_cp"][place + 1][:3] == pytest.approx(row["goal_cp"][:3], abs=1e-8)

    pair.lead(0.0, 0.0, 0.0)
    pair.scale(1.0)
    down = np.array(pair.shown(pair.slave, "setpoint_cp")[:3])
    stamp_ns = pair.slave.stamp_ns
    way = pair.lead(0.0, 0.0, -0.18)  # as far for the slave, which has 12 cm
    assert way["following"].all() and way["reason"][-1].startswith(b"PSM1 at its limit: insertion would be 0.3")
    assert pair.shown(pair.slave, "setpoint_position")[INSERTION] == pytest.approx(DEEPEST)
    pair.lead(0.0, 0.0, 0.0)  # quicker than the slave may go
    wait_for(lambda: not pair.shown(pair.teleop, "reason").item(), 60, "the slave is back")
    assert pair.teleop.since(stamp_ns)["following"].all()
    assert pair.shown(pair.slave, "setpoint_cp")[:3] == pytest.approx(down, abs=1e-7)
    steps = np.abs(np.diff(pair.slave.since(stamp_ns)["setpoint_position"][:, :6], axis=0)).max(axis=0)
    goals = np.abs(np.diff(pair.teleop.since(stamp_ns)["goal_cp"][:, :3], axis=0)).max()
    assert steps[INSERTION] < 1.1 * goals and (np.delete(steps, INSERTION) < 20.0 * goals).all(), (steps, goals)


def test_a_slave_stays_where_it_is_in_the_room_of_its_base(robot: Robot, tmp_path: Path) -> None:
    pair = FollowingPair(robot, tmp_path, cart=True)
    cart = directory.reader(robot.name, "SUJ", "state", "suj")
    goal = matrix_from_pose(pair.shown(pair.teleop, "goal_cp"))
    first = matrix_from_pose(pair.shown(cart, "measured_cp")[1])
    joints = pair.shown(cart, "position")[1, :6]
    robot.trocar("send", "SUJ", "servo_jp", *map(str, joints + (0.004, 0, 0, 0, 0, 0)), "PSM1")  # the column rises

    def moved() -> Any:
        return matrix_from_pose(pair.shown(cart, "measured_cp")[1])

    wait_for(lambda: abs(np.linalg.norm(moved()[:3, 3] - first[:3, 3]) - 0.004) < 1e-9, 30, "the column's rise")
    wanted = inverse(moved()) @ first @ goal
    wait_for(lambda: np.abs(matrix_from_pose(pair.shown(pair.teleop, "goal_cp")) - wanted).max() < 1e-9, 30, "the goal")
    assert pair.follows()
    old = robot.kill("SUJ")
    wait_for(lambda: not pair.shown(pair.teleop, "following"), 30, "a base that nobody knows")
    wait_for(lambda: robot.pid("SUJ") != old and robot.state("SUJ") == "RUNNING", 60, "the setup joints' restart")
    assert pair.shown(pair.teleop, "state").item() == b"DISABLED"
    cart.close()
    pair.close()
