"""One robot in real time: its cores, jumps of the clocks, a suspend, and the deaths of its arm's process and of io.

The robot is the demo's on emulated boards, placed on cores as with real boards. Clocks jump for its processes only
(shifted_clocks.py). A busy machine is given time: watchdogs and stalls of 0.2 s in place of 0.03 s.
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, closing
from datetime import datetime

import numpy as np
import psutil
import pytest
import yaml

from tests.system.conftest import systems
from tests.system.robot import DEMO, ROOT, UP_S, Robot, wait_for
from tests.system.shifted_clocks import ShiftedClocks
from tests.system.test_single_processes import row
from trocar.shm.mailbox.client import Client
from trocar.shm.system import directory
from trocar.shm.time.clock import monotonic_ns, pause
from trocar.tools.systems.supervising import ROOM

CPUS = sorted(os.sched_getaffinity(0))[:2]
pytestmark = [pytest.mark.slow, pytest.mark.skipif(len(CPUS) < 2, reason="needs two cores")]
SUPERVISOR = f"""
from dataclasses import replace
from trocar.procs.config.loading import load
from trocar.procs.supervisor import configuration, loop
configuration.cores = lambda: (({CPUS[0]},), ({CPUS[0]},), ({CPUS[-1]},), ({CPUS[-1]},))
placement = load.placement
load.placement = lambda system, made, cores: placement(system, replace(made, emulation=None), cores)
loop.main()
"""
SLOW = {"clock": "wall", "supervisor_lost_s": 60,
        "io.period_s": 0.002, "arm.period_s": 0.004, "emulation.period_s": 0.002,
        **{f"processes.{name}.late_s": 0.2 for name in ("IO1", "PSM1", "system")}}
CONFIGS = ROOT / "configs"
WATCHDOG_S = 0.2
AWAY, BACK = (0.6, 0.4, 0.16, 0.3, 0.2, -0.2), (0.1, -0.1, 0.12, 0.0, 0.0, 0.0)
DAY_S = 86_400
A_WHILE_S = 0.5
JUDGED_S = 11.0  # io looks at its period 10 s after its start


class RealTimeRobot:
    """The demo's robot, its clocks, and who looks at it."""

    def __init__(self, robot: Robot, held: ExitStack) -> None:
        self.robot, self.clocks = robot, ShiftedClocks(robot.logs)
        robot.environment |= self.clocks.environment
        self._up()
        self.arm, self.io, self.boards = (held.enter_context(closing(directory.reader(robot.name, name, "state")))
                                          for name in ("PSM1", "IO1", "boards"))
        self.client = held.enter_context(closing(Client(robot.name, "PSM1")))

    def _up(self) -> None:
        content = yaml.safe_load(DEMO.read_text())
        content["IOs"][0]["watchdog_timeout"] = WATCHDOG_S
        file = self.robot.logs / "demo.yaml"
        file.write_text(yaml.safe_dump(content))
        robot, sets = self.robot, [word for key, value in SLOW.items() for word in ("--set", f"{key}={value}")]
        words = ["-c", SUPERVISOR, str(file), "--system", robot.name, "--path", str(CONFIGS), *sets]
        words += ["--room", " " * ROOM]
        with (robot.logs / "supervisor.txt").open("a") as out:
            robot.supervisor = subprocess.Popen([sys.executable, *words], cwd=ROOT, env=robot.environment, stdout=out,
                                                stderr=out, text=True)
        wait_for(robot.is_up, UP_S, f"system up; it said:\n{robot.output()}")
        robot.pids |= {robot.pid(name) for name in directory.instances(robot.name)} - {0}

    def state(self) -> str:
        """Of the arm."""
        return self.arm.field("sub_state").item().decode() if self.arm.newest() else ""

    def has_power(self, since_ns: int = 0) -> bool:
        """Whether an amplifier is on, or was since then."""
        self.boards.newest()
        rows = self.boards.since(since_ns)["amp_on"] if since_ns else self.boards.field("amp_on")
        return bool(rows.any())

    def stalls(self) -> list[float]:
        """How often io and the arm were stalled."""
        return [self.robot.cell(name, "pauses") for name in ("IO1", "PSM1")]

    def homed(self) -> RealTimeRobot:
        """By an operator's command, whatever was before."""
        if self.state() != "HOMED":
            self.robot.insist("home")
        assert self.state() == "HOMED" and self.has_power()
        return self

    def powered(self) -> None:
        """By an operator's command, whatever was before."""
        if self.state() not in ("ENABLED", "HOMED"):
            self.robot.insist("power-on")
        assert self.state() in ("ENABLED", "HOMED") and self.has_power()

    def begins(self, goal: tuple[float, ...]) -> int:
        """A move, which is then under way; the number of the command."""
        begin = self.arm.field("setpoint_position").copy()
        number = self.client.send("move_jp", goal)
        wait_for(lambda: self.arm.newest() and np.abs(self.arm.field("setpoint_position") - begin).max() > 0.02, 20,
                 "some of the move")
        return number

    def ends_well(self, number: int) -> None:
        """A move is done."""
        answers: list[str] = []

        def is_done() -> bool:
            answers.extend(reply.outcome for reply in self.client.poll() if reply.id == number)
            return "done" in answers

        wait_for(is_done, 30, "the end of the move")

    def succeeded(self, name: str, old: int) -> None:
        """A process that was killed has a successor."""
        robot = self.robot
        wait_for(lambda: robot.pid(name) not in (0, old) and robot.state(name) == "RUNNING", 60, f"{name} is back")
        robot.pids.add(robot.pid(name))

    def stays_off(self, since_ns: int) -> None:
        """FAULT, without power from then on: nothing returns before an operator's command."""
        wait_for(lambda: self.state() == "FAULT", 20, f"FAULT, not {self.state()}")
        pause(A_WHILE_S)
        assert self.state() == "FAULT" and not self.has_power(since_ns)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RealTimeRobot]:
    with systems(tmp_path_factory.mktemp("wall")) as make, ExitStack() as held:
        yield RealTimeRobot(make(), held)


