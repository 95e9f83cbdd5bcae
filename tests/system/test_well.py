"""`trocar status` says that all is well only where it is: one test for each thing that may be missing."""

from __future__ import annotations

import json
import os
import resource
import signal
from pathlib import Path

import psutil
import pytest

from tests.system.robot import ROOT, Robot, wait_for
from trocar.shm.memory.segment import segment_name, unlink

pytestmark = [pytest.mark.slow, pytest.mark.simulated]
KINEMATIC = ROOT / "configs" / "systems" / "kinematic.yaml"
RECORDS = ("--set", "recorder.on=true")
SMALL = 20_000


def last_line(robot: Robot) -> str:
    """What `status` ends with."""
    said = robot.types("status")
    line = said.stdout.rstrip().splitlines()[-1]
    assert said.returncode == 0 or not line.startswith("all well"), said.stdout
    return line


def ends_with(robot: Robot, *words: str) -> None:
    """The last line has all these words in the end, `attach` has the same line, and programs see it, too."""
    wait_for(lambda: all(word in last_line(robot) for word in words), 60, f"{words}; it says {last_line(robot)}")
    robot.trocar("status", code=1)

    def is_attached() -> bool:
        once = " ".join(robot.trocar("attach", "--once").split())
        assert "all well" not in once
        return all(word in once for word in words)

    wait_for(is_attached, 60, f"{words} in attach, also while it is being started again")


def test_a_dead_supervisor_is_not_well_and_what_it_left_says_its_age(robot: Robot) -> None:
    robot.up(KINEMATIC)
    robot.home()
    assert robot.supervisor is not None
    wait_for(lambda: last_line(robot) == "all well", 60, "all is well before")
    robot.supervisor.kill()
    robot.supervisor.wait(30)
    ends_with(robot, "first: supervisor is dead", "trocar up")
    wait_for(lambda: robot.state("PSM1") == "STOPPED", 60, "its processes end")
    wait_for(lambda: json.loads(robot.trocar("status", "--json", code=1))["standings"][0]["age_s"], 60, "its age")
    shown = next(line for line in robot.trocar("status", code=1).splitlines() if " ago" in line)
    assert "PSM1" in shown and "yes" not in shown, "it is not said to be homed"
    robot.trocar("down")


def test_a_process_that_cannot_begin_is_not_well(robot: Robot) -> None:
    robot.up(KINEMATIC, *RECORDS)
    wait_for(lambda: last_line(robot).startswith("all well"), 60, "all is well before")
    assert robot.supervisor is not None
    children = psutil.Process(robot.supervisor.pid).children()
    (template,) = (each.pid for each in children if "trocar.procs.supervisor.template" in each.cmdline())
    hard = resource.prlimit(template, resource.RLIMIT_NOFILE)[1]  # others inherit it, as after `ulimit -n`
    resource.prlimit(template, resource.RLIMIT_NOFILE, (files_of(robot.pid("recorder")) - 10, hard))
    robot.kill("recorder")
    ends_with(robot, "first: recorder", "Too many open files", "trocar logs recorder")
    robot.down()


def files_of(pid: int) -> int:
    """How many it has open."""
    return len(list(Path(f"/proc/{pid}/fd").iterdir()))


@pytest.mark.parametrize(("instance", "what"), [("PSM1", "state"), ("PSM1", "mailbox"), ("PSM1", "control"),
                                                ("supervisor", "document"), ("supervisor", "control")])
def test_a_segment_that_is_gone_is_not_well(robot: Robot, instance: str, what: str) -> None:
    robot.up(KINEMATIC)
    wait_for(lambda: last_line(robot).startswith("all well"), 60, "all is well before")
    unlink(segment_name(robot.name, instance, what))
    ends_with(robot, "segments were removed", f"{instance}~{what}", "trocar down")
    assert robot.supervisor is not None
    robot.supervisor.send_signal(signal.SIGTERM)
    robot.supervisor.wait(60)


def test_a_recorder_that_keeps_nothing_is_not_well_until_it_does(robot: Robot) -> None:
    robot.up(KINEMATIC, *RECORDS)
    robot.home()
    folder = robot.logs / robot.name / "recordings"
    wait_for(lambda: any(path.stat().st_size > SMALL for path in folder.glob("box-*.mcap")), 60, "it records")
    wait_for(lambda: last_line(robot) == "all well", 60, "all is well before")
    recorder = robot.pid("recorder")
    _, most = resource.prlimit(recorder, resource.RLIMIT_FSIZE)
    resource.prlimit(recorder, resource.RLIMIT_FSIZE, (SMALL, most))  # to it, the disk is full
    ends_with(robot, "first: recorder: nothing is recorded", "File too large")
    os.kill(robot.pid("io"), signal.SIGKILL)
    wait_for(lambda: "could not be kept" in robot.trocar("logs", "recorder", code=None)
             or "not all of it" in robot.trocar("logs", "recorder", code=None), 60, "the fault is reported")
    resource.prlimit(recorder, resource.RLIMIT_FSIZE, (most, most))
    wait_for(lambda: robot.types("home").returncode == 0, 240, "io has come back")
    ends_with(robot, "first: recorder: the ", "last fault")
    robot.down()
