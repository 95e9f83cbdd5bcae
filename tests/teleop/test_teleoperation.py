"""The mapping of a master to a PSM: golden numbers of dVRK 2.4, and what must hold for any pose."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.examples import examples
from trocar.procs.kinematics.poses import angle_between, matrix_from_pose, pose_from_matrix, rotation_from_vector
from trocar.procs.teleop.teleoperation import JawMapping, PoseMapping, Presence, roll_between

DEGREE = math.pi / 180
NEAR = st.floats(-0.3, 0.3)
VECTOR = st.tuples(NEAR, NEAR, NEAR)
TURN = st.tuples(*[st.floats(-1.7, 1.7)] * 3)


def pose(place: tuple[float, ...], turn: tuple[float, ...] = (0.0, 0.0, 0.0)) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation_from_vector(np.array(turn)), place
    return pose_from_matrix(matrix)


def rotation(of: np.ndarray) -> np.ndarray:
    return matrix_from_pose(of)[:3, :3]


poses = st.builds(pose, VECTOR, TURN)


def test_a_fifth_of_the_master_s_way() -> None:
    follow = PoseMapping(0.2)
    follow.begin(pose((0.1, 0.2, 0.3), (0.1, 0.2, 0.3)), pose((0.0, 0.0, -0.1), (1.0, 0.0, 0.5)))
    goal = follow.step(pose((0.11, 0.195, 0.32), (0.1, 0.2, 0.3)))
    assert goal[:3] == pytest.approx((0.002, -0.001, -0.096), abs=1e-12)


@given(poses, poses, poses, st.floats(0.01, 3.0), st.booleans(), st.booleans())
def test_changes_while_following_move_nothing(
    master: np.ndarray, slave: np.ndarray, later: np.ndarray, scale: float, turns: bool, translation: bool
) -> None:
    follow = PoseMapping(0.2)
    follow.begin(master, slave)
    before = matrix_from_pose(follow.step(later))
    follow.scale, follow.rotation_locked, follow.translation_locked = scale, turns, translation
    follow.rebase(later)
    np.testing.assert_allclose(matrix_from_pose(follow.step(later)), before, atol=1e-9)


@given(poses, poses, poses, poses, poses)
@examples(30)
def test_a_base_that_moves_is_made_up_for(
    master: np.ndarray, slave: np.ndarray, later: np.ndarray, base: np.ndarray, moved: np.ndarray
) -> None:
    follow, plain = PoseMapping(0.2), PoseMapping(0.2)
    follow.begin(master, slave, base)
    plain.begin(master, slave)
    seen = matrix_from_pose(moved) @ matrix_from_pose(follow.step(later, moved))
    np.testing.assert_allclose(seen, matrix_from_pose(base) @ matrix_from_pose(plain.step(later)), atol=1e-9)
    before = matrix_from_pose(follow.goal)
    follow.rebase(later, moved)
    np.testing.assert_allclose(matrix_from_pose(follow.step(later, moved)), before, atol=1e-9)
    offset = rotation(np.array((0.0, 0.0, 0.0, *follow.offset)))
    np.testing.assert_allclose(rotation(later) @ offset, rotation(follow.goal), atol=1e-9)


@given(poses, TURN)
def test_angles_are_those_of_the_rotation(start: np.ndarray, turn: tuple[float, ...]) -> None:
    matrix = matrix_from_pose(start)
    matrix[:3, :3] = matrix[:3, :3] @ rotation_from_vector(np.array(turn))
    length = math.sqrt(sum(x * x for x in turn))
    assert angle_between(start, pose_from_matrix(matrix)) == pytest.approx(min(length, 2 * math.pi - length), abs=1e-6)
    assert angle_between(start, start) == pytest.approx(0.0, abs=1e-6)


def test_roll_is_the_angle_of_the_y_axes() -> None:
    assert roll_between(pose((0, 0, 0)), pose((0, 0, 0), (0.0, 0.0, 0.3))) == pytest.approx(0.3)
    assert roll_between(pose((0, 0, 0)), pose((0, 0, 0), (0.0, 0.3, 0.0))) == pytest.approx(0.0)


def test_a_threshold_of_zero_needs_nobody() -> None:
    assert Presence(0.0, 4 * DEGREE).look(0.0, 1.0)


def test_forgotten_presence_must_be_shown_again() -> None:
    presence = Presence(40 * DEGREE, 4 * DEGREE)
    presence.look(0.0, 1.0)
    assert presence.look(1.0, 1.0)
    presence.forget()
    assert not presence.look(1.0, 1.0)
    assert not presence.look(math.nan, math.nan)


def lnd() -> JawMapping:
    """A large needle driver's jaw, 80° wide."""
    jaw = JawMapping(0.0, 60 * DEGREE, 4 * math.pi, 0.2 * math.pi)
    jaw.use(-40 * DEGREE, 80 * DEGREE)
    return jaw


def test_the_gripper_s_range_is_stretched_to_the_jaw_s() -> None:
    jaw = lnd()
    assert jaw.jaw_of(60 * DEGREE) == pytest.approx(80 * DEGREE)
    assert jaw.jaw_of(-10 * DEGREE) == pytest.approx(-13.3333 * DEGREE, abs=1e-5)


def test_closing_after_the_clutch_takes_as_long_as_in_dvrk() -> None:
    jaw, period = lnd(), 0.0001
    jaw.begin(80 * DEGREE)
    cycles = 0
    while jaw.step(0.0, period) > 1e-9:
        cycles += 1
    assert cycles * period == pytest.approx(58 / 36 + 2 / 720, abs=0.001)


def test_a_closed_jaw_leaves_no_way_to_come_back() -> None:
    jaw = lnd()
    jaw.begin(0.0)
    for _ in range(100):
        closed = jaw.step(-60 * DEGREE, 0.02)
    assert closed == pytest.approx(-40 * DEGREE)
    assert jaw.ghost == pytest.approx(-30 * DEGREE)


def test_without_a_gripper_the_jaw_stands_half_open() -> None:
    jaw = lnd()
    jaw.begin(0.0)
    assert jaw.step(math.nan, 0.001) < 0.1 * DEGREE  # without a jump
    for _ in range(100):
        opened = jaw.step(math.nan, 0.02)
    assert opened == pytest.approx(45 * DEGREE)
