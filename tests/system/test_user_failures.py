"""What users' processes do wrong in a running system stays their own."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.system.robot import Robot, wait_for
from trocar.shm.system import directory
from trocar.tools.inspect.processes import statuses

pytestmark = [pytest.mark.slow, pytest.mark.simulated]
PROGRAM = """
import time

import trocar


class Mine(trocar.Process):
    def setup(self):
        if self.name == "broken":
            raise OSError("no sensor on the line")
        print("printed before it hangs")

    def on_hang(self):
        time.sleep(1000)
"""
EAGER = """
import trocar


class Eager(trocar.Process):
    def setup(self):
        self.psm = trocar.psm("PSM1")

    def on_enable(self):
        self.psm.state_command("enable")

    def update(self):
        try:
            self.psm.state_command("home")
            self.error = ""
        except trocar.Refused as why:
            self.error = str(why)
"""
SHARING = """
import trocar


class Sharing(trocar.Process):
    count = 0

    def update(self):
        self.count += 1
        self.publish("count", count=self.count)

    def on_loop(self):
        while True:
            pass

    def on_stick(self):
        sum(range(1 << 60))  # in C: no Python runs that could be stopped
"""
ENDING = """
import sys

import trocar


class Ending(trocar.Process):
    def main(self):
        if self.name == "exits":
            sys.exit()
        if self.name == "reads":
            self.subscribe("PSM1/stat")