@pytest.fixture
def real(whole: RealTimeRobot) -> RealTimeRobot:
    """Homed."""
    return whole.homed()


def test_every_process_runs_on_the_cores_of_its_placement(whole: RealTimeRobot) -> None:
    robot = whole.robot
    given = {name: psutil.Process(robot.pid(name)).cpu_affinity() for name in directory.instances(robot.name)}
    assert given.pop("IO1") == [CPUS[1]] and given.pop("PSM1") == CPUS, "io has one of its own"
    assert set(map(str, given.values())) == {str([CPUS[0]])} and {"supervisor", "boards"} <= given.keys()
    children = psutil.Process(robot.pid("supervisor")).children()
    assert sum(child.cpu_affinity() == [CPUS[1]] for child in children) == 1
    shown = row(robot, "IO1")
    assert shown["cpus"] == [CPUS[1]] and shown["scheduling"].endswith(f"cpu {CPUS[1]}")


def test_steps_of_the_time_of_day_change_dates_and_nothing_else(real: RealTimeRobot) -> None:
    number, stalls = real.begins(AWAY), real.stalls()
    for step_s in (DAY_S, -400 * DAY_S):
        real.clocks.jump(local_s=step_s)
        pause(0.2)
    real.ends_well(number)
    real.robot.trocar("send", "PSM1", "state_command", "pause", "--wait")
    real.robot.trocar("send", "PSM1", "state_command", "resume", "--wait")
    real.clocks.jump()
    assert real.state() == "HOMED" and real.stalls() == stalls
    since = (datetime.now() - datetime.fromisoformat(" ".join(lines(real)[-1].split()[:2]))).days
    assert 399 <= since <= 401, "the date of that moment, behind the lines of before"
    assert real.robot.types("status").stdout.strip().endswith("all well")


def lines(real: RealTimeRobot) -> list[str]:
    """Of the arm's log."""
    return (real.robot.logs / real.robot.name / "PSM1.log").read_text().splitlines()


