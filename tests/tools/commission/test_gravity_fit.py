"""Gravity of masters with random hidden parameters, from the efforts that would hold them."""

from __future__ import annotations

import dataclasses
import json
from types import SimpleNamespace

import numpy as np
import pytest

from tests import stock
from trocar.procs.document.arms import MASS_TERMS, MasterGravityParameters
from trocar.tools.commission import gravity, gravity_fit
from trocar.tools.commission.gravity import FIELDS
from trocar.tools.commission.gravity_fit import HeldPoses

SEEDS = range(50)
NOISE_NM = (0.01, 0.01, 0.01, 0.005, 0.001, 0.001)
WITHIN_NM = (0.02, 0.02, 0.02, 0.01, 0.003, 0.003)
"""Tolerance of the holding efforts, rms over the workspace in which they were measured."""


@pytest.fixture(scope="module")
def usual() -> MasterGravityParameters:
    keys = json.loads(stock.find("dvrk-site/jhu-dVRK/gc-MTML-22723.json").read_text())["GC_controller"]
    return MasterGravityParameters(**{field: tuple(keys[key]) for key, field in FIELDS.items()})


def hidden(usual: MasterGravityParameters, seed: int) -> MasterGravityParameters:
    """Another master: every parameter up to twice or half as large, masses alike in both directions."""
    factor = np.random.default_rng(seed).uniform(0.5, 2.0, (2, len(usual.positive)))
    factor[1, :MASS_TERMS] = factor[0, :MASS_TERMS]
    up, down = factor * (usual.positive, usual.negative)
    return dataclasses.replace(usual, positive=tuple(up.tolist()), negative=tuple(down.tolist()))


def poses(truth: MasterGravityParameters, seed: int) -> HeldPoses:
    """As the stage measures them, with noise."""
    none = np.zeros(7)
    rows = [(sweep.joint, up, turn, q, none)
            for sweep in gravity_fit.sweeps(seed % 2 == 0, np.full(7, -9.0), np.full(7, 9.0)) for up in (True, False)
            for turn, q in enumerate(sweep.positions if up else sweep.positions[::-1]) if turn]
    plan = gravity_fit.held(rows)
    effort = gravity_fit.predicted(truth, plan)
    effort += np.random.default_rng(seed).normal(0.0, NOISE_NM, effort.shape)
    return dataclasses.replace(plan, effort=np.hstack([effort, np.zeros((len(rows), 1))]))


@pytest.mark.parametrize("seed", SEEDS)
def test_hidden_parameters_are_found_as_efforts(usual: MasterGravityParameters, seed: int) -> None:
    truth = hidden(usual, seed)
    seen = poses(truth, seed)
    first, rest = gravity_fit.halves(seen)
    assert (gravity_fit.errors(gravity_fit.fitted(first), rest) <= gravity_fit.allowed(rest)).all()
    made = gravity_fit.fitted(seen)
    exact = dataclasses.replace(seen, effort=np.hstack([gravity_fit.predicted(truth, seen), np.zeros((336, 1))]))
    assert (gravity_fit.errors(made, exact) <= WITHIN_NM).all()
    assert made.positive[:MASS_TERMS] == made.negative[:MASS_TERMS] and made.lower[6] == made.upper[6] == 0.0


@pytest.mark.parametrize("seed", SEEDS)
def test_efforts_that_no_weight_explains_are_refused(usual: MasterGravityParameters, seed: int) -> None:
    dice = np.random.default_rng(1000 + seed)
    seen, joint = poses(hidden(usual, seed), seed), int(dice.integers(6))
    pulled = seen.effort.copy()  # a hand pulls at each pose in another way
    span = 3.0 * np.abs(pulled[seen.joint == joint, joint]).max() + gravity_fit.SMALL_NM[joint]
    pulled[:, joint] += dice.uniform(-span, span, len(pulled))
    first, rest = gravity_fit.halves(dataclasses.replace(seen, effort=pulled))
    assert gravity_fit.errors(gravity_fit.fitted(first), rest)[joint] > gravity_fit.allowed(rest)[joint]


def test_sweeps_stay_within_the_limits_of_the_arm_and_are_mirrored() -> None:
    low, high = np.radians([-40, -14, -20, -180, -90, -40, -1]), np.radians([40, 25, 30, 100, 170, 40, 1])
    for left in (True, False):
        for sweep in gravity_fit.sweeps(left, low, high):
            assert ((low <= sweep.positions) & (sweep.positions <= high)).all()
            assert (np.diff(sweep.positions[:, sweep.joint]) >= 0.0).all()
    (left_out,), (right_out,) = ([sweep.positions[:, 0] for sweep in gravity_fit.sweeps(side, -np.full(7, 9.0),
                                                                                        np.full(7, 9.0))
                                  if sweep.joint == 0] for side in (True, False))
    assert right_out == pytest.approx(-left_out[::-1])


def test_a_countdown_shows_how_many_steps_are_left_and_for_how_long() -> None:
    lines: list[str] = []
    bench = SimpleNamespace(person=SimpleNamespace(progress=lines.append))
    count = gravity.Countdown(bench, "MTML: pose", 3)  # type: ignore[arg-type]
    for _ in range(3):
        count.next()
    assert lines[0] == "MTML: pose 1 of 3"
    assert [line.partition(", about ")[0] for line in lines[1:]] == ["MTML: pose 2 of 3", "MTML: pose 3 of 3"]
    assert all(line.endswith(" left") for line in lines[1:])
