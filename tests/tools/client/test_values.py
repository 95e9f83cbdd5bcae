"""What scripts give as matrices and gains, as the arm takes it."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from trocar.procs.arm.efforts import impedance_of
from trocar.procs.kinematics.poses import matrix_from_pose, rotation_from_vector
from trocar.tools.client.values import Gains, Impedance, numbers, pose_numbers, rotation_numbers

VECTORS = hnp.arrays(np.float64, 3, elements=st.floats(-2.0, 2.0))
ROWS = hnp.arrays(np.float64, (4, 4, 3), elements=st.floats(-500.0, 500.0))


def transform(place: Any, turn: Any) -> Any:
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation_from_vector(turn), place
    return pose


@given(VECTORS, VECTORS)
def test_a_matrix_comes_back_from_its_numbers(place: Any, turn: Any) -> None:
    pose = transform(place, turn)
    assert np.allclose(matrix_from_pose(pose_numbers(pose)), pose, atol=1e-12)
    assert np.allclose(rotation_numbers(pose[:3, :3]), pose_numbers(pose)[3:], atol=1e-12)


@pytest.mark.parametrize("wrong", [np.eye(3), np.zeros((4, 4)), np.full((4, 4), np.nan), np.diag((1, 1, -1, 1)), 7])
def test_what_is_no_transform_is_refused(wrong: Any) -> None:
    with pytest.raises(ValueError, match=r"transform|rotation|row"):
        pose_numbers(wrong)


@pytest.mark.parametrize("wrong", [None, "left", {}, [[1.0], [1.0, 2.0]], [[1.0, 2.0]]])
def test_what_are_no_numbers_is_refused(wrong: Any) -> None:
    with pytest.raises(ValueError, match=r"number|float|inhomogeneous"):
        numbers(wrong)


@pytest.mark.parametrize("wrong", [np.eye(4), np.zeros((3, 3)), np.full((3, 3), np.inf), (0, 0, 0, 1)])
def test_what_is_no_rotation_is_refused(wrong: Any) -> None:
    with pytest.raises(ValueError, match=r"rotation|transform"):
        rotation_numbers(wrong)


@given(VECTORS, VECTORS, VECTORS, ROWS)
def test_an_impedance_arrives_as_it_was_meant(place: Any, axes: Any, torques: Any, rows: Any) -> None:
    sides = [Gains(*side) for side in rows]
    sent = Impedance(place, rotation_from_vector(axes), rotation_from_vector(torques), *sides)
    here, speed = transform(place + (0.1, -0.2, 0.3), torques), np.array((0.1, 0.2, 0.3, 0.4, 0.5, 0.6))
    here[:3, :3] = here[:3, :3] @ rotation_from_vector((0.3, -0.2, 0.1))
    wrench = impedance_of(sent.numbers()).wrench(here, speed)
    forces, turns = rotation_from_vector(axes), rotation_from_vector(torques)
    shift = forces.T @ (here[:3, 3] - place)
    assume(np.abs(shift).min() > 1e-6)
    assert np.allclose(forces.T @ wrench[:3], pushed(shift, forces.T @ speed[:3], *sides[:2]), atol=1e-6)
    turned = np.array((0.3, -0.2, 0.1))
    assert np.allclose(turns.T @ wrench[3:], pushed(turned, turns.T @ speed[3:], *sides[2:]), atol=1e-6)


def pushed(error: Any, speed: Any, positive: Gains, negative: Gains) -> Any:
    p, d, bias, deadband = np.where(error > 0, positive.rows(), negative.rows())
    return p * np.sign(error) * np.maximum(0.0, np.abs(error) - np.abs(deadband)) + d * speed + bias


def test_gains_may_be_filled_in_one_after_the_other() -> None:
    wall = Impedance(force_position=[0.1, 0.2, 0.3])
    wall.position_positive.p = (0, 0, -500)
    wall.position_positive.d = (0, 0, -15)
    assert wall.position_negative.p == (0.0, 0.0, 0.0)
    values = wall.numbers()
    assert values.shape == (59,)
    assert values[:3].tolist() == [0.1, 0.2, 0.3]
    assert values[11:].reshape(2, 4, 6)[0, 0].tolist() == [0, 0, -500, 0, 0, 0]
    assert np.count_nonzero(values[11:]) == 2


@pytest.mark.parametrize("wrong", [
    SimpleNamespace(what=Impedance(force_position=[1, 2]), text="force_position has 3 numbers"),
    SimpleNamespace(what=Impedance(force_orientation=np.zeros((3, 3))), text="rotation"),
    SimpleNamespace(what=Impedance(position_negative=Gains(p=[1])), text="p has 3 numbers"),
    SimpleNamespace(what=Impedance(orientation_positive=Gains(deadband=5.0)), text="deadband has 3 numbers"),
])
def test_a_wrong_impedance_says_what_is_wrong(wrong: Any) -> None:
    with pytest.raises(ValueError, match=wrong.text):
        wrong.what.numbers()
