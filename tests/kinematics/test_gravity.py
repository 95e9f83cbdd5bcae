"""Holding efforts against the original routines, and against the change of potential energy."""

from __future__ import annotations

import json
import math
from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests import stock
from tests.cases import cases
from tests.examples import examples
from trocar.procs.document.arms import MasterGravityParameters
from trocar.procs.kinematics.gravity import Gravity, up_of
from trocar.procs.kinematics.master_gravity import MasterGravity

FILES = {"gravity_PSM_Si": ("PSM_Si_physical", None), "gravity_ECM_Classic_SD": ("ECM", 1.5)}


@pytest.mark.parametrize("name", FILES)
def test_the_original_routines_hold_an_arm_with_the_same_efforts(name: str) -> None:
    chain_name, camera = FILES[name]
    chain, records = stock.chain(chain_name), 0
    for line in stock.find(f"golden/kinematics/{name}.jsonl").read_text().splitlines()[1:]:
        record = json.loads(line)
        gravity = Gravity(chain, len(record["q"]), up_of(record["pitch"]), camera)
        np.testing.assert_allclose(gravity.effort(np.array(record["q"])), record["effort"], atol=1e-8, rtol=0)
        records += 1
    assert records == 200


@cases(("chain", "camera", "pitch", "q", "expected"), [
    ("PSM_Si_physical", None, 0.0, (0.2, -0.3, 0.15), (-1.65093, 6.21104, -5.85086)),
    ("PSM_Si_physical", None, 0.0, (0.0, 0.0, 0.12), (-0.79959, 3.98253, -6.24897)),
    ("PSM_Si_physical", None, -45.0, (0.2, -0.3, 0.15), (-1.16738, -0.56542, -5.44301)),
    ("ECM", 1.5, 0.0, (0.2, -0.3, 0.15, 0.4), (-0.9278, 1.41582, -13.77753, 0.0)),
    ("ECM", 1.5, -45.0, (0.2, -0.3, 0.15, 0.4), (-0.65605, -2.30105, -12.81713, 0.0)),
    ("ECM_Si_physical", 1.8, 0.0, (0.2, -0.3, 0.15, 0.4), (-2.7534, 10.11702, -16.53305, 0.0)),
])
def test_an_independent_model_gives_the_same_efforts(
        chain: str, camera: float | None, pitch: float, q: tuple[float, ...], expected: tuple[float, ...]) -> None:
    joints = max(len(q), 4)
    gravity = Gravity(stock.chain(chain), joints, up_of(math.radians(pitch)), camera)
    found = gravity.effort(np.array([*q, 0.0][:joints]))
    np.testing.assert_allclose(found[: len(expected)], expected, atol=2e-5, rtol=0)


@examples(30)
@given(st.lists(st.floats(-0.8, 0.8), min_size=3, max_size=3), st.floats(-1.5, 1.5))
def test_efforts_turn_with_the_mounting(parts: list[float], pitch: float) -> None:
    chain, q = stock.chain("PSM_Si_physical"), np.array([*parts, 0.0, 0.0, 0.0])
    flat = Gravity(chain, 6, up_of(0.0)).effort(q).copy()
    upright = Gravity(chain, 6, up_of(0.5 * math.pi)).effort(q).copy()
    mixed = Gravity(chain, 6, up_of(pitch)).effort(q)
    np.testing.assert_allclose(mixed, math.cos(pitch) * flat + math.sin(pitch) * upright, atol=1e-9)
    assert not mixed[3:].any()  # the wrist bears nothing


@pytest.mark.parametrize(("chain", "joints", "camera", "reported"), [
    ("PSM", 6, None, "3 links do not belong to an arm of 6 joints"),
    ("PSM_Si_physical", 6, 1.0, "no link of 7 carries an endoscope"),
])
def test_chains_that_do_not_belong_are_refused(chain: str, joints: int, camera: float | None, reported: str) -> None:
    with pytest.raises(ValueError, match=reported):
        Gravity(stock.chain(chain), joints, up_of(0.0), camera)


@cache
def parameters(file: str) -> MasterGravityParameters:
    keys = json.loads(stock.find(f"dvrk-site/{file}").read_text())["GC_controller"]
    return MasterGravityParameters(
        positive=tuple(keys["gc_dynamic_params_pos"]), negative=tuple(keys["gc_dynamic_params_neg"]),
        lower=tuple(keys["safe_lower_torque_limit"]), upper=tuple(keys["safe_upper_torque_limit"]),
        dead_band=tuple(keys["db_vel_vec"]), saturation=tuple(keys["sat_vec_vec"]),
        friction=tuple(keys["fric_comp_ratio_vec"]))


def test_the_original_routines_hold_masters_with_the_same_efforts() -> None:
    records = 0
    for line in stock.find("golden/kinematics/gravity_MTM.jsonl").read_text().splitlines():
        record = json.loads(line)
        gravity = MasterGravity(parameters(record["file"]))
        found = gravity.effort(np.array(record["q"]), np.array(record["qd"]))
        np.testing.assert_allclose(found, record["effort"], atol=1e-8, rtol=0)
        records += 1
    assert records == 100


def test_a_master_at_rest_is_held_as_an_independent_model_holds_it() -> None:
    gravity = MasterGravity(parameters("jhu-dVRK/gc-MTML-22723.json"))
    found = gravity.effort(np.array((0.1, 0.2, 0.3, -0.4, 0.5, -0.6, 0.7)), np.zeros(7))
    np.testing.assert_allclose(found, (-0.04732, 0.5073, 0.21282, 0.05798, 0.04149, -0.03281, 0.0), atol=1e-5)
