"""A system without real-time rights runs, and says at `up` and in `status` what it lacks and what grants it."""

from __future__ import annotations

import ctypes
import json
import resource
import subprocess
import sys

import pytest

from tests.system.robot import ROOT, UP_S, Robot, wait_for
from trocar.procs.node.realtime import limits_lines, user

pytestmark = [pytest.mark.slow, pytest.mark.patient]
PR_CAPBSET_DROP, CAP_IPC_LOCK, CAP_SYS_NICE = 24, 14, 23
LIBC = ctypes.CDLL(None)


def without_rights() -> None:
    """In the child: neither root nor anybody has them after the next exec."""
    for capability in (CAP_IPC_LOCK, CAP_SYS_NICE):
        LIBC.prctl(PR_CAPBSET_DROP, capability, 0, 0, 0)
    for limit in (resource.RLIMIT_RTPRIO, resource.RLIMIT_MEMLOCK):
        resource.setrlimit(limit, (0, 0))


def test_missing_rights_are_told_with_what_grants_them(robot: Robot) -> None:
    command = [sys.executable, "-m", "trocar", "up", "kinematic.yaml", "--system", robot.name, "--set", "clock=wall"]
    with (robot.logs / "supervisor.txt").open("a") as out:
        robot.supervisor = subprocess.Popen(command, cwd=ROOT, env=robot.environment, stdout=out, stderr=out,
                                            text=True, preexec_fn=without_rights)
    wait_for(robot.is_up, UP_S, "system up")
    wait_for(lambda: "is up" in robot.output(), 10, "all that is said at the start")
    for reported in (robot.output(), robot.trocar("status", code=None)):
        for lacking in ("no real-time priority (FIFO refused): ", "memory not locked (mlockall refused): "):
            (names,) = (line.partition(lacking)[2] for line in reported.splitlines() if lacking in line)
            assert {"io", "PSM1"} <= set(names.partition(";")[0].split(", "))
    assert all(line in robot.output() for line in limits_lines(user()))
    assert "trocar doctor" in reported and not any(line in reported for line in limits_lines(user()))
    printed = json.loads(robot.trocar("status", "--json", code=None))
    assert all(line in printed["rights"] for line in limits_lines(user()))


def test_a_system_that_got_all_it_asked_for_says_nothing_of_rights(robot: Robot) -> None:
    robot.up(ROOT / "configs/systems/kinematic.yaml")
    assert "limits.d" not in robot.output() + robot.trocar("status", code=None)
