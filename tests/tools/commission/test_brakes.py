"""Currents of brakes, found by moving emulated axes gently, and the files that come of it."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from tests.tools.commission.harness import RigBench
from trocar.tools.commission import brakes, gravity
from trocar.tools.commission.brakes import BrakeCurrents
from trocar.tools.commission.person import Declined
from trocar.tools.commission.subject import Subject
from trocar.tools.output.errors import Problem


class SimpleBrake:
    """Lets go at a current, and holds again below another."""

    def __init__(self, lets_go: float, holds_off: float) -> None:
        self._lets_go, self._holds_off = lets_go, holds_off
        self._free = False

    def moves(self, current: float) -> bool:
        self._free = current >= (self._holds_off if self._free else self._lets_go)
        return self._free


@pytest.fixture(scope="module")
def ecm() -> Subject:
    return next(each for each in RigBench("demo-ecm.yaml").subjects if each.arm)


@pytest.mark.parametrize("seed", range(50))
def test_hidden_currents_are_found_or_refused_for_the_right_reason(ecm: Subject, seed: int) -> None:
    dice = np.random.default_rng(seed)
    axis = int(dice.integers(3))
    brake = ecm.robot.brakes[axis]
    most, step = brake.maximum_current, brake.maximum_current / brakes.STEPS
    lets_go = dice.uniform(0.5, 0.85) * most
    hot = brakes.FACTOR * abs(brake.released_current) / brakes.HOLD_MARGIN
    holds_off = dice.uniform(0.1, 0.9) * min(lets_go, hot - step)
    found = brakes.measured(SimpleBrake(lets_go, holds_off).moves, most)
    assert lets_go <= found.lets_go <= lets_go + step and holds_off <= found.holds_off <= holds_off + step
    assert brakes.judge(found, ecm, axis) == []
    release, released = brakes.written(found, ecm, axis).values()
    assert lets_go < release <= most and holds_off < released <= release
    tiny = brakes.measured(SimpleBrake(lets_go, 0.3 * step).moves, most)
    assert brakes.written(tiny, ecm, axis)["brakes", axis, "released_current"] >= step, "else it engages at once"
    for one, reason in ((SimpleBrake(0.0, 0.0), "can be moved without current"),
                        (SimpleBrake(2.0 * most, 0.0), "did not move with up to"),
                        (SimpleBrake(dice.uniform(0.95, 1.0) * most - step, 0.3 * step), "it lets go at"),
                        (SimpleBrake(dice.uniform(0.05, 0.3) * brake.release_current, 0.3 * step), "a factor of 2.5")):
        (problem,) = brakes.judge(brakes.measured(one.moves, most), ecm, axis)
        assert reason in str(problem)


def test_an_axis_without_brake_is_refused_however_late_the_person_begins_to_move_it(ecm: Subject) -> None:
    most = ecm.robot.brakes[0].maximum_current
    for late in range(60):
        looks = iter(range(1000))
        found = brakes.measured(lambda current: next(looks) > late, most)  # noqa: B023
        assert brakes.judge(found, ecm, 0), late


def test_a_brake_that_closes_at_its_release_current_is_refused(ecm: Subject) -> None:
    found = BrakeCurrents(0.2, float("nan"))
    assert "does not stay released" in str(brakes.judge(found, ecm, 0)[0])


def test_a_holding_current_far_above_that_of_the_file_is_refused(ecm: Subject) -> None:
    (problem,) = brakes.judge(BrakeCurrents(0.6, 0.4), ecm, 2)
    assert "the brake becomes hot" in str(problem)


@pytest.fixture
def fewer_looks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Steps of current twice as large, and half as many looks without current and at the release current."""
    for name, value in {"STEPS": 25, "HELD_LOOKS": 4, "FREE_LOOKS": 4}.items():
        monkeypatch.setattr(brakes, name, value)


