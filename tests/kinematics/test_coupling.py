"""Actuators and joints: round trips, power, and the original's numbers."""

from __future__ import annotations

import json

import numpy as np
import pytest

from tests import stock
from trocar.procs.kinematics.coupling import Coupling, coupling


def test_an_arm_without_instrument_is_not_coupled() -> None:
    plain = coupling(7, stock.chain("PSM"))
    assert plain.is_identity
    np.testing.assert_array_equal(plain.actuator_to_joint @ np.arange(7.0), np.arange(7.0))


def test_an_instrument_couples_the_last_four() -> None:
    tool = stock.tool("LARGE_NEEDLE_DRIVER_400006")
    pair = coupling(7, stock.chain("PSM"), tool)
    joints = pair.actuator_to_joint @ np.array((0.1, 0.2, 0.3, 1.0, 1.0, 1.0, 1.0))
    np.testing.assert_allclose(joints, (0.1, 0.2, 0.3, -1.5632, 1.0186, -0.8306 + 2 * 0.6089, 0.0), atol=1e-15)


@pytest.mark.parametrize("name", ["PSM", "MTML", "MTMR"])
def test_one_matrix_is_the_inverse_of_the_other(name: str) -> None:
    pair = coupling(7, stock.chain(name), stock.tool("LARGE_NEEDLE_DRIVER_400006") if name == "PSM" else None)
    np.testing.assert_allclose(pair.actuator_to_joint @ pair.joint_to_actuator, np.eye(7), atol=1e-12)
    np.testing.assert_allclose(pair.joint_to_actuator @ pair.actuator_to_joint, np.eye(7), atol=1e-12)


@pytest.mark.parametrize("arm", ["MTML", "MTMR"])
def test_original_matrices_of_the_masters_are_met(arm: str) -> None:
    lines = stock.find("golden/kinematics/coupling_mtm.jsonl").read_text().splitlines()
    record = next(r for r in map(json.loads, lines) if r["arm"] == arm)
    pair = coupling(7, stock.chain(arm))
    np.testing.assert_allclose(pair.actuator_to_joint, record["a2j_pos"], atol=1e-15)
    np.testing.assert_allclose(pair.joint_to_actuator, record["j2a_pos"], atol=1e-15)
    np.testing.assert_allclose(pair.joint_to_actuator.T, record["a2j_eff"], atol=1e-15)
    np.testing.assert_allclose(pair.actuator_to_joint.T, record["j2a_eff"], atol=1e-15)


def test_a_singular_coupling_is_refused() -> None:
    with pytest.raises(ValueError, match="invertible"):
        Coupling(np.zeros((2, 2)))
