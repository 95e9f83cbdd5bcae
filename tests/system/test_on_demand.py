"""A process that runs only while somebody wants something of it."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

from tests.system.recipes import tree_with
from tests.system.robot import ROOT, Robot, wait_for
from tests.system.test_added_kind import METRONOME
from tests.system.test_single_processes import processes, row
from trocar.shm.system import directory
from trocar.shm.system.subscriptions import Subscriber

pytestmark = [pytest.mark.slow, pytest.mark.simulated]


def test_the_first_subscriber_starts_it_and_the_last_one_stops_it(robot: Robot, tmp_path: Path) -> None:
    robot.root = tree_with(METRONOME, tmp_path / "tree")
    manifest = robot.root / "procs" / "tables" / "manifest.py"
    manifest.write_text(manifest.read_text().replace('priority="least", woken=True, budget_us=100)', "woken=True)"))
    keys = ("start=on-demand", "linger_s=0.5")
    robot.up(ROOT / "configs" / "systems" / "kinematic.yaml",
             *(word for key in keys for word in ("--set", f"trocar.processes.metronome.{key}")))
    robot.trocar("hz", "metronome/state", "--for", "0.5", code=None)
    reader = directory.reader(robot.name, "metronome", "state")
    assert row(robot, "metronome")["state"] == "STOPPED" and not processes(robot, "metronome"), "lookers do not count"
    first, second = Subscriber(robot.name, "metronome"), Subscriber(robot.name, "metronome")
    first.want("state")
    wait_for(lambda: reader.newest() and robot.state("metronome") == "RUNNING", 60, "it runs and publishes")
    second.want("events")
    first.close()
    pid = processes(robot, "metronome")
    time.sleep(1.0)  # what is tested is the time itself
    assert processes(robot, "metronome") == pid, "somebody wants it still"
    second._page.close()  # as if killed
    wait_for(lambda: row(robot, "metronome")["lifecycle"] == "STOPPED", 60, "its end, after the dead was forgotten")
    assert processes(robot, "metronome") == []
    reader.close()
    assert robot.down() == 0
