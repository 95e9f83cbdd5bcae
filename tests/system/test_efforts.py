"""Efforts and streams of clients that die, ask for too much, never stop or were held up, on the wall clock: what the
emulated robot truly does.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from tests.system.conftest import systems
from tests.system.robot import DEMO, ROOT, SLOWER, Robot, wait_for
from trocar.procs.arm.joints import JointSpace, joints
from trocar.procs.config import load_system
from trocar.procs.document.system import from_json
from trocar.shm.system import directory
from trocar.tools.client.remote import Remote

pytestmark = pytest.mark.slow

FILE = DEMO.parent / "demo-teleop.yaml"
POSITION, EFFORT = 1, 3
DEEP = (0.0, 0.0, 0.12, 0.0, 0.0, 0.0)
PUSHER = """
import sys, time
import trocar
with trocar.arm(sys.argv[1]) as arm:
    while True:
        arm.servo_jf([float(word) for word in sys.argv[2:]])
        time.sleep(0.01)
"""


class Pushed:
    """One arm of the running system, and where its joints truly are."""

    def __init__(self, robot: Robot, name: str, begin: tuple[float, ...]) -> None:
        """It goes to `begin`, whatever happened before: io may have been held up, and then the robot has no power."""
        robot.home()
        self.robot, self.name, self.begin = robot, name, begin
        self.remote = Remote(robot.name, name)
        self.state = directory.reader(robot.name, name, "state")
        self.boards = directory.reader(robot.name, "boards", "state")
        system = load_system(FILE).system
        assert system is not None
        arm = system.arm(name)
        self.space: JointSpace = joints(arm, arm.tool)
        robots = [row for io in from_json(directory.document(robot.name)).emulated().ios for row in io.robots]
        first = sum(len(row.actuators) for row in robots[: [row.name for row in robots].index(arm.robot)])
        self.axes = slice(first, first + self.space.axes)
        self.go_to_begin()

    def go_to_begin(self) -> None:
        assert self.remote.settled("move_jp", self.begin).outcome == "done"

    @property
    def mode(self) -> int:
        assert self.state.newest()
        return int(self.state.field("control_mode"))

    def now_ns(self) -> int:
        assert self.boards.newest()
        return int(self.boards.stamp_ns)

    def wait_ns(self, duration_ns: int) -> None:
        """Until so much of the boards' time has passed."""
        since_ns = self.now_ns()
        wait_for(lambda: self.now_ns() > since_ns + duration_ns, 60, f"{duration_ns * 1e-9:g} s")

    def truth(self, since_ns: int, what: str) -> np.ndarray:
        """True joint positions or velocities (k, size) since then."""
        return self.true(self.boards.since(since_ns)[what])

    def true(self, values: np.ndarray) -> np.ndarray:
        """Joint values (k, size) of those of all axes."""
        return np.asarray(values[:, self.axes] @ self.space.to_joint.T)

    def push(self, efforts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """True velocities and positions while it is pushed for 2.5 s from where it begins.

        Again where a busy machine held us up: the efforts ended meanwhile.
        """
        for _ in range(10):
            self.go_to_begin()
            ended, since_ns = len(self.reported("effort-timeout")), self.now_ns()
            parts = [self.boards.since(since_ns)]  # taken bit by bit: rings keep less than 2.5 s
            while self.now_ns() < since_ns + 2_500_000_000:
                self.remote.ask("servo_jf", efforts)
                time.sleep(0.02)
                parts.append(self.boards.since(int(parts[-1]["stamp_ns"][-1]) + 1 if len(parts[-1]) else since_ns))
            rows = np.concatenate(parts)
            found = self.true(rows["velocity"]), self.true(rows["position"])
            if len(self.reported("effort-timeout")) == ended:
                break
        return found

    def reported(self, code: str) -> list[str]:
        """Texts of its events of this code so far."""
        events = directory.reader(self.robot.name, self.name, "events")
        texts = [row["text"].decode() for row in events.last(2000) if row["code"] == code.encode()]
        events.close()
        return texts

    def pusher(self, *efforts: float) -> subprocess.Popen[bytes]:
        """A program that pushes all the time; returns once the arm is in effort mode by it."""
        made = subprocess.Popen([sys.executable, "-c", PUSHER, self.name, *map(str, efforts)], cwd=ROOT,
                                env=self.robot.environment)
        wait_for(lambda: self.mode == EFFORT, 60, f"{self.name} pushed")
        return made

    def close(self) -> None:
        self.remote.close()
        self.state.close()
        self.boards.close()


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Robot]:
    with systems(tmp_path_factory.mktemp("efforts")) as make:
        robot = make()
        robot.up(FILE, *SLOWER)
        robot.home()
        yield robot


@pytest.fixture
def psm(running: Robot) -> Iterator[Pushed]:
    made = Pushed(running, "PSM1", DEEP)
    yield made
    made.close()


@pytest.fixture
def mtm(running: Robot) -> Iterator[Pushed]:
    made = Pushed(running, "MTMR", (0.0,) * 7)
    yield made
    made.close()


