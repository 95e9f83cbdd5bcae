"""Two systems over ROS: a master and a slave of the first one are arms of the second, in both directions.

The first has MTMR and PSM1 on its ROS bridge. In the second MTMR (from ROS) moves PSM2, and MTML moves PSM1 (from ROS).
"""

from __future__ import annotations

import contextlib
import os
import signal
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

import trocar
from tests.system.robot import AT_250_HZ, ROOT, Robot, wait_for
from tests.system.test_ros_bridge import own_domain
from trocar.shm.ring.ring import RingReader
from trocar.shm.system import directory
from trocar.shm.time.control_page import ControlPage

pytestmark = [pytest.mark.slow, pytest.mark.soak]  # on two cores their processes stall, which ends following
TRIES = 10  # where a busy machine makes the bridge silent, which ends following
PATIENT = (*AT_250_HZ, "--set", "supervisor_lost_s=60")  # processes with priority leave time to others
WATCHED_NS = 1_500_000_000


def system_file(folder: Path, name: str, arms: list[dict[str, Any]], **keys: Any) -> Path:
    file = folder / f"{name}.yaml"
    file.write_text(yaml.safe_dump({"$id": "dvrk-system.schema.json", "$version": "1", "arms": arms, **keys}))
    return file


def kinematic(name: str, kind: str, file: str) -> dict[str, Any]:
    return {"name": name, "type": kind, "simulation": "KINEMATIC", "arm_file": f"{ROOT}/configs/arms/{file}-demo.yaml"}


@dataclass
class Teleop:
    """A teleoperation of the second system, with the system of its master and the system and name of its slave."""

    name: str
    master: tuple[Robot, str]
    slave: tuple[Robot, str]
    state: RingReader
    goal: RingReader

    def follows(self) -> bool:
        return bool(self.state.newest() and self.state.field("following"))

    def is_disabled(self) -> bool:
        """Whether it needs an operator's command; after a silence of less than 0.1 s, it does not."""
        return bool(self.state.newest() and self.state.field("state").item() == b"DISABLED")

    def place(self) -> np.ndarray:
        assert self.goal.newest()
        return np.array(self.goal.field("setpoint_cp")[:3])

    def reason(self) -> str:
        return bytes(self.state.field("reason").item()).decode()


def hurry(pid: int) -> None:
    """Before other tests, where that is allowed: a busy machine stalls processes without priority for 30 ms."""
    with contextlib.suppress(OSError):
        for thread in Path(f"/proc/{pid}/task").iterdir():
            os.sched_setscheduler(int(thread.name), os.SCHED_FIFO, os.sched_param(10))


