"""Faults of cables and sensors, as a host sees them: dead potentiometers, wrong encoders, swapped plugs, stuck axes."""

from __future__ import annotations

import numpy as np
import pytest

from tests.io.boards_harness import BoardsHarness
from trocar.procs.boards.board_faults import BoardFaults
from trocar.procs.config import PROJECT_CONFIGS, load_system


@pytest.fixture
def psm() -> BoardsHarness:
    loaded = load_system(PROJECT_CONFIGS / "systems" / "demo.yaml")
    assert loaded.system is not None, loaded.problems
    harness = BoardsHarness(loaded.system, driven=True)
    harness.run(0.05)
    return harness


@pytest.fixture
def faults(psm: BoardsHarness) -> BoardFaults:
    return BoardFaults(psm.world, psm.plant)


def _moved(harness: BoardsHarness, robot: str, by: float) -> np.ndarray:
    """What the encoders see when axis 0 is carried by so much."""
    before, goal = harness.record.position.copy(), harness.plant.position.copy()
    goal[0] += by
    harness.plant.place(robot, goal)
    harness.run(0.02)
    moved: np.ndarray = harness.record.position - before
    return moved


def test_a_dead_potentiometer_shows_nothing_until_it_is_mended(psm: BoardsHarness, faults: BoardFaults) -> None:
    before = psm.record.pot_voltage.copy()
    faults.kill_pot("PSM1", 3, True)
    psm.run(0.02)
    assert psm.record.pot_voltage[3] == 0.0
    assert np.allclose(np.delete(psm.record.pot_voltage, 3), np.delete(before, 3), atol=1e-3)
    faults.kill_pot("PSM1", 3, False)
    psm.run(0.02)
    assert psm.record.pot_voltage[3] == pytest.approx(before[3], abs=1e-3)


def test_a_wrong_encoder_counts_too_much_from_where_it_is(psm: BoardsHarness, faults: BoardFaults) -> None:
    resting = psm.record.position.copy()
    faults.scale_encoder("PSM1", 0, 1.25)
    psm.run(0.02)
    assert psm.record.position[0] == pytest.approx(resting[0], abs=1e-4)
    assert _moved(psm, "PSM1", 0.02)[0] == pytest.approx(0.025, abs=1e-4)
    faults.scale_encoder("PSM1", 0, -1.0)
    assert _moved(psm, "PSM1", 0.02)[0] == pytest.approx(-0.02, abs=1e-4)
    faults.scale_encoder("PSM1", 0, 1.0)
    assert _moved(psm, "PSM1", 0.02)[0] == pytest.approx(0.02, abs=1e-4)
    with pytest.raises(ValueError, match="allowed"):
        faults.scale_encoder("PSM1", 0, 0.0)


@pytest.mark.slow
def test_swapped_motors_move_each_other_until_swapped_back(psm: BoardsHarness, faults: BoardFaults) -> None:
    assert psm.do("power_on", "PSM1").outcome == "done"
    for moving, resting in ((1, 0), (0, 1)):
        faults.swap_motors("PSM1", 0, 1)
        psm.run(1.0)
        before = psm.record.position.copy()
        psm.do("drive_axis", "PSM1", 0, 0.3, 0.3, 0.02, 0)
        moved = np.abs(psm.record.position - before)
        assert moved[moving] > 10.0 * moved[resting]


def test_a_jammed_axis_stands_still_whatever_pulls(psm: BoardsHarness, faults: BoardFaults) -> None:
    assert psm.do("power_on", "PSM1").outcome == "done"
    faults.jam("PSM1", 0, True)
    before = psm.record.position[0]
    psm.do("drive_axis", "PSM1", 0, 0.6, 0.5, 0.02, 0)
    assert abs(psm.record.position[0] - before) < 1e-4
    assert abs(_moved(psm, "PSM1", 0.02)[0]) < 1e-4  # nor does a hand move it
    faults.jam("PSM1", 0, False)
    psm.do("drive_axis", "PSM1", 0, 0.6, 0.5, 0.02, 0)
    assert abs(psm.record.position[0] - before) > 0.01
