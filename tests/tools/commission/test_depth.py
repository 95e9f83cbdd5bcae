"""Insertion offsets of PSMs, found by holding the wrist at the remote centre."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from tests.tools.commission.harness import RigBench
from trocar.procs.config import PROJECT_CONFIGS
from trocar.procs.config.read.source import read_source
from trocar.tools.commission import brakes, depth, tables
from trocar.tools.commission.person import Act, Put
from trocar.tools.commission.subject import Subject

DEPTH = 0.0156
WITHIN_M = 2e-4


@pytest.fixture(scope="module")
def psm() -> Subject:
    return RigBench("demo.yaml").subjects[0]


def places(seed: int, error: float, scale: float = 1.0, slip: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """What a potentiometer with this error and scale, and an encoder, show three times, there and deeper."""
    dice = np.random.default_rng(seed)
    at = DEPTH + dice.uniform(-4e-4, 4e-4, 3) + [0.0, 0.0, slip]
    away, begin = at + depth.AWAY_M + dice.uniform(-4e-3, 4e-3, 3), dice.uniform(-0.1, 0.1)
    return tuple(np.column_stack([scale * (where + error), where - begin]) for where in (at, away))


@pytest.mark.parametrize("seed", range(50))
def test_hidden_errors_are_accepted_or_refused_for_the_right_reason(psm: Subject, seed: int) -> None:
    error = float(np.random.default_rng(100 + seed).uniform(-0.018, 0.018))
    at, away = places(seed, error)
    assert depth.judge(at, away, DEPTH, psm) == []
    for wrong, reason in ((places(seed, error + np.copysign(0.04, error)), "its offset would change by"),
                          (places(seed, error, scale=0.0), "its potentiometer went 0.0 mm"),
                          (places(seed, error, scale=-1.0), "its potentiometer went -"),
                          (places(seed, error, scale=1.2), "within 10 %"),
                          (places(seed, error, slip=0.002), "the places differ by"),
                          ((at, at), "went 0.0 mm deeper")):
        (found,) = depth.judge(*wrong, DEPTH, psm)
        assert reason in str(found)


def _offset(path: Path) -> dict[str, float]:
    source, _ = read_source(path)
    assert source is not None
    return source.data["robots"][0]["actuators"][2]["potentiometer"]["voltage_to_position"]


@pytest.mark.parametrize("error", [0.007, -0.012])
def test_a_hidden_offset_is_written_into_a_new_file(error: float, tmp_path: Path) -> None:
    bench = RigBench("demo.yaml", sets=[f"emulation.robots.PSM1.pot_offset={[0.0, 0.0, error, 0.0, 0.0, 0.0, 0.0]}"])
    assert depth.depth_of(bench.document.arm("PSM1")) == pytest.approx(DEPTH)
    outcome = depth.run(bench, tmp_path)
    assert [str(problem) for problem in outcome.problems] == []
    was, now = _offset(PROJECT_CONFIGS / "io" / "PSM1-demo.yaml"), _offset(tmp_path / "PSM1-demo-rehearsed.json")
    assert now["offset"] - was["offset"] == pytest.approx(-error, abs=WITHIN_M) and now["scale"] == was["scale"]
    assert not bench.harness.record.powered.any()


def test_a_place_that_is_missed_writes_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    bench, missed = RigBench("demo.yaml"), iter((0.0, 0.0, 0.003, 0.0, 0.0, 0.0))
    does = bench.person.doing

    def misses(act: Act, text: str) -> Iterator[None]:
        assert isinstance(act, Put)
        goal = list(act.position)
        goal[2] += next(missed)
        return does(Put(act.subject, tuple(goal)), text)

    monkeypatch.setattr(bench.person, "doing", misses)
    outcome = depth.run(bench, tmp_path)
    assert "the places differ by" in str(outcome.problems[0]) and list(tmp_path.iterdir()) == []


def test_other_arms_and_psms_without_an_instrument_are_left_out(tmp_path: Path) -> None:
    assert "comes from its table" in depth.run(RigBench("demo-psm-si.yaml"), tmp_path).notes[0]
    bench = RigBench("demo.yaml")
    bench.person.says = False
    assert "left out" in depth.run(bench, tmp_path).notes[0] and list(tmp_path.iterdir()) == []


def test_stages_for_parts_that_no_arm_has_say_so(tmp_path: Path) -> None:
    psm = RigBench("demo.yaml")
    for outcome in (tables.run(psm, tmp_path), brakes.run(psm, tmp_path),
                    depth.run(RigBench("demo-ecm.yaml"), tmp_path)):
        assert not outcome.figures and outcome.notes[0].startswith("no ")