def test_more_than_the_motors_give_is_clipped_and_said(running: Robot, psm: Pushed) -> None:
    reported = running.trocar("send", "PSM1", "servo_jf", "1e6", *"00000")
    assert reported.strip() == "done, clipped: yaw"
    assert "1000 N" in running.trocar("send", "PSM1", "body/servo_cf", "0", "0", "1e6", *"000", code=1)
    wait_for(lambda: psm.mode == POSITION, 30, "the effort of a single command ended")


def test_the_efforts_of_a_killed_client_end(psm: Pushed) -> None:
    before = len(psm.reported("effort-timeout"))
    pusher = psm.pusher(0.3, 0, 0, 0, 0, 0)
    pusher.kill()
    pusher.wait()
    wait_for(lambda: psm.mode == POSITION, 30, "PSM1 holding after its client was killed")
    wait_for(lambda: len(psm.reported("effort-timeout")) > before, 30, "the reason")
    since = psm.now_ns() + 500_000_000
    wait_for(lambda: psm.now_ns() > since + 300_000_000, 60, "0.3 s of it")
    assert np.abs(psm.truth(since, "velocity"))[:, :3].max() < 0.02


def test_the_efforts_of_a_masters_killed_client_end_and_it_is_free(mtm: Pushed) -> None:
    pusher = mtm.pusher(0, 0, 0, 0, 0, 0, 0.005)
    pusher.kill()
    pusher.wait()
    wait_for(lambda: mtm.reported("effort-timeout"), 30, "the reason")
    assert mtm.mode == EFFORT
    wait_for(lambda: mtm.state.newest() and int(mtm.state.field("control_space")) == 2, 30, "Cartesian space")
    wait_for(lambda: mtm.state.newest() and np.abs(mtm.state.field("setpoint_effort")[6]) < 1e-4, 30, "no effort")


@pytest.mark.parametrize("which", ("psm", "mtm"))
def test_a_constant_effort_keeps_below_the_speed_limit_and_stops_before_the_joint_limit(
    which: str, request: pytest.FixtureRequest
) -> None:
    arm: Pushed = request.getfixturevalue(which)
    space, count = arm.space, arm.space.count
    efforts = np.zeros(count)
    efforts[:3] = space.rated[:3]
    for side in (1.0, -1.0):
        velocity, place = arm.push(side * efforts)
        speed = np.abs(velocity)
        share = (speed / space.effort_speed)[:, :3].max(axis=0)
        assert (share < 1.2).all(), f"speeds {share} of the limits, to side {side}"
        assert (share > 0.7).any(), "and it was pushed"
        beyond = np.maximum(place - space.upper, space.lower - place)[:, :3].max(axis=0)
        assert (beyond <= 0.0).all(), f"{beyond} beyond the limits"
        zone = space.effort_zone[:3]
        near = np.where(side > 0.0, space.upper[:3] - place[-1, :3], place[-1, :3] - space.lower[:3])
        assert (near < zone).any() and speed[-200:, :3].max() < 0.05, "at rest at the wall"
    arm.remote.ask("hold")


def test_a_stream_that_was_held_up_ends_and_does_not_jump(running: Robot, psm: Pushed, tmp_path: Path) -> None:
    angle = 2.0 * np.pi * np.arange(4000) / 200.0 / 4.0  # 0.25 Hz
    rows = np.tile(DEEP, (len(angle), 1))
    rows[:, 0] = 0.5 * np.sin(angle)
    np.savetxt(tmp_path / "sine.csv", rows, delimiter=",")
    command = [sys.executable, "-m", "trocar", "stream", "PSM1", str(tmp_path / "sine.csv"), "--rate", "200"]
    stream = subprocess.Popen(command, cwd=ROOT, env=running.environment, stdout=subprocess.PIPE,
                              stderr=subprocess.STDOUT, text=True)
    wait_for(lambda: psm.truth(psm.now_ns() - 50_000_000, "velocity")[:, 0].max() > 0.5, 60, "PSM1 moved by the stream")
    os.kill(stream.pid, signal.SIGSTOP)
    psm.wait_ns(500_000_000)
    since = psm.now_ns()
    os.kill(stream.pid, signal.SIGCONT)
    reported, _ = stream.communicate(timeout=60)
    assert stream.returncode == 1 and "stalled for " in reported, reported
    psm.wait_ns(1_000_000_000)
    assert np.abs(psm.truth(since, "velocity")[:, 0]).max() < 0.1, "a jump"
    assert psm.mode == POSITION


def test_a_stream_of_another_program_is_not_followed_across_a_gap(psm: Pushed) -> None:
    for k in range(50):
        psm.remote.ask("servo_jp", (0.002 * k, *DEEP[1:]))
    psm.wait_ns(500_000_000)
    since = psm.now_ns()
    answer = psm.remote.answered("servo_jp", (0.6, *DEEP[1:]))
    assert answer.outcome == "refused" and "move there first" in answer.text
    psm.wait_ns(500_000_000)
    assert np.abs(psm.truth(since, "velocity")[:, 0]).max() < 0.1
