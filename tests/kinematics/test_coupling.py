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


@pytest.mark.parametrize("name", ["PSM", "MTML"])
def test_power_is_the_same_on_both_sides(name: str) -> None:
    tool = stock.tool("LARGE_NEEDLE_DRIVER_400006") if name == "PSM" else None
    pair = coupling(7, stock.chain(name), tool)
    rng = np.random.default_rng(3)
    velocity, effort = rng.normal(size=(2, 7))
    joint_velocity, joint_effort = (pair.actuator_to_joint @ velocity), pair.joint_to_actuator.T @ effort
    assert joint_velocity @ joint_effort == pytest.approx(velocity @ effort)
    np.testing.assert_allclose(pair.joint_to_actuator @ joint_velocity, velocity, atol=1e-14)
    np.testing.assert_allclose(pair.actuator_to_joint.T @ joint_effort, effort, atol=1e-14)


@pytest.mark.parametrize("arm", ["MTML", "MTMR"])
def test_power_of_the_masters_is_the_same_to_the_last_digits(arm: str) -> None:
    pair = coupling(7, stock.chain(arm))
    for one, other in ((pair.actuator_to_joint, pair.joint_to_actuator), (pair.joint_to_actuator,
                                                                          pair.actuator_to_joint)):
        np.testing.assert_allclose(one @ other, np.eye(7), atol=1e-12)
    rng = np.random.default_rng(4)
    for velocity, effort in rng.uniform(-1.0, 1.0, (1000, 2, 7)):
        power = (pair.actuator_to_joint @ velocity) @ (pair.joint_to_actuator.T @ effort)
        assert power == pytest.approx(velocity @ effort, rel=0.0, abs=1e-12)


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