class TwoSystems:
    """`local` has the console, `distant` the arms on ROS."""

    def __init__(self, distant: Robot, local: Robot, folder: Path) -> None:
        self.distant, self.local, domain = distant, local, own_domain()
        ros = {"from": "ros", "domain": domain}
        alone = {"MTM_is_haptic": False, "align_MTM": False, "start_gripper_threshold": 0.0}
        teleops = [{"MTM": mtm, "PSM": psm, "period": 0.005, "configure_parameter": alone}
                   for mtm, psm in (("MTMR", "PSM2"), ("MTML", "PSM1"))]
        self.files = (
            system_file(folder, "distant", [kinematic("MTMR", "MTM", "MTMR"), kinematic("PSM1", "PSM", "PSM1")],
                        trocar={"ros": {"domain": domain}}),
            system_file(folder, "local", [
                {"name": "MTMR", "type": "MTM_GENERIC", "component": ros},
                {"name": "PSM1", "type": "PSM_GENERIC", "component": ros},
                kinematic("MTML", "MTM", "MTML"), kinematic("PSM2", "PSM", "PSM1")],
                        consoles=[{"name": "console", "input_type": "SIMULATED", "teleop_PSMs": teleops}]))
        self.teleops: list[Teleop] = []

    def up(self) -> None:
        self.local.up(self.files[1], *PATIENT)
        wait_for(lambda: "no program publishes it" in self.problem("PSM1"), 60, "the absent arm to be named")
        self.distant.up(self.files[0], *PATIENT)
        for name, master, slave in (("MTMR_PSM2", (self.distant, "MTMR"), (self.local, "PSM2")),
                                    ("MTML_PSM1", (self.local, "MTML"), (self.distant, "PSM1"))):
            state = directory.reader(self.local.name, name, "state", "teleop")
            goal = directory.reader(slave[0].name, slave[1], "state", "arm")
            self.teleops.append(Teleop(name, master, slave, state, goal))

    def problem(self, name: str) -> str:
        page = ControlPage(self.local.name, name)
        text = bytes(page.field("error")[()]).rstrip(b"\0").decode()
        page.close()
        return text

    def are_there(self) -> bool:
        """Whether both arms from ROS have fresh records, and are ready."""
        return all(not self.problem(name) and self._record(name) == b"ENABLED" for name in ("MTMR", "PSM1"))

    def _record(self, name: str) -> bytes:
        reader = directory.reader(self.local.name, name, "state", "third_party")
        state = bytes(reader.field("state").item()) if reader.newest() else b""
        reader.close()
        return state

    def move_masters(self) -> None:
        """Each by some millimetres, to and fro."""
        for teleop in self.teleops:
            robot, name = teleop.master
            with contextlib.suppress(Exception), contextlib.closing(trocar.arm(name, robot.name)) as arm:
                joints = arm.setpoint_jp()[0].copy()
                joints[0] += 0.1 if joints[0] < 0.0 else -0.1
                arm.move_jp(joints).wait(timeout=20)

    def enable(self) -> None:
        """An operator's command; it also powers and homes the arms on ROS."""
        self.local.insist("send", "console", "teleop_enable", "0")
        wait_for(self.any_there, 60, "arms from ROS")
        for robot, name in ((self.distant, "ros_bridge"), (self.local, "MTMR"), (self.local, "PSM1")):
            hurry(robot.pid(name))
        self.local.insist("send", "console", "emulate_operator_present", "1", "stay")
        self.local.insist("send", "console", "teleop_enable", "1")

    def any_there(self) -> bool:
        return not self.problem("MTMR") and not self.problem("PSM1")

    def follow(self) -> None:
        """Both slaves follow their masters, after an operator's command."""
        moved: dict[str, float] = {}
        for _ in range(TRIES):
            self.enable()
            with contextlib.suppress(pytest.fail.Exception):
                wait_for(lambda: all(each.follows() for each in self.teleops), 30, "following")
                before = [each.place() for each in self.teleops]
                self.move_masters()
                for each, place in zip(self.teleops, before, strict=True):
                    moved[each.name] = max(moved.get(each.name, 0.0), float(np.abs(each.place() - place).max()))
            if len(moved) == 2 and min(moved.values()) > 0.001:
                return
        pytest.fail(f"{moved}: " + "; ".join(f"{each.name}: {each.reason()}" for each in self.teleops))

    def ends(self) -> None:
        """Following ends, until an operator enables it again."""
        wait_for(lambda: all(each.is_disabled() for each in self.teleops), 10, "the end of following")

    def stays_ended(self) -> None:
        """Following has ended, the slaves hold, and nothing follows again although the arms are back."""
        self.ends()
        wait_for(self.are_there, 120, "the arms again")
        places = [each.place() for each in self.teleops]
        assert all(each.is_disabled() for each in self.teleops)
        begin = self.teleops[0].state.stamp_ns
        self.move_masters()
        wait_for(lambda: self.teleops[0].state.newest() and self.teleops[0].state.stamp_ns > begin + WATCHED_NS, 60,
                 "time to pass")
        for each, place in zip(self.teleops, places, strict=True):
            assert not any(row["following"] for row in each.state.since(begin)), each.name
            assert np.abs(each.place() - place).max() < 1e-6, each.name

    def close(self) -> None:
        for each in self.teleops:
            each.state.close()
            each.goal.close()


@pytest.fixture
def two(robots: Callable[[], Robot], tmp_path: Path) -> Iterator[TwoSystems]:
    made = TwoSystems(robots(), robots(), tmp_path)
    made.up()
    yield made
    made.close()


def test_arms_of_another_system_follow_and_are_followed_until_they_are_silent(two: TwoSystems) -> None:
    distant, local = two.distant, two.local
    distant.home()
    local.home("MTML", "PSM2")
    two.follow()

    distant.kill("ros_bridge")
    two.stays_ended()

    two.follow()
    os.kill(stopped := distant.pid("ros_bridge"), signal.SIGSTOP)
    two.ends()
    os.kill(stopped, signal.SIGCONT)
    two.stays_ended()

    two.follow()
    for arm in ("MTMR", "PSM1"):
        os.kill(distant.pid(arm), signal.SIGSTOP)  # the supervisor kills them after a second
    two.ends()
    two.stays_ended()
    assert local.down() == 0 and distant.down() == 0


def test_an_arm_of_the_other_system_that_crashes_is_not_followed_again(two: TwoSystems) -> None:
    two.distant.home()
    two.local.home("MTML", "PSM2")
    two.follow()
    for arm in ("MTMR", "PSM1"):
        two.distant.pids.add(two.distant.pid(arm))
        two.distant.kill(arm)
    two.stays_ended()
    two.follow()
