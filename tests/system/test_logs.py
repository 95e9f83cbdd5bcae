"""A process that writes lots: neither the disk nor the others notice."""

from __future__ import annotations

import json
import time
from contextlib import suppress
from pathlib import Path

import pytest
import yaml

from tests.system.robot import ROOT, SLOWER, Robot, wait_for

pytestmark = [pytest.mark.slow, pytest.mark.patient]
TALKS = """
import trocar

class Talks(trocar.Process):
    def update(self):
        print("it is all the same to me, " * 100, flush=True)  # 2.6 kB
"""
MOST = 50_000


def sizes(folder: Path) -> dict[str, int]:
    """The files of what `talks` has written, bytes."""
    found = {}
    for path in folder.glob("talks*.log"):
        with suppress(FileNotFoundError):  # it is being renamed
            found[path.name] = path.stat().st_size
    return found


def test_what_a_process_writes_is_kept_within_bounds(robot: Robot, tmp_path: Path) -> None:
    (tmp_path / "talks.py").write_text(TALKS)
    file = tmp_path / "lab.json"
    section = {"logs": {"size_mb": MOST / 1e6, "keep": 2},
               "processes": [{"name": "talks", "module": "talks.py", "period_s": 0.001}]}
    file.write_text(json.dumps({"$id": "dvrk-system.schema.json", "$version": "1", "trocar": section}))
    robot.up(file)
    folder = robot.logs / robot.name
    wait_for(lambda: (folder / "talks.2.log").exists(), 60, "two new files have begun")
    end = time.monotonic() + 0.5
    while time.monotonic() < end:
        assert sizes(folder).keys() <= {"talks.log", "talks.1.log", "talks.2.log"}
        # it grows for as long as nobody looks
        wait_for(lambda: sum(sizes(folder).values()) < 100 * MOST, 60, "little is kept")
        time.sleep(0.01)
    wait_for(lambda: "it is all the same" in robot.trocar("logs", "talks", "-n", "1"), 60, "a line after a new file's")
    assert robot.state("talks") == "RUNNING"
    assert robot.down() == 0


WARM = """
import trocar

class Warm(trocar.Process):
    def setup(self):
        self.status("the sensor is warm")
"""


def test_what_arms_and_processes_of_users_report_as_status_is_in_the_logs(robot: Robot, tmp_path: Path) -> None:
    (tmp_path / "warm.py").write_text(WARM)
    content = yaml.safe_load((ROOT / "configs" / "systems" / "kinematic.yaml").read_text())
    content["trocar"] = {"processes": [{"name": "warm", "module": "warm.py"}]}
    file = tmp_path / "lab.yaml"
    file.write_text(yaml.safe_dump(content))
    robot.up(file, *SLOWER)
    robot.home()
    wait_for(lambda: "INFO  the sensor is warm" in robot.trocar("logs", "warm"), 60, "the line of the user's process")
    assert "INFO  ENABLED" in robot.trocar("logs", "PSM1") and "INFO  HOMED" in robot.trocar("logs", "PSM1")
    robot.down()
    said = robot.trocar("logs", "-n", "1000", "--system", robot.name)
    assert "warm  INFO  the sensor is warm" in said, "also afterwards"
