"""Parts that are stopped for good (SIGSTOP), hang, or never end: who notices, and what is killed in what time.

On the wall clock and in simulated time.
"""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import psutil
import pytest

from tests.system.robot import DEMO, SLOWER, Robot, wait_for
from tests.system.test_single_processes import row
from trocar.procs.tables.manifest import SIMULATED_HUNG_S, proc
from trocar.shm.system import directory
from trocar.shm.time.system_time import SystemTime

pytestmark = pytest.mark.slow
LOOPS = """
import trocar


class Loops(trocar.Process):
    def on_loop(self):
        while True:
            pass
"""
HUNG_S = 2.0
MARGIN_S = 5.0  # of a busy machine


def stop(robot: Robot, instance: str) -> int:
    """SIGSTOP for good; returns the pid that hangs."""
    pid = robot.pid(instance)
    os.kill(pid, signal.SIGSTOP)
    return pid


def killed(robot: Robot, instance: str, hung: int, seconds: float) -> str:
    """Wait until another process runs in its place; how the supervisor says that the one before ended."""
    try:
        wait_for(lambda: robot.pid(instance) != hung and robot.state(instance) == "RUNNING", seconds,
                 f"{instance} killed and started again")
    finally:
        if robot.pid(instance) == hung:
            os.kill(hung, signal.SIGCONT)
    return str(row(robot, instance)["exit_reason"])


def test_a_process_that_hangs_is_killed_and_comes_back(robot: Robot) -> None:
    robot.up(DEMO, *SLOWER)
    io = directory.reader(robot.name, "IO1", "state")
    events = directory.reader(robot.name, "supervisor", "events")

    def hang() -> str:
        robot.home()
        assert io.newest()
        before = io.field("position").copy()
        reason = killed(robot, "PSM1", stop(robot, "PSM1"), 60.0)
        assert re.fullmatch(r"hung for 1\.. s, killed; it was stopped \(SIGSTOP\); automatic restart . of 5", reason)
        assert io.newest()
        held = io.field("powered").all() and io.field("pid_enabled").all()
        return "" if held and np.abs(io.field("position") - before).max() < 0.01 else "io did not hold the robot"

    problem = robot.retry(hang, "an arm hangs")
    assert not problem, problem
    late = [each for each in events.last(100) if each["code"] == b"process-late" and each["component"] == b"PSM1"]
    assert late and b"PSM1 is late: silent for 0.0" in late[-1]["text"]
    epoch = io.epoch
    reason = killed(robot, "IO1", stop(robot, "IO1"), 60.0)
    assert "hung for" in reason
    wait_for(lambda: io.newest() and io.epoch > epoch, 60.0, "records of the new io")
    assert not io.field("powered").any(), "nobody asked for power since"
    for each in (io, events):
        each.close()
    robot.pids |= {robot.pid(instance) for instance in directory.instances(robot.name)}
    stalled_supervisor_ends(robot)


def stalled_supervisor_ends(robot: Robot) -> None:
    """Its processes have ended by themselves: it starts none of them again, and leaves nothing."""
    assert robot.supervisor is not None
    before = robot.output().count("started again")
    os.kill(robot.supervisor.pid, signal.SIGSTOP)
    time.sleep(3.0)  # what is tested is the time itself
    os.kill(robot.supervisor.pid, signal.SIGCONT)
    try:
        assert robot.supervisor.wait(60) == 1
    finally:
        robot.down()
    assert re.search(r"stalled for \d+\.\d s; its processes have ended", robot.output())
    assert robot.output().count("started again") == before and robot.left_over() == []


@pytest.mark.simulated("paced")
def test_a_process_that_hangs_or_dies_stops_time_for_a_while_only(robot: Robot) -> None:
    robot.up()  # in lock-step, which only waits for less, it is the same
    robot.trocar("power-on")
    with SystemTime(robot.name) as time_:
        for instance, number in (("PSM1", signal.SIGKILL), ("IO1", signal.SIGSTOP), ("boards", signal.SIGSTOP)):
            hung = robot.pid(instance)
            os.kill(hung, number)
            stands_ns = time_.now_ns()
            wait_for(lambda: time_.now_ns() > stands_ns + 20_000_000, 60.0, "time goes on")  # noqa: B023
            reason = killed(robot, instance, hung, 60.0)
            hung_s = re.match(r"hung for (\d\.\d) s, killed", reason)
            assert bool(hung_s) is (number == signal.SIGSTOP), reason
            assert hung_s is None or SIMULATED_HUNG_S <= float(hung_s.group(1)) < 1.5 * SIMULATED_HUNG_S
            robot.pids.add(robot.pid(instance))
    deaths = {name: int(row(robot, name)["restarts"]) for name in ("boards", "IO1", "PSM1")}
    assert deaths == {"boards": 1, "IO1": 1, "PSM1": 1}, "none is taken for another"
    assert robot.down() == 0


@pytest.fixture
def busy() -> Iterator[None]:
    """Other programs want all cores, several times."""
    programs = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(3 * (os.cpu_count() or 1))]
    yield
    for program in programs:
        program.kill()
        program.wait()


def gone_after_s(pid: int) -> float:
    """How long it takes until this process is gone."""
    begin = time.monotonic()
    wait_for(lambda: not psutil.pid_exists(pid) or psutil.Process(pid).status() == psutil.STATUS_ZOMBIE, 60.0,
             f"the end of {pid}")
    return time.monotonic() - begin


@pytest.mark.simulated
def test_who_never_ends_is_killed_in_real_time_on_a_busy_machine_too(robot: Robot, tmp_path: Path, busy: None) -> None:
    (tmp_path / "loops.py").write_text(LOOPS)
    loops = {"module": "loops.py", "commands": [{"name": "loop"}], "on_exit": "stay-down"}
    file = tmp_path / "lab.json"
    file.write_text(json.dumps({
        "$id": "dvrk-system.schema.json", "$version": "1",
        "arms": [{"name": "PSM1", "type": "PSM", "simulation": "KINEMATIC", "arm_file": "arms/PSM1-demo.yaml"}],
        "trocar": {"processes": {"hangs": {**loops, "hung_s": HUNG_S}, "deaf": {**loops, "hung_s": 86400.0}}}}))
    robot.up(file)
    for name in ("hangs", "deaf"):
        wait_for(lambda name=name: robot.state(name) == "RUNNING", 120.0, f"{name} runs")  # type: ignore[misc]
        robot.pids.add(robot.pid(name))
        robot.trocar("send", name, "loop", "--timeout", "0.1", code=None)
    assert gone_after_s(robot.pid("hangs")) < HUNG_S + MARGIN_S
    with robot.popen("down"):
        wait_for(lambda: robot.state("supervisor") == "STOPPING", 60.0, "it is asked to end")
        assert gone_after_s(robot.pid("deaf")) < proc("user").stop_s + MARGIN_S
    assert "deaf stopped: did not end within 3 s, killed" in robot.output()
