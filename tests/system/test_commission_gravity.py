"""The stage `gravity` on a whole emulated master that is heavier than its file says."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.system.robot import AT_250_HZ, Robot
from trocar.procs.document.arms import MasterGravityParameters
from trocar.procs.document.system import from_json
from trocar.procs.kinematics.master_gravity import MasterGravity
from trocar.shm.system import directory
from trocar.tools.commission import gravity, gravity_fit
from trocar.tools.commission.bench import RunningBench
from trocar.tools.commission.person_sim import AtBoards

pytestmark = [pytest.mark.slow, pytest.mark.simulated("hosted")]
HEAVIER = 1.3
FEW = (0, 4, 5, 7, 8, 10, 11, 14, 15, 16)
"""Sweeps: enough to tell masses from cables; all of them take minutes more."""
QUICK = {"RATIO": 1.0, "PREVIEW_RATIO": 1.0, "SETTLE_S": 0.2}
WITHIN_NM = 0.03


def test_a_master_that_is_heavier_than_its_file_gets_a_new_one(
        robot: Robot, data: Callable[[str], Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    every = gravity_fit.sweeps
    for name, value in QUICK.items():
        monkeypatch.setattr(gravity, name, value)
    monkeypatch.setattr(gravity_fit, "sweeps", lambda *values: [every(*values)[k] for k in FEW])
    robot.up(data("dvrk-site/jhu-dVRK/system-MTMR.json"), "--boards", "emulated", "--path", str(data("dvrk-share")),
             "--set", f"emulation.robots.MTMR.mass={HEAVIER}", *AT_250_HZ)
    document = from_json(directory.document(robot.name))
    with AtBoards(document) as person, RunningBench(document, person) as bench:
        outcome = gravity.run(bench, tmp_path)
    assert [str(problem) for problem in outcome.problems] == []
    (file,) = tmp_path.glob("gc-*")
    assert file.name == "gc-MTMR-22403-rehearsed.json"
    keys = json.loads(file.read_text())["GC_controller"]
    made = MasterGravity(MasterGravityParameters(**{field: tuple(keys[key]) for key, field in gravity.FIELDS.items()}))
    was = document.arm("MTMR").master_gravity
    assert was is not None
    still, start = np.zeros(7), np.array(gravity.START)
    expected = HEAVIER * MasterGravity(was).effort(start, still)
    assert made.effort(start, still) == pytest.approx(expected, abs=WITHIN_NM)
