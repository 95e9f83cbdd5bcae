"""Potentiometer tables of Si arms, made by moving emulated arms from stop to stop."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from tests.host.hosted import COARSE, HashedArm
from tests.tools.commission.harness import RigBench
from trocar.procs.boards.wiring import hidden_table
from trocar.procs.config import load_system
from trocar.procs.host.host import Host
from trocar.tools.commission import lookup_table, person_sim, tables
from trocar.tools.commission.bench import CommandOutcome
from trocar.tools.commission.lookup_table import MISSING, RANGES, SENSES, ReadingsByHand
from trocar.tools.commission.person import Act, Sweep
from trocar.tools.commission.person_sim import SWEEP_STEPS
from trocar.tools.commission.subject import Subject
from trocar.tools.commission.window import Window
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
def test_a_hidden_table_is_found_and_the_arm_then_homes_with_it(
        name: str, kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(person_sim, "SWEEP_STEPS", 350)  # an eighth of the readings, and as many times their spread
    monkeypatch.setattr(lookup_table, "MAX_SPREAD", 8 * lookup_table.MAX_SPREAD)
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
        assert np.ptp(error) < 24 * step
        low, high = RANGES[kind][axis]
        known = np.array(row)[np.array(row) < 31.0]
        assert known.max() + known.min() == pytest.approx(SENSES[kind][axis] * (low + high), abs=12 * step)
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


SAMPLED = 5
"""Of so many readings, a motion shows one."""
Swept = tuple[np.ndarray, np.ndarray]
"""Readings and positions at them, from stop to stop."""


class HandMovedBench(RigBench):
    """Axes that a person moves one after the other, without boards: `arm` is how they are, `fault` spoils a sweep."""

    def __init__(self, name: str, folder: Path) -> None:
        new_arm(name=name, generation="Si", serial=SERIAL, to=folder)
        super().__init__(folder / f"system-{name}.json", sets=["calibration_mode=true"])
        self.subject = next(each for each in self.subjects if each.arm)
        self.begin(np.random.default_rng(0))
        self.person.doing = self._moves  # type: ignore[method-assign]

    def begin(self, dice: np.random.Generator) -> None:
        """Another arm."""
        self.dice, self.sweeps, self.asked_for = dice, 0, list[str]()
        self.fault: Callable[[int, Samples], Samples] = lambda sweep, samples: samples
        self.arm = [self._axis(low, high) for low, high in RANGES[self.subject.kind]]
        self.person.confirmed.clear()
        self.person.agrees = self._asks  # type: ignore[method-assign]

    def _axis(self, low: float, high: float) -> Swept:
        count, width = int(self.dice.integers(3300, 3560)), (high - low) * self.dice.uniform(0.97, 1.03)
        share = np.linspace(0.0, 1.0, count)
        share += 0.003 * np.sin(2.0 * np.pi * self.dice.integers(1, 6) * share)
        codes = (self.dice.integers(4096) + self.dice.choice((-1, 1)) * np.arange(count)) % 4096
        return codes, self.dice.uniform(-3.0, 3.0) + width * share

    def _asks(self, question: str) -> bool:
        self.asked_for.append(question)
        return self.person.says

    def _moves(self, act: Act, text: str) -> Iterator[None]:
        rest = [len(codes) // 2 for codes, _ in self.arm]
        for axis, (codes, _) in enumerate(self.arm):
            way = np.arange(0, len(codes), SAMPLED)
            places = np.tile(rest, (2 * len(way), 1))
            places[:, axis] = np.concatenate((way, way[::-1]))
            readings, positions = (np.stack([row[part][places[:, k]] for k, row in enumerate(self.arm)], axis=1)
                                   for part in (0, 1))
            self.samples = self.fault(self.sweeps, (axis, readings, positions))[1:]
            yield
        self.sweeps += 1

    def sample(self, io: str, seconds: float) -> Window:
        readings, positions = self.samples
        return Window(np.arange(len(readings)) * 0.002, {
            "pot_bits": readings, "position": positions, "powered": np.ones((len(readings), 1), dtype=bool)})

    def asked(self, io: str, command: str, values: tuple[float, ...], text: str, timeout: float) -> \
            tuple[CommandOutcome, Window]:
        return CommandOutcome("done", ""), Window(np.zeros(0), {})

    def enable(self, subject: Subject) -> None:
        """No boards."""

    disable = enable


Samples = tuple[int, np.ndarray, np.ndarray]
"""The axis that moves; readings and positions (k, axes)."""


@pytest.fixture(scope="module")
def by_hand(tmp_path_factory: pytest.TempPathFactory) -> dict[str, HandMovedBench]:
    return {name: HandMovedBench(name, tmp_path_factory.mktemp(name)) for name in ("PSM1", "ECM")}


def _step(bench: HandMovedBench, axis: int) -> float:
    codes, positions = bench.arm[axis]
    return float(np.ptp(positions) / len(codes))


def _faults(bench: HandMovedBench, axis: int) -> dict[str, tuple[str, Callable[[Samples], Samples]]]:
    """What may be wrong with an axis, and the reason of the refusal."""
    codes, positions = bench.arm[axis]
    other, step, middle = (axis + 1) % len(bench.arm), _step(bench, axis), 0.5 * (positions[0] + positions[-1])
    few = set(codes[1000:1030].tolist())

    def changed(samples: Samples, readings: np.ndarray | None = None, where: np.ndarray | None = None) -> Samples:
        moved, codes, positions = samples[0], samples[1].copy(), samples[2].copy()
        if readings is not None:
            codes[:, axis] = readings
        if where is not None:
            positions[:, axis] = where
        return moved, codes, positions

    def without_some(samples: Samples) -> Samples:
        keep = ~np.isin(samples[1][:, axis], list(few))
        return samples[0], samples[1][keep], samples[2][keep]

    def slack(samples: Samples) -> Samples:
        way = np.sign(np.gradient(samples[2][:, axis]))
        return changed(samples, where=samples[2][:, axis] + 4.0 * step * way)

    def slipped(samples: Samples) -> Samples:
        late = np.arange(len(samples[1])) > 0.6 * len(samples[1])
        return changed(samples, where=samples[2][:, axis] + 20.0 * step * (late & (samples[0] == axis)))

    def short(samples: Samples) -> Samples:
        where = middle + 0.9 * (samples[2][:, axis] - middle)
        return changed(samples, codes[np.searchsorted(positions, where)], where)

    return {"dead": ("its potentiometer shows one reading only", lambda s: changed(s, np.full(len(s[1]), 77))),
            "swapped": ("positions at one reading differ", lambda s: changed(s, s[1][:, other])),
            "slipped": ("positions at one reading differ", slipped),
            "slack": ("positions at one reading differ", slack),
            "scale": ("its range is", lambda s: changed(s, where=1.1 * s[2][:, axis])),
            "short": ("its range is", short), "gap": ("readings in a row are missing", without_some)}


@pytest.mark.parametrize("seed", range(50))
def test_a_hidden_arm_is_found_or_refused_for_the_right_reason(
        by_hand: dict[str, HandMovedBench], seed: int, tmp_path: Path) -> None:
    dice, name = np.random.default_rng(seed), ("PSM1", "ECM")[seed % 2]
    bench = by_hand[name]
    bench.begin(dice)
    axis = int(dice.integers(len(bench.arm)))
    kind, (reason, spoils) = list(_faults(bench, axis).items())[seed % 7]
    bench.fault, bench.person.says = lambda sweep, samples: spoils(samples), False
    refused = tables.run(bench, tmp_path)
    assert {str(each).partition(":")[0] for each in refused.problems} == {bench.subject.where(axis)}, kind
    assert reason in str(refused.problems[0]) and not list(tmp_path.iterdir())
    bench.fault, bench.person.says, bench.sweeps = (
        lambda sweep, samples: spoils(samples) if sweep == 0 else samples), True, 0
    assert tables.run(bench, tmp_path).problems == []
    (one,) = bench.asked_for[1:]  # only this axis was repeated, after the word was typed again
    assert bench.subject.title(axis) in one and "this axis only" in one and bench.person.confirmed == [name] * 3
    (file,) = tmp_path.iterdir()
    for k, row in enumerate(json.loads(file.read_text())["lookup"]):
        codes, positions = bench.arm[k]
        middle = SENSES[bench.subject.kind][k] * 0.5 * sum(RANGES[bench.subject.kind][k])
        truth = positions - 0.5 * (positions[0] + positions[-1]) + middle
        assert np.abs(np.array(row)[codes] - truth).max() <= SAMPLED * _step(bench, k)