def test_an_arms_process_that_is_killed_lets_io_hold_and_goes_on_without_homing(real: RealTimeRobot) -> None:
    real.begins(BACK)
    killed_ns, old, epoch = monotonic_ns(), real.robot.kill("PSM1"), real.arm.epoch
    real.succeeded("PSM1", old)
    wait_for(lambda: real.arm.newest() and real.arm.epoch > epoch and real.state() == "HOMED", 60, "homed as before")
    pause(A_WHILE_S)
    rows, amps = real.io.since(killed_ns), real.boards.since(killed_ns)["amp_on"]
    assert rows["pid_enabled"].all() and rows["holding"].any() and amps.any(axis=1).all(), "it kept its power"
    resting = rows["setpoint_position"][len(rows) // 2 :]
    assert np.ptp(resting, axis=0).max() < 1e-6, "the move is not taken up again"


def test_missing_replies_are_not_called_a_slow_computer(whole: RealTimeRobot) -> None:
    robot, io = whole.robot, whole.io
    with closing(directory.reader(robot.name, "IO1", "events")) as events:
        for _ in range(5):  # an io that truly has no core says so, rightly; one that stalled judges nothing
            whole.powered()
            wait_for(lambda: io.newest() and io.field("cycle") > JUDGED_S / SLOW["io.period_s"], 60, "a judged period")
            bad, begun_ns, stalls = int(io.field("bad_reads")), monotonic_ns(), whole.stalls()
            robot.trocar("send", "boards", "reply_rate", "lost", "0.4", "IO1")
            wait_for(lambda: io.newest() and io.field("bad_reads") > bad + 500, 60, "replies are missing")  # noqa: B023
            pause(1.0)
            robot.trocar("send", "boards", "clear_packet_faults")
            blamed = {b"period", b"period-long"} & {bytes(row["code"]) for row in events.since(begun_ns)}
            if not blamed and whole.stalls() == stalls:
                break
    assert not blamed


def test_a_robot_with_power_whose_computer_was_suspended_is_off_until_an_operator_asks(real: RealTimeRobot) -> None:
    real.begins(AWAY)
    real.clocks.jump(boottime_s=3600.0)
    wait_for(lambda: not real.has_power(), 20, "power is off")
    real.stays_off(monotonic_ns())
    said = " ".join(real.robot.types("status").stdout.split())
    assert "stalled for 3600.0 s" in said or "io does not answer" in said  # whichever the arm noticed first
    assert "trocar home PSM1" in said


def test_an_io_that_is_killed_leaves_its_boards_to_their_watchdog_and_comes_back_without_power(
        whole: RealTimeRobot) -> None:
    whole.powered()
    old = whole.robot.kill("IO1")
    wait_for(lambda: whole.boards.newest() and whole.boards.field("watchdog").all(), 20, "every watchdog fired")
    off_ns = monotonic_ns()
    after_s = (whole.boards.field("watchdog_ns") - whole.boards.field("refresh_ns")) * 1e-9
    assert np.abs(after_s - WATCHDOG_S).max() < 0.01
    whole.succeeded("IO1", old)
    whole.stays_off(off_ns)
    whole.powered()


def test_a_full_disk_costs_lines_of_logs_only(whole: RealTimeRobot) -> None:
    robot, logs = whole.robot, whole.robot.logs / whole.robot.name
    for name in directory.instances(robot.name):
        full(robot.pid(name), is_full=True)
    sizes = [log.stat().st_size for log in (logs / "IO1.log", logs / "PSM1.log")]
    for word in ("power_off", "power_on"):
        robot.trocar("send", "system", word, "--wait")
    assert whole.has_power() and sizes == [log.stat().st_size for log in (logs / "IO1.log", logs / "PSM1.log")]
    whole.succeeded("PSM1", robot.kill("PSM1"))
    wait_for(lambda: whole.state() == "ENABLED", 60, "its successor takes over")
    full(robot.pid("supervisor"), is_full=False)
    full(robot.pid("system"), is_full=False)
    robot.trocar("send", "system", "power_off", "--wait")
    assert (logs / "system.log").read_text().endswith(" INFO power_off done\n"), "there is room again"
    assert robot.down() == 0 and "IO1 ended: stopped" in robot.output()


def full(pid: int, *, is_full: bool) -> None:
    """No file that this process writes may grow, as on a full disk; or again."""
    resource.prlimit(pid, resource.RLIMIT_FSIZE, (0 if is_full else resource.RLIM_INFINITY, resource.RLIM_INFINITY))
