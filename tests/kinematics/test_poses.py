"""Poses survive every change of form, and what is no pose is refused."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.cases import cases
from trocar.procs.kinematics import poses

number = st.floats(-3.0, 3.0)
vectors = st.tuples(number, number, number)


@given(vectors, vectors)
def test_pose_and_matrix_say_the_same(position: tuple[float, ...], vector: tuple[float, ...]) -> None:
    matrix = np.eye(4)
    matrix[:3, 3] = position
    matrix[:3, :3] = poses.rotation_from_vector(np.array(vector))
    poses.check_matrix(matrix)
    pose = poses.pose_from_matrix(matrix)
    assert pose[6] >= 0
    np.testing.assert_allclose(poses.matrix_from_pose(pose), matrix, atol=1e-14)
    np.testing.assert_allclose(poses.inverse(matrix) @ matrix, np.eye(4), atol=1e-13)


@given(vectors)
def test_rotation_vectors_come_back_within_half_a_turn(vector: tuple[float, ...]) -> None:
    given_vector = np.array(vector)
    angle = float(np.linalg.norm(given_vector))
    rotation = poses.rotation_from_vector(given_vector)
    back = poses.rotation_vector(rotation)
    assert np.linalg.norm(back) <= math.pi + 1e-12
    np.testing.assert_allclose(poses.rotation_from_vector(back), rotation, atol=1e-13)
    if angle < math.pi - 1e-3:
        np.testing.assert_allclose(back, given_vector, atol=1e-12)


@pytest.mark.parametrize("axis", [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (0.6, 0.0, 0.8)])
def test_half_turns_keep_their_axis(axis: tuple[float, ...]) -> None:
    rotation = poses.rotation_from_vector(np.pi * np.array(axis))
    np.testing.assert_allclose(np.abs(poses.rotation_vector(rotation)), np.pi * np.array(axis), atol=1e-7)


def test_a_zero_quaternion_is_refused() -> None:
    with pytest.raises(poses.PoseError, match="length 0"):
        poses.normalised(np.zeros(7))


@cases("bad", [math.nan, math.inf])
@cases("place", range(7))
def test_a_pose_that_is_not_finite_is_refused(bad: float, place: int) -> None:
    pose = np.array((0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0))
    pose[place] = bad
    with pytest.raises(poses.PoseError):
        poses.normalised(pose)


def test_rounded_quaternions_are_brought_to_length_one() -> None:
    pose = poses.normalised(np.array((1.0, 2.0, 3.0, 0.70711, 0.0, 0.0, 0.70711)))
    assert np.linalg.norm(pose[3:]) == pytest.approx(1.0, abs=1e-15)


def test_a_mirror_is_no_transform() -> None:
    with pytest.raises(poses.PoseError, match="rotation"):
        poses.check_matrix(np.diag((1.0, 1.0, -1.0, 1.0)))


def test_a_wrong_matrix_is_told_by_what_is_wrong_with_it() -> None:
    with pytest.raises(poses.PoseError, match=r"a 4×4 matrix, not one of shape \(3, 3\)"):
        poses.check_matrix(np.eye(3))
    with pytest.raises(poses.PoseError, match="must be finite"):
        poses.check_matrix(np.full((4, 4), np.nan))


def test_renormalising_leaves_a_rotation_alone() -> None:
    matrix = np.eye(4)
    matrix[:3, :3] = poses.rotation_from_vector(np.array((0.3, -0.2, 1.0)))
    np.testing.assert_allclose(poses.renormalised(matrix), matrix, atol=1e-15)
