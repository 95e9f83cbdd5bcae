"""The current of one brake at a time, on emulated arms: what io limits by itself."""

from __future__ import annotations

import numpy as np
import pytest

from tests.io.boards_harness import COARSE, BoardsHarness
from trocar.procs.boards.board_faults import BoardFaults
from trocar.procs.config import PROJECT_CONFIGS, load_system


@pytest.fixture
def ecm() -> BoardsHarness:
    loaded = load_system(PROJECT_CONFIGS / "systems" / "demo-ecm.yaml", boards="emulated", sets=COARSE)
    assert loaded.system is not None, loaded.errors
    return BoardsHarness(loaded.system, driven=True)


def test_only_one_brake_is_released_and_for_half_a_second(ecm: BoardsHarness) -> None:
    assert "its amplifiers are not on" in ecm.do("brake_current", "ECM", 1, 0.2).answers[-1][1]
    assert ecm.do("power_on", "ECM").outcome == "done"
    for values, why in (((3, 0.1), "has no brake"), ((1, 9.0), "allowed: up to"), ((9, 0.1), "allowed: 0 to 3")):
        assert why in ecm.do("brake_current", "ECM", *values).answers[-1][1]
    assert ecm.do("brake_current", "ECM", 1, 0.2).outcome == "done"
    assert "brake 1 is being tried" in ecm.do("brake_current", "ECM", 0, 0.2).answers[-1][1]
    ecm.run(0.2)
    assert ecm.record.current_request[-3:].tolist() == pytest.approx([0.0, 0.2, 0.0])
    ecm.run(0.4)
    assert not ecm.record.current_request.any() and not ecm.record.brakes_released.any()


def test_it_engages_at_once_where_an_axis_goes_too_far_or_power_off(ecm: BoardsHarness) -> None:
    assert ecm.do("power_on", "ECM").outcome == "done"
    faults = BoardFaults(ecm.world, ecm.plant)
    ecm.do("brake_current", "ECM", 0, 0.2)
    faults.place("ECM", ecm.plant.position[ecm.plant.slices["ECM"]] + np.array([0.4, 0.0, 0.0, 0.0]))
    ecm.run(0.05)
    assert not ecm.record.current_request.any()
    assert "moved too far" in ecm.do("brake_current", "ECM", 0, 0.2).answers[-1][1], "it falls on, step by step, else"
    ecm.do("brake_engage", "ECM")
    assert ecm.do("brake_current", "ECM", 0, 0.2).outcome == "done"
    assert "being tried" in ecm.do("drive_axis", "ECM", 0, 0.1, 0.5, 0.1, 0).answers[-1][1]
    ecm.do("power_off", "ECM")
    ecm.run(0.05)
    assert not ecm.record.current_request.any() and not ecm.core.parts.brake_trials.running
