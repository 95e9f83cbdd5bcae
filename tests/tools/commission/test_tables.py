"""Potentiometer tables of Si arms, made by moving emulated arms from stop to stop."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from tests.host.hosted import COARSE, HashedArm
from tests.tools.commission.harness import RigBench
from trocar.procs.boards.wiring import hidden_table
from trocar.procs.config import load_system
from trocar.procs.host.host import Host
from trocar.tools.commission import tables
from trocar.tools.commission.lookup_table import MISSING, RANGES, SENSES, ReadingsByHand
from trocar.tools.commission.person import Act, Sweep
from trocar.tools.commission.person_sim import SWEEP_STEPS
from trocar.tools.new_arm.verb import new_arm
from trocar.tools.output.errors import Problem

SERIAL = "23456"
PITCH = 1


def readings(low: float, high: float, count: int = 3500, first: int = 2000, per_step: int = 2) -> ReadingsByHand:
    """A pitch axis that was moved evenly from `low` to `high`; the other axes stood."""
    seen = ReadingsByHand(7)
    codes = (first + np.repeat(np.arange(count), per_step)) % 4096
    samples, positions = np.zeros((len(codes), 7), dtype=np.intp), np.zeros((len(codes), 7))
    samples[:, PITCH], positions[:, PITCH] = codes, np.linspace(low, high, len(codes))
    seen.add(samples, positions)
    return seen


def test_a_table_has_the_middle_of_its_arm_s_range_in_the_encoder_s_sense() -> None:
    row, why = readings(-1.5, 1.06).row(PITCH, "PSM")
    assert not why
    known = row[row < 31.0]
    assert (known.min(), known.max()) == pytest.approx((-1.2977, 1.2623), abs=1e-3)  # a worked example
    assert len(known) == 3500 + 2 * 50 and set(row[row > 31.0]) == {MISSING}
    assert row[2000 - 50] == row[2000] == known.min()  # the ends are padded, also over the end of the ring
    assert row[(2000 + 3500 + 49) % 4096] == pytest.approx(known.max(), abs=1e-3)


def test_readings_that_were_skipped_are_interpolated() -> None:
    whole, _ = readings(-1.28, 1.28).row(PITCH, "PSM")
    seen = readings(-1.28, 1.28)
    seen.count[PITCH, 100:115] = 0
    row, why = seen.row(PITCH, "PSM")
    assert not why and row[95:120] == pytest.approx(whole[95:120], abs=1e-4)


@pytest.mark.parametrize(("low", "high", "gap", "slip", "says"), [
    (-1.0, 1.0, 0, 0.0, "range"), (-1.5, 1.5, 0, 0.0, "range"), (-1.28, 1.28, 30, 0.0, "30 readings"),
    (-1.28, 1.28, 0, 0.05, "differ"), (0.0, 0.0, 0, 0.0, "range")])
def test_a_range_a_gap_or_a_slip_that_no_arm_has_makes_no_table(
        low: float, high: float, gap: int, slip: float, says: str) -> None:
    seen = readings(low, high)
    if gap:
        seen.count[PITCH, 100 : 100 + gap] = 0
    if slip:
        codes = np.zeros((1, 7), dtype=np.intp)
        codes[0, PITCH] = 50
        seen.add(codes, np.full((1, 7), -1.28 + 2.56 * 2146 / 3500 + slip))
    row, why = seen.row(PITCH, "PSM")
    assert says in why and not len(row)


def test_an_axis_that_stood_still_makes_no_table() -> None:
    assert "one reading" in readings(-1.0, 1.0).row(0, "PSM")[1]


@pytest.mark.parametrize(("name", "kind"), [("PSM1", "PSM"), ("ECM", "ECM")])
@pytest.mark.slow
def test_a_hidden_table_is_found_and_the_arm_then_homes_with_it(name: str, kind: str, tmp_path: Path) -> None:
    new_arm(name=name, generation="Si", serial=SERIAL, to=tmp_path)
    system = tmp_path / f"system-{name}.json"
    bench = RigBench(system, sets=["calibration_mode=true"])
    (subject,) = (each for each in bench.subjects if each.arm)
    assert tables.run(bench, tmp_path).problems == [] and bench.person.confirmed == [name]
    assert not bench.harness.record.amp_on.any()
    file = tmp_path / f"sawRobotIO1394-{name}-{SERIAL}-PotentiometerLookupTable-rehearsed.json"
    for axis, (row, truth) in enumerate(zip(json.loads(file.read_text())["lookup"], hidden_table(subject.robot),
                                            strict=True)):
        both = ~np.isnan(truth)
        error = np.array(row)[both] - truth[both]
        step = np.nanmax(np.abs(np.diff(truth[both])[1:-1]).clip(0, 0.01))
        assert np.ptp(error) < 4 * step
        low, high = RANGES[kind][axis]
        known = np.array(row)[np.array(row) < 31.0]
        assert known.max() + known.min() == pytest.approx(SENSES[kind][axis] * (low + high), abs=2 * step)
    assert load_system(system).system is None, "a rehearsal never makes a table of the robot"
    file.rename(tmp_path / f"sawRobotIO1394-{name}-{SERIAL}-PotentiometerLookupTable.json")
    loaded = load_system(system, boards="emulated", sets=COARSE)
    assert loaded.system is not None, loaded.errors
    with Host(loaded.system) as host:
        HashedArm(host, name).homes()
        state = host.reader(name)
        assert state.newest() and state.field("is_homed")


def test_a_name_that_the_system_would_not_accept_is_refused_before_a_person_moves_the_arm(tmp_path: Path) -> None:
    new_arm(name="PSM1", generation="Si", serial=SERIAL, to=tmp_path)
    file = tmp_path / f"sawRobotIO1394-PSM1-{SERIAL}.json"
    file.write_text(file.read_text().replace(f"{SERIAL}-Potentiometer", "Potentiometer"), encoding="utf-8")
    bench = RigBench(tmp_path / "system-PSM1.json", sets=["calibration_mode=true"])
    with pytest.raises(Problem, match=f"has to contain its serial number '{SERIAL}'"):
        tables.run(bench, tmp_path)
    assert bench.person.confirmed == [] and not bench.harness.record.powered.any()


@pytest.mark.slow
def test_a_stop_that_is_pressed_meanwhile_ends_it_and_the_brakes_hold(tmp_path: Path) -> None:
    new_arm(name="PSM1", generation="Si", serial=SERIAL, to=tmp_path)
    bench = RigBench(tmp_path / "system-PSM1.json", sets=["calibration_mode=true"])

    def moves(act: Act, text: str) -> Iterator[None]:
        yield
        bench.faults.stop(True)
        yield from (None for _ in range(99))

    bench.person.doing = moves  # type: ignore[method-assign]
    with pytest.raises(Problem, match="power went off"):
        tables.run(bench, tmp_path)
    assert not bench.harness.record.amp_on.any() and not list(tmp_path.glob("*Table*"))


def test_a_simulated_hand_never_jumps() -> None:
    bench = RigBench("demo-psm-si.yaml")
    (subject,) = (each for each in bench.subjects if each.arm)
    low, high = np.array([subject.range_of(axis) for axis in range(len(subject.names))]).T
    wheres = [bench.person._where(subject).copy()]
    for _ in bench.person.doing(Sweep(subject), ""):
        wheres.append(bench.person._where(subject).copy())
    moved = np.array(wheres)
    assert (np.abs(np.diff(moved, axis=0)) <= 1.01 * (high - low) / SWEEP_STEPS).all()
    assert moved.min(axis=0) == pytest.approx(low) and moved.max(axis=0) == pytest.approx(high)


def test_an_arm_that_has_its_table_keeps_it(tmp_path: Path) -> None:
    outcome = tables.run(RigBench("demo-psm-si.yaml"), tmp_path)
    assert not outcome.problems and "has its table" in outcome.notes[0] and not list(tmp_path.iterdir())
