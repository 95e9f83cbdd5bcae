"""A master that is another program: a slave follows a recording, and what a death of the program does."""

from __future__ import annotations

import math
import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml

from shm import directory
from shm.client import Client
from shm.ring import RingReader
from tests.system.robot import ROOT, Robot, wait_for
from tools.inspect.processes import statuses

pytestmark = pytest.mark.slow
SYSTEM = ROOT / "configs/systems/third-party-master.yaml"
SCALE = 0.2


def recording(path: Path) -> Path:
    """The gripper is opened and closed, then the tip goes to and fro, and the console's operator is there."""
    lines = ["time,x,y,z,qx,qy,qz,qw,gripper,operator_present"]
    for step in range(400):
        seconds = step * 0.05
        gripper = 0.5 * (1 - math.cos(2 * math.pi * seconds)) if seconds < 1.0 else 0.0
        away = 0.03 * math.sin(2 * (seconds - 1.5)) if seconds > 1.5 else 0.0
        lines.append(f"{seconds},{away:.6f},0,0,0,0,0,1,{gripper:.4f},{int(seconds > 0.2)}")
    path.write_text("\n".join(lines))
    return path


def start(robot: Robot, file: Path) -> subprocess.Popen[str]:
    words = [sys.executable, "-m", "tools.examples.recorded_master", str(file)]
    master = subprocess.Popen(words, cwd=ROOT, env=robot.environment, stderr=subprocess.PIPE, text=True)
    robot.pids.add(master.pid)
    return master


def state_of(robot: Robot, name: str) -> tuple[str, str]:
    return next((process.state, process.problem) for process in statuses(robot.name) if process.name == name)


def moved(ring: RingReader, records: np.ndarray) -> float:
    """The largest way of the master while followed, m, each time compared with the slave's goal."""
    followed = records[records["following"] & np.isfinite(records["goal_cp"][:, 0])]
    if len(followed) < 10:
        return 0.0
    master, goal = followed["mtm_measured_cp"][:, :3], followed["goal_cp"][:, :3]
    assert np.abs((goal - goal[0]) - SCALE * (master - master[0])).max() < 1e-6
    return float(np.abs(master - master[0]).max())


def test_a_slave_follows_a_recording_and_its_death_ends_that(robot: Robot, tmp_path: Path) -> None:
    robot.up(SYSTEM)
    robot.trocar("send", "system", "home", "--wait")
    teleop = directory.reader(robot.name, "MTMR_PSM1", "state", "teleop")
    slave = directory.reader(robot.name, "PSM1", "state", "arm")
    console = Client(robot.name, "console")
    console.send("teleop_enable", (1,))
    assert state_of(robot, "MTMR") == ("NOT ATTACHED", "")
    file = recording(tmp_path / "hand.csv")

    def following(wanted: bool) -> None:
        wait_for(lambda: teleop.newest() and bool(teleop.field("following")) is wanted, 20,
                 f"following is {wanted}: {bytes(teleop.field('reason').item()).decode()}")

    master = start(robot, file)
    following(True)
    begin = teleop.stamp_ns
    wait_for(lambda: moved(teleop, teleop.since(begin)) > 0.01, 20, "the slave goes a fifth of the master's way")

    os.kill(master.pid, signal.SIGKILL)
    master.communicate()
    following(False)
    records = teleop.since(begin)
    followed = records[records["following"]]
    assert (followed["stamp_ns"] - followed["master_stamp_ns"][:, 0]).max() < 45_000_000, "30 ms and a busy machine"
    assert state_of(robot, "MTMR") == ("ATTACHED", "dead")
    assert slave.newest()
    held = slave.field("setpoint_cp").copy()

    master = start(robot, file)
    wait_for(lambda: teleop.newest() and not bytes(teleop.field("reason").item()).startswith(b"waiting: MTMR is"), 20,
             "the program is there again")
    assert not teleop.field("following") and slave.newest()
    assert np.abs(slave.field("setpoint_cp") - held).max() < 1e-6, "it waits for presence"
    following(True)
    robot.down()
    _, reported = master.communicate(timeout=20)
    assert "the system has ended" in reported and master.returncode == 0
    for part in (teleop, slave, console):
        part.close()


@pytest.mark.patient
def test_a_master_of_the_system_is_started_when_wanted_and_again_after_its_death(robot: Robot, tmp_path: Path) -> None:
    page = (ROOT / "docs/third-party-masters.md").read_text(encoding="utf-8")
    *_, program = re.findall(r"```python\n(.*?)```", page[: page.index("### Commands")], re.DOTALL)
    (tmp_path / "master.py").write_text(program)
    *_, declared = re.findall(r"```yaml\n(.*?)```", page, re.DOTALL)
    system = yaml.safe_load(SYSTEM.read_text())
    for arm in system["arms"]:
        if "arm_file" in arm:
            arm["arm_file"] = f"{ROOT}/configs/{arm['arm_file']}"
    (tmp_path / "lab.yaml").write_text(yaml.safe_dump({**system, **yaml.safe_load(declared)}))
    robot.up(tmp_path / "lab.yaml")
    wait_for(lambda: robot.state("MTMR") == "RUNNING", 20, "whoever reads it has started it")
    robot.pids.add(robot.pid("MTMR"))
    teleop = directory.reader(robot.name, "MTMR_PSM1", "state", "teleop")

    def goals(begin: int) -> list[float]:
        return [float(row["goal_cp"][0]) for row in teleop.since(begin) if row["following"]]

    def follow() -> None:
        begin = teleop.stamp_ns if teleop.newest() else 0
        wait_for(lambda: np.ptp(goals(begin) or [0.0]) > 0.0005, 20, "the slave follows")

    def die() -> None:
        pid = robot.kill("MTMR")
        wait_for(lambda: teleop.newest() and not teleop.field("following"), 20, "its death ends that")
        wait_for(lambda: robot.state("MTMR") == "RUNNING" and robot.pid("MTMR") != pid, 20, "its successor")
        robot.pids.add(robot.pid("MTMR"))

    def ask() -> None:
        robot.trocar("send", "system", "home", "--wait", code=None)
        robot.trocar("send", "console", "teleop_enable", "1", code=None)

    ask()
    followed = 0
    for _ in range(6):  # more than two where a busy machine holds somebody up, which ends following
        try:
            follow()
            followed += 1
        except pytest.fail.Exception:
            ask()
        die()
        if followed == 2:
            break
    assert followed == 2, "a program and its successor"
    assert "a program that does not carry out move_cp" in robot.trocar("send", "MTMR", "move_cp", *"0000001", code=1)
    teleop.close()
    assert robot.down() == 0
