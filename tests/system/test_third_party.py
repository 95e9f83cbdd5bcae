"""A master that is another program: a slave follows a recording, and what a death of the program does."""

from __future__ import annotations

import contextlib
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

from tests.system.robot import ROOT, SLOWER, Robot, wait_for
from trocar.shm.system import directory
from trocar.tools.inspect.processes import statuses

pytestmark = pytest.mark.slow
SYSTEM = ROOT / "configs/systems/third-party-master.yaml"
SCALE = 0.2


def recording(path: Path) -> Path:
    """The tip goes to and fro, the gripper opens and closes, and every two seconds the console's operator comes anew.

    So it can be followed again soon where a busy machine holds somebody up, and shows enough until the next time.
    """
    lines = ["time,x,y,z,qx,qy,qz,qw,gripper,operator_present"]
    for step in range(400):
        seconds = step * 0.05
        gripper, away = 0.5 * (1 - math.cos(2 * math.pi * seconds)), 0.03 * math.sin(2 * math.pi * seconds)
        lines.append(f"{seconds},{away:.6f},0,0,0,0,0,1,{gripper:.4f},{int(seconds % 2.0 > 0.2)}")
    path.write_text("\n".join(lines))
    return path


def start(robot: Robot, file: Path) -> subprocess.Popen[str]:
    words = [sys.executable, "-m", "trocar.tools.examples.recorded_master", str(file), "--times", "20"]
    master = subprocess.Popen(words, cwd=ROOT, env=robot.environment, stderr=subprocess.PIPE, text=True)
    robot.pids.add(master.pid)
    return master


def state_of(robot: Robot, name: str) -> tuple[str, str]:
    return next((process.state, process.problem) for process in statuses(robot.name) if process.name == name)


def without_break(records: np.ndarray) -> np.ndarray:
    """Those of the last time that it followed; who is held up ends that, and then it follows from elsewhere."""
    parts = np.split(records, np.flatnonzero(np.diff(records["following"])) + 1)
    return next((part for part in reversed(parts) if part["following"].any()), records[:0])


def moved(records: np.ndarray) -> float:
    """The largest way of the master while followed, m, each time compared with the slave's goal."""
    followed = without_break(records)
    followed = followed[np.isfinite(followed["goal_cp"][:, 0])]
    if len(followed) < 10:
        return 0.0
    master, goal = followed["mtm_measured_cp"][:, :3], followed["goal_cp"][:, :3]
    assert np.abs((goal - goal[0]) - SCALE * (master - master[0])).max() < 1e-6
    return float(np.abs(master - master[0]).max())


def test_a_slave_follows_a_recording_and_its_death_ends_that(robot: Robot, tmp_path: Path) -> None:
    robot.up(SYSTEM, *SLOWER, "--set", "supervisor_lost_s=60")
    robot.insist("send", "system", "home", "--wait")
    teleop = directory.reader(robot.name, "MTMR_PSM1", "state", "teleop")
    slave = directory.reader(robot.name, "PSM1", "state", "arm")
    robot.insist("send", "console", "teleop_enable", "1")
    assert state_of(robot, "MTMR") == ("NOT ATTACHED", "")
    file = recording(tmp_path / "hand.csv")

    def end(master: subprocess.Popen[str]) -> None:
        os.kill(master.pid, signal.SIGKILL)
        master.communicate()
        wait_for(lambda: teleop.newest() and not teleop.field("following"), 60, "the end of following")

    def followed(master: subprocess.Popen[str]) -> subprocess.Popen[str]:
        """The master when it is followed, or another one where a busy machine held somebody up, which ends that."""
        for _ in range(5):
            assert teleop.newest()
            begin = teleop.stamp_ns
            with contextlib.suppress(pytest.fail.Exception):
                wait_for(lambda: moved(teleop.since(begin)) > 0.01, 30, "a fifth of the master's way")  # noqa: B023
                return master
            end(master)
            master = start(robot, file)
        end(master)
        pytest.fail(f"the slave does not follow: {bytes(teleop.field('reason').item()).decode()}")

    end(followed(start(robot, file)))
    late_ns = [row["stamp_ns"] - row["master_stamp_ns"][0] for row in teleop.last(10_000) if row["following"]]
    assert max(late_ns, default=0) < 45_000_000, "30 ms and a busy machine"
    assert state_of(robot, "MTMR") == ("DEAD", "dead")
    assert slave.newest()
    held = slave.field("setpoint_cp").copy()

    master = start(robot, file)
    wait_for(lambda: teleop.newest() and not bytes(teleop.field("reason").item()).startswith(b"waiting: MTMR is"), 60,
             "the program is there again")
    assert slave.newest() and teleop.newest()
    assert teleop.field("following") or np.abs(slave.field("setpoint_cp") - held).max() < 1e-6, "it waits for presence"
    master = followed(master)
    robot.down()
    _, reported = master.communicate(timeout=60)
    assert "the system has ended" in reported and master.returncode == 0
    teleop.close()
    slave.close()


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
    robot.up(tmp_path / "lab.yaml", *SLOWER)
    robot.comes_back("MTMR", 0)
    teleop = directory.reader(robot.name, "MTMR_PSM1", "state", "teleop")

    def goals(begin: int) -> list[float]:
        return [float(row["goal_cp"][0]) for row in teleop.since(begin) if row["following"]]

    def follow() -> None:
        begin = teleop.stamp_ns if teleop.newest() else 0
        wait_for(lambda: np.ptp(goals(begin) or [0.0]) > 0.0005, 20, "the slave follows")

    def die() -> None:
        pid = robot.kill("MTMR")
        wait_for(lambda: teleop.newest() and not teleop.field("following"), 60, "its death ends that")
        robot.comes_back("MTMR", pid)

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
    assert "a program that does not support move_cp" in robot.trocar("send", "MTMR", "move_cp", *"0000001", code=1)
    teleop.close()
    assert robot.down() == 0
