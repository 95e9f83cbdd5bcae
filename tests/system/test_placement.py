"""Who runs on which core, tried on emulated boards as if they were real: nobody has those here."""

from __future__ import annotations

import os
import subprocess
import sys

import psutil
import pytest

from tests.system.robot import DEMO, ROOT, UP_S, Robot, wait_for
from tests.system.test_single_processes import row

pytestmark = [pytest.mark.slow, pytest.mark.simulated,
              pytest.mark.skipif(len(os.sched_getaffinity(0)) < 4, reason="needs four cores")]
SUPERVISOR = """
from trocar.procs.config.loading import load
from trocar.procs.config.loading.processes import placed
from trocar.procs.supervisor import loop
load.placement = lambda system, made, cores: placed([(cpu,) for core in cores for cpu in core], {"IO1": None})
loop.main()
"""


def test_io_has_a_core_to_itself_and_all_others_keep_away(robot: Robot) -> None:
    words = [sys.executable, "-c", SUPERVISOR, str(DEMO), "--system", robot.name]
    with (robot.logs / "supervisor.txt").open("a") as out:
        robot.supervisor = subprocess.Popen(words, cwd=ROOT, env=robot.environment, stdout=out, stderr=out, text=True)
    wait_for(robot.is_up, UP_S, f"system up; it said:\n{robot.output()}")
    given = {name: psutil.Process(robot.pid(name)).cpu_affinity() or [] for name in ("IO1", "PSM1", "supervisor")}
    assert len(given["IO1"]) == 1 and not set(given["IO1"]) & {*given["PSM1"], *given["supervisor"]}
    assert not set(given["PSM1"]) & set(given["supervisor"])
    for child in psutil.Process(robot.pid("supervisor")).children():
        assert child.pid == robot.pid("IO1") or not set(child.cpu_affinity() or []) & set(given["IO1"])
    shown = row(robot, "IO1")
    assert shown["cpus"] == given["IO1"] and shown["scheduling"].endswith(f"cpu {given['IO1'][0]}")
    assert robot.down() == 0
