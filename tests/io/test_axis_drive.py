"""One motor driven by itself, on emulated boards: what it moves, where it stops, and what ends it."""

from __future__ import annotations

import numpy as np
import pytest

from tests.io.boards_harness import BoardsHarness
from tests.io.harness import FakeCommand
from trocar.procs.config import PROJECT_CONFIGS, load_system


def _rig(name: str) -> BoardsHarness:
    loaded = load_system(PROJECT_CONFIGS / "systems" / name)
    assert loaded.system is not None, loaded.problems
    return BoardsHarness(loaded.system, driven=True)


@pytest.fixture(scope="module")
def psm() -> BoardsHarness:
    return _rig("demo.yaml")


def _powered(harness: BoardsHarness, robot: str) -> BoardsHarness:
    harness.do("power_off", robot)
    harness.run(0.1)
    assert harness.do("power_on", robot).outcome == "done"
    return harness


def test_a_small_current_moves_its_axis_by_the_travel_and_no_further(psm: BoardsHarness) -> None:
    _powered(psm, "PSM1")
    for sign in (1.0, -1.0):
        psm.run(0.3)
        before = psm.record.position.copy()
        test = psm.do("drive_axis", "PSM1", 0, sign * 0.5, 1.0, 0.03, 0)
        assert test.outcome == "done", test.answers
        moved = psm.record.position - before
        assert 0.03 <= sign * moved[0] < 0.06
        assert np.abs(moved[3:]).max() < 0.01
        psm.run(0.05)
        assert psm.record.current_request[0] == 0.0


def test_currents_beyond_half_of_the_largest_and_long_travels_are_refused(psm: BoardsHarness) -> None:
    _powered(psm, "PSM1")
    for values, what in (((0, 0.68, 1, 0.03, 0), "allowed: above 0 up to 0.67"), ((0, 0.3, 9, 0.03, 0), "up to 3"),
                         ((0, 0.3, 1, 0.3, 0), "up to 0.2"), ((2, 0.3, 1, 0.04, 0), "up to 0.03"),
                         ((7, 0.3, 1, 0.03, 0), "0 to 6"), ((0, 0.3, 1, 0.03, 1), "no brakes"), ((0,), "1 given")):
        assert what in psm.do("drive_axis", "PSM1", *values).answers[-1][1]


def test_without_power_nothing_is_driven() -> None:
    harness = _rig("demo.yaml")
    harness.run(0.1)
    assert "amplifiers are not on" in harness.do("drive_axis", "PSM1", 0, 0.3, 1.0, 0.03, 0).answers[-1][1]
    assert not harness.record.current_request.any()


def test_an_axis_that_does_not_move_ends_with_its_time(psm: BoardsHarness) -> None:
    _powered(psm, "PSM1")
    test = psm.do("drive_axis", "PSM1", 0, 0.01, 0.3, 0.03, 0)
    assert test.outcome == "done"
    assert psm.record.current_request[0] == 0.0


@pytest.mark.parametrize("ending", ["power_off", "servo_zero"])
def test_whoever_stops_it_is_heard_at_once(psm: BoardsHarness, ending: str) -> None:
    _powered(psm, "PSM1")
    test = FakeCommand("drive_axis", "PSM1", 0, 0.02, 3.0, 0.2, 0)
    psm.cycle([test])
    psm.run(0.2)
    assert psm.record.current_request[0] > 0.0
    psm.do(ending, "PSM1")
    psm.cycle(count=2)
    assert test.outcome == "failed"
    assert psm.record.current_request[0] == 0.0


@pytest.mark.slow
def test_brakes_hold_against_it_and_only_its_own_lets_go_for_it() -> None:
    harness = _powered(_rig("demo-ecm.yaml"), "ECM")
    before = harness.record.position.copy()
    assert harness.do("drive_axis", "ECM", 1, 0.4, 0.5, 0.03, 0).outcome == "done"
    assert np.abs(harness.record.position - before)[1] < 0.001
    for sign in (1.0, -1.0):  # also against its weight
        before = harness.record.position.copy()
        assert harness.do("drive_axis", "ECM", 1, sign * 0.47, 0.5, 0.03, 1).outcome == "done"
        moved = harness.record.position - before
        assert 0.03 <= sign * moved[1] < 0.06
        assert np.abs(moved[[0, 2]]).max() == 0.0
        harness.run(0.1)
        assert not harness.record.brakes_released[0]
    resting = harness.record.position.copy()
    harness.run(0.5)
    assert np.abs(harness.record.position - resting).max() < 0.001


def test_a_supply_alone_leaves_the_amplifiers_off_and_ends_by_itself(psm: BoardsHarness) -> None:
    psm.do("power_off", "PSM1")
    psm.run(0.1)
    assert psm.do("supply_on", "PSM1", 0.5).outcome == "done"
    psm.run(0.2)
    assert psm.record.powered[0]
    assert not psm.record.amp_on.any()
    assert not psm.record.power_requested[0]
    psm.run(0.5)
    assert not psm.record.powered[0]
    assert psm.errors() == []


def test_a_supply_alone_is_refused_to_a_robot_with_power_and_for_ever(psm: BoardsHarness) -> None:
    assert "allowed: ]0, 60]" in psm.do("supply_on", "PSM1", 61).answers[-1][1]
    _powered(psm, "PSM1")
    assert "it is powered" in psm.do("supply_on", "PSM1", 1).answers[-1][1]
