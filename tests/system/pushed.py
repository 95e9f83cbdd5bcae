"""An arm of a running system that efforts push, and where its joints truly are."""

from __future__ import annotations

import subprocess
import sys

import numpy as np

from tests.system.robot import DEMO, ROOT, Robot, wait_for
from trocar.procs.arm.joints import JointSpace, joints
from trocar.procs.config import load_system
from trocar.procs.document.system import from_json
from trocar.shm.system import directory
from trocar.shm.time.clock import pause
from trocar.tools.client.remote import Remote

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
        """Home it where needed, and move it to `begin`."""
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
        """True velocities and positions while it is pushed for 2.5 s from where it begins."""
        self.go_to_begin()
        since_ns = self.now_ns()
        parts = [self.boards.since(since_ns)]  # taken bit by bit: rings keep less than 2.5 s
        while self.now_ns() < since_ns + 2_500_000_000:
            self.remote.ask("servo_jf", efforts)
            pause(0.02)
            parts.append(self.boards.since(int(parts[-1]["stamp_ns"][-1]) + 1 if len(parts[-1]) else since_ns))
        rows = np.concatenate(parts)
        return self.true(rows["velocity"]), self.true(rows["position"])

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