"""
ARMS = [{"name": "PSM1", "type": "PSM", "simulation": "KINEMATIC", "arm_file": "arms/PSM1-demo.yaml"}]


def up(robot: Robot, folder: Path, program: str, *rows: dict[str, object]) -> None:
    """A kinematic PSM1 with processes of this program."""
    (folder / "mine.py").write_text(program)
    processes = [{"module": "mine.py", **row} if row["name"] != "lab" else row for row in rows]
    file = folder / "lab.json"
    file.write_text(json.dumps({"$id": "dvrk-system.schema.json", "$version": "1", "arms": ARMS,
                                "trocar": {"processes": processes}}))
    robot.up(file)


def test_a_broken_and_a_hanging_process_change_nothing_else(robot: Robot, tmp_path: Path) -> None:
    up(robot, tmp_path, PROGRAM, {"name": "broken", "on_exit": "stay-down"},
       {"name": "stuck", "hung_s": 0.5, "late_s": 0.3, "commands": [{"name": "hang"}]})
    robot.comes_back("stuck", 0)
    wait_for(lambda: "no sensor on the line" in reason(robot, "broken"), 60, "why the other does not")
    arm, stuck = robot.pid("PSM1"), robot.pid("stuck")
    robot.trocar("send", "stuck", "hang", "--timeout", "0.1", code=None)
    robot.comes_back("stuck", stuck)
    assert "hung for" in reason(robot, "stuck") and " in on_hang, trocar logs stuck" in reason(robot, "stuck")
    line = PROGRAM[:PROGRAM.index("time.sleep")].count("\n") + 1
    assert f'mine.py", line {line} in on_hang' in robot.trocar("logs", "stuck")
    assert "printed before it hangs" in robot.trocar("logs", "stuck"), "although it was killed"
    assert robot.pid("PSM1") == arm and robot.state("PSM1") == "RUNNING"
    assert robot.down() == 0


def test_one_that_ends_by_itself_says_so_and_is_not_said_to_run(robot: Robot, tmp_path: Path) -> None:
    up(robot, tmp_path, ENDING, {"name": "exits", "restart_limit": 1}, {"name": "returns", "restart_limit": 0},
       {"name": "reads", "restart_limit": 0})
    line = ENDING[:ENDING.index("sys.exit")].count("\n") + 1
    whys = {"exits": f"sys.exit() in mine.py line {line}", "returns": "exit code 0: its main has returned"}
    for name, why in whys.items():
        wait_for(lambda name=name: "given up" in reason(robot, name), 60, "nobody tries any more")  # type: ignore[misc]
        assert problem(robot, name).startswith(f"not running: {why}; given up after")
        assert why in robot.trocar("start", name, code=1)
        assert f"ended: {why.removeprefix('exit code 0: ')}" in robot.trocar("logs", name)
        wait_for(lambda name=name: "given up" in reason(robot, name), 60, "the start has failed")  # type: ignore[misc]
        robot.trocar("stop", name, "--yes")
        assert robot.state(name) == "STOPPED" and problem(robot, name) == "stopped"
        assert reason(robot, name).startswith(f"stopped: it had ended before: {why}")
    line = ENDING[:ENDING.index("self.subscribe")].count("\n") + 1
    wait_for(lambda: f'mine.py", line {line}, in main' in robot.trocar("logs", "reads"), 60, "its line")
    robot.trocar("stop", "reads", "--yes")
    assert robot.down() == 0


def test_a_filter_that_hangs_is_ended_and_in_c_its_process_is_killed(robot: Robot, tmp_path: Path) -> None:
    topic = {"name": "count", "fields": [{"name": "count", "type": "int"}]}
    up(robot, tmp_path, SHARING, {"name": "lab", "hung_s": 4.0, "late_s": 0.5, "period_s": 0.005},
       {"name": "good", "host": "lab", "topics": [topic]},
       {"name": "bad", "host": "lab", "topics": [topic], "commands": [{"name": "loop"}, {"name": "stick"}]})
    good, bad = (directory.reader(robot.name, name, "count") for name in ("good", "bad"))
    wait_for(lambda: good.newest() and bad.newest(), 60, "both run")
    lab = robot.pid("lab")
    robot.pids.add(lab)
    robot.trocar("send", "bad", "loop", "--timeout", "0.1", code=None)
    wait_for(lambda: any("TimeUp" in text for text in told(robot, "bad")), 60, "it was ended")
    head = good.head
    wait_for(lambda: good.head > head + 10, 60, "the other one goes on")
    assert robot.pid("lab") == lab, "in the same process"
    wait_for(lambda: robot.state("bad") == "RUNNING", 60, "it has begun anew")
    robot.trocar("send", "bad", "stick", "--timeout", "0.1", code=None)
    robot.comes_back("lab", lab)
    wait_for(lambda: robot.pid("good") == robot.pid("bad") == robot.pid("lab"), 60, "both run again")
    heads = good.head, bad.head
    wait_for(lambda: good.head > heads[0] and bad.head > heads[1], 60, "and publish")
    assert "hung for" in reason(robot, "lab")
    assert "bad is part of lab" in robot.trocar("restart", "bad", "--yes", code=1)
    good.close()
    bad.close()
    assert robot.down() == 0


def test_a_process_homes_only_while_a_person_has_asked_it_to(robot: Robot, tmp_path: Path) -> None:
    up(robot, tmp_path, EAGER, {"name": "eager", "period_s": 0.1, "commands": [{"name": "enable"}]})
    wait_for(lambda: "not authorized" in problem(robot, "eager"), 60, "it was refused")
    robot.pids.add(robot.pid("eager"))
    assert not homed(robot)
    wait_for(lambda: robot.types("send", "eager", "enable", "--wait").returncode == 0, 60, "it was asked")
    wait_for(lambda: homed(robot), 60, "it homes for who asked it")
    robot.trocar("power-off")
    wait_for(lambda: "gave its command earlier" in problem(robot, "eager"), 60, "what was asked is void")
    assert not homed(robot)
    assert robot.down() == 0


def homed(robot: Robot) -> bool:
    """Whether PSM1 is."""
    return bool(json.loads(robot.trocar("echo", "PSM1/state", "--json", "--once"))["is_homed"])


def problem(robot: Robot, name: str) -> str:
    """What `trocar status` says is wrong with it."""
    return next(row.problem for row in statuses(robot.name) if row.name == name)


def told(robot: Robot, name: str) -> list[str]:
    """What it has told people."""
    events = directory.reader(robot.name, name, "events")
    texts = [row["text"].decode() for row in events.last(100)]
    events.close()
    return texts


def reason(robot: Robot, name: str) -> str:
    """How it last ended."""
    return next(row.exit_reason for row in statuses(robot.name) if row.name == name)
