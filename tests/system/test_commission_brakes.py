"""The stage `brakes` on a whole emulated endoscope arm."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.system.robot import AT_250_HZ, Robot
from trocar.procs.config import PROJECT_CONFIGS
from trocar.procs.document.system import from_json
from trocar.shm.system import directory
from trocar.tools.commission import brakes
from trocar.tools.commission.bench import RunningBench
from trocar.tools.commission.person_sim import AtBoards

pytestmark = [pytest.mark.slow, pytest.mark.simulated("hosted")]
RELEASE_A, HOLD_A = (0.18, 0.15, 0.6), (0.05, 0.06, 0.15)
QUICK = {"STEPS": 30, "HELD_LOOKS": 4, "FREE_LOOKS": 4}


def test_hidden_currents_of_brakes_are_found(
        robot: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name, value in QUICK.items():
        monkeypatch.setattr(brakes, name, value)
    robot.up(PROJECT_CONFIGS / "systems" / "demo-ecm.yaml", "--boards", "emulated", *AT_250_HZ,
             "--set", f"emulation.robots.ECM.brake_release={list(RELEASE_A)}",
             "--set", f"emulation.robots.ECM.brake_hold={list(HOLD_A)}")
    document = from_json(directory.document(robot.name))
    with AtBoards(document) as person, RunningBench(document, person) as bench:
        outcome = brakes.run(bench, tmp_path)
    assert [str(problem) for problem in outcome.problems] == []
    rows = json.loads((tmp_path / "ECM-demo-rehearsed.json").read_text())["robots"][0]["brakes"]
    for row, release, hold in zip(rows, RELEASE_A, HOLD_A, strict=True):
        step = row["drive"]["maximum_current"] / brakes.STEPS
        assert row["release_current"] == pytest.approx(brakes.RELEASE_MARGIN * release, abs=3.0 * step)
        assert row["released_current"] == pytest.approx(brakes.HOLD_MARGIN * hold, abs=3.0 * step)