@pytest.mark.usefixtures("fewer_looks")
@pytest.mark.slow
def test_hidden_currents_of_emulated_brakes_are_written_into_a_new_file(tmp_path: Path) -> None:
    file = "demo-ecm-si.yaml"  # a Classic arm: tests/system/test_commission_brakes.py
    usual = next(each for each in RigBench(file).subjects if each.arm).robot.brakes
    dice = np.random.default_rng(1)
    lets_go = [float(dice.uniform(0.6, 0.85)) * brake.maximum_current for brake in usual]
    holds_off = [min(float(dice.uniform(0.15, 0.6)) * one, 1.3 * abs(brake.released_current))
                 for one, brake in zip(lets_go, usual, strict=True)]
    bench = RigBench(file, sets=[f"emulation.robots.ECM.brake_release={lets_go}",
                                 f"emulation.robots.ECM.brake_hold={holds_off}"])
    outcome = brakes.run(bench, tmp_path)
    assert [str(problem) for problem in outcome.problems] == []
    assert bench.person.confirmed == ["ECM"] and not bench.harness.record.amp_on.any()
    (made,) = tmp_path.glob("*-rehearsed.json")
    rows = json.loads(made.read_text())["robots"][0]["brakes"]
    for brake, row, release, hold in zip(usual, rows, lets_go, holds_off, strict=True):
        step = brake.maximum_current / brakes.STEPS
        sign = -1.0 if brake.release_current < 0.0 else 1.0
        found = sign * row["release_current"], sign * row["released_current"]
        wanted = min(brake.maximum_current, brakes.RELEASE_MARGIN * release), brakes.HOLD_MARGIN * hold
        assert found == pytest.approx(wanted, abs=2.5 * step)
        assert row["drive"]["maximum_current"] == brake.maximum_current


@pytest.mark.parametrize(("values", "says"), [
    ([0.0, 0.15, 0.6], "ECM brake 0 (yaw): its axis can be moved without current"),
    ([0.15, 0.5, 0.6], "ECM brake 1 (pitch): its axis did not move with up to")])
@pytest.mark.usefixtures("fewer_looks")
@pytest.mark.slow
def test_a_brake_that_slips_or_sticks_stops_it_and_writes_nothing(
        values: list[float], says: str, tmp_path: Path) -> None:
    bench = RigBench("demo-ecm.yaml", sets=[f"emulation.robots.ECM.brake_release={values}"])
    assert says in str(brakes.run(bench, tmp_path).problems[0])
    assert list(tmp_path.iterdir()) == [] and not bench.harness.record.amp_on.any()


def test_a_person_who_presses_enter_ends_it_with_the_brake_engaged(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    bench = RigBench("demo-ecm.yaml")
    monkeypatch.setattr(bench.person, "doing", lambda act, text: iter([None] * 3))
    with pytest.raises(Problem, match="its brake holds"):
        brakes.run(bench, tmp_path)
    assert not bench.harness.record.amp_on.any() and not bench.harness.record.current_request.any()


def test_brakes_hold_unless_the_word_is_typed_and_where_power_is_lost(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    bench = RigBench("demo-ecm.yaml")
    usual = bench.sample
    looks = iter(range(99))

    def stopped(io: str, seconds: float) -> object:
        if next(looks) == 20:
            bench.faults.stop(True)
        return usual(io, seconds)

    monkeypatch.setattr(bench, "sample", stopped)
    with pytest.raises(Problem, match=r"power went off|amplifiers are not on"):
        brakes.run(bench, tmp_path)
    assert not bench.harness.record.amp_on.any() and list(tmp_path.iterdir()) == []

    def refuses(danger: str, word: str) -> None:
        raise Declined("no")

    monkeypatch.setattr(bench.person, "confirm", refuses)
    with pytest.raises(Declined):
        brakes.run(bench, tmp_path)


@pytest.mark.parametrize("stage", [brakes, gravity])
def test_arms_without_brakes_and_other_arms_than_masters_are_left_alone(stage, tmp_path: Path) -> None:
    bench = RigBench("demo.yaml")
    outcome = stage.run(bench, tmp_path)
    assert not outcome.problems and bench.person.confirmed == [] and list(tmp_path.iterdir()) == []
    assert not bench.harness.record.powered.any()
