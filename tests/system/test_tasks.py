"""Users' own code in the cycle of a whole system."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.system.robot import DEMO, UP_S, Robot, wait_for
from tests.system.test_user_failures import problem, reason

pytestmark = [pytest.mark.slow, pytest.mark.simulated]

PUSH = """
class Push:
    def __init__(self, robot):
        self.effort, self.fails = robot.options["effort"], robot.options.get("fails")
        self.hangs = robot.options.get("hangs")

    def step(self, sample, effort):
        if self.fails and sample.enabled:
            raise RuntimeError("no more")
        while self.hangs and sample.enabled:
            pass
        effort[0] = self.effort
"""


def system_file(folder: Path, options: str) -> Path:
    """The demo with `Push` beside it."""
    (folder / "push.py").write_text(PUSH)
    task = f"{{module: push.py, name: Push, budget_us: 100, over_budget: 1000, options: {options}}}"
    (folder / "lab.yaml").write_text(f"{DEMO.read_text()}  io:\n    tasks: [{task}]\n")
    return folder / "lab.yaml"


def test_a_task_pushes_a_robot_that_holds(robot: Robot, tmp_path: Path) -> None:
    robot.up(system_file(tmp_path, "{effort: 1.2}"))
    robot.trocar("power-on")
    robot.home()
    robot.trocar("send", "PSM1", "move_jp", "0", "0", "0.12", "0", "0", "0")

    def pushed() -> bool:
        state = json.loads(robot.trocar("echo", "IO1/PSM1/measured_js", "--json", "--once"))
        return bool(state["position"][0] > 0.007)  # 1.2 N·m against 120 N·m/rad

    wait_for(pushed, 30.0, "the push is seen")
    assert robot.down() == 0


def test_a_task_that_was_detached_is_shown_until_io_begins_anew(robot: Robot, tmp_path: Path) -> None:
    robot.up(system_file(tmp_path, "{effort: 1.2, fails: true}"))
    assert problem(robot, "IO1") == ""
    robot.home()
    wait_for(lambda: problem(robot, "IO1") != "", 30.0, "it failed")
    assert problem(robot, "IO1") == ("in-cycle task push.Push of PSM1 is detached: line 9: RuntimeError: no more; "
                                     "trocar restart IO1 attaches it again")
    assert "first: IO1: in-cycle task push.Push" in robot.trocar("status", code=1)
    robot.trocar("restart", "IO1", "--yes")
    robot.pids.add(robot.pid("IO1"))
    assert problem(robot, "IO1") == "" and robot.down() == 0


def test_a_task_that_hangs_is_named_with_its_line(robot: Robot, tmp_path: Path) -> None:
    robot.up(system_file(tmp_path, "{effort: 1.2, hangs: true}"))
    io = robot.pid("IO1")
    robot.trocar("home", code=None)
    robot.comes_back("IO1", io)
    assert "; where: push.py line 1" in reason(robot, "IO1") and " in step, trocar logs IO1" in reason(robot, "IO1")
    assert 'push.py", line 1' in robot.trocar("logs", "IO1") and robot.down() == 0


def test_a_task_that_cannot_be_made_refuses_the_start(robot: Robot, tmp_path: Path) -> None:
    robot.up(system_file(tmp_path, "{force: 1.2}"), wait=False)
    assert robot.supervisor is not None
    assert robot.supervisor.wait(timeout=UP_S) == 1
    assert "in-cycle task push.Push cannot be made for PSM1: line 4: KeyError: 'effort'" in robot.output()
