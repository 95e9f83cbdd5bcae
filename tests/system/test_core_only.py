"""A core installation: a robot, its verbs and a recording, in processes that can import no package of an extra."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from tests.system.robot import DEMO, Robot
from trocar.procs.machine.extras import PACKAGES
from trocar.procs.recordings.reading import open_recording

ABSENT = sorted({*PACKAGES, "uvicorn", "glfw"})
BLOCK = f"""
import sys

class Absent:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {ABSENT}:
            raise ModuleNotFoundError(f"no module {{name}}", name=name)

sys.meta_path.insert(0, Absent())
"""


@pytest.fixture
def core(robot: Robot, tmp_path: Path) -> Robot:
    """A robot whose interpreters, all of them fresh ones, lack the packages of extras."""
    (tmp_path / "core").mkdir()
    (tmp_path / "core" / "sitecustomize.py").write_text(BLOCK)
    robot.environment["PYTHONPATH"] = f"{tmp_path / 'core'}:{os.environ.get('PYTHONPATH', '')}"
    robot.are_verbs_apart = True
    return robot


@pytest.mark.slow
@pytest.mark.simulated("paced")
def test_a_robot_moves_and_is_recorded_without_any_extra(core: Robot) -> None:
    core.up(DEMO, "--set", "recorder.on=true")
    core.home()
    assert core.trocar("status")
    core.insist("record", "move", "PSM1", "--for", "0.2")
    core.insist("send", "PSM1", "move_jp", "0.1", "0", "0.12", "0", "0", "0", "--wait")
    (path,) = (core.logs / core.name / "recordings").glob("move-*.mcap")
    with open_recording(path) as recording:
        assert len(recording.records("PSM1/state").rows) > 10
