"""Actions change goals by no more than the arm's own limits allow, and setpoints lie evenly between goals."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from tests.rl.playing import psm
from trocar.procs.kinematics.poses import matrix_from_pose, rotation_vector
from trocar.procs.rl.model import ROOM_M, ArmModel
from trocar.procs.rl.steering import CARTESIAN, CONTROLS, JOINT, Interpolator, Steering

SPEED, PERIOD_S = 0.5, 0.05


@pytest.fixture(scope="module")
def model() -> ArmModel:
    return psm()


def steering(model: ArmModel, control: str) -> Steering:
    made = Steering(model, control, SPEED, PERIOD_S)
    made.begin(model.centre, 0.0)
    return made


@pytest.mark.parametrize("control", CONTROLS)
def test_no_action_asks_for_more_than_a_joint_may_do(model: ArmModel, control: str) -> None:
    goal, random = steering(model, control), np.random.default_rng(5)
    most = model.v_max * SPEED * PERIOD_S * (1.0 + 1e-9)
    for _ in range(400):
        before, jaw = goal.joints.copy(), goal.jaw
        goal.take(random.choice((-9.0, -1.0, -0.3, 0.4, 1.0, 9.0), goal.size))
        assert (np.abs(goal.joints - before) <= most[: model.count]).all() and abs(goal.jaw - jaw) <= most[-1]
        assert (goal.joints >= model.space.lower[:-1]).all() and (goal.joints <= model.space.upper[:-1]).all()
        assert model.space.lower[-1] <= goal.jaw <= model.space.upper[-1]
        np.testing.assert_allclose(goal.tip, model.local_tip(goal.joints), atol=1e-9)


@pytest.mark.parametrize("control", CONTROLS)
def test_the_tip_stays_in_its_room_and_comes_back(model: ArmModel, control: str) -> None:
    goal = steering(model, control)
    deeper = np.zeros(goal.size)
    deeper[2] = -1.0 if control == CARTESIAN else 1.0
    for _ in range(100):
        goal.take(deeper)
    assert ROOM_M - 0.01 < np.linalg.norm(goal.tip[:3, 3] - model.middle) <= ROOM_M
    outside = goal.tip[:3, 3].copy()
    goal.take(-deeper)
    assert np.linalg.norm(goal.tip[:3, 3] - model.middle) < np.linalg.norm(outside - model.middle)


def test_cartesian_actions_go_along_the_axes_in_which_poses_are_told(model: ArmModel) -> None:
    turned = np.eye(4)
    turned[:3, :3] = ((0.0, -1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    other = psm()
    other.base = turned
    for each in (model, other):
        goal = steering(each, CARTESIAN)
        before = goal.pose()
        goal.take(np.array((0.5, 0, 0, 0, 0, 0, 0)))
        np.testing.assert_allclose(goal.pose()[:3, 3] - before[:3, 3], (0.1 * SPEED * PERIOD_S, 0, 0), atol=1e-9)
        goal.take(np.array((1.0, 0, 0, 0, 0, 0, 0)))  # more than the yaw may do: less of it, as straight
        shift = goal.pose()[:3, 3] - before[:3, 3]
        assert 0.008 * SPEED < shift[0] < 0.015 * SPEED and np.abs(shift[1:]).max() < 1e-9
        np.testing.assert_allclose(goal.pose()[:3, :3], before[:3, :3], atol=1e-9)
        before = goal.pose()
        goal.take(np.array((0, 0, 0, 0, 0, 0.1, 0)))
        np.testing.assert_allclose(rotation_vector(goal.pose()[:3, :3] @ before[:3, :3].T)[:2], 0.0, atol=1e-9)


@pytest.mark.parametrize("control", CONTROLS)
def test_setpoints_divide_the_way_evenly_and_end_at_the_goal(model: ArmModel, control: str) -> None:
    goal = steering(model, control)
    line = Interpolator(goal, 5)
    poses = [goal.pose()]
    before, jaw = goal.joints.copy(), goal.jaw
    goal.take(np.array((0.3, -0.2, 0.5, 0.4, -0.6, 0.2, 0.8)))
    found = list(line.setpoints())
    assert [[command for command, _ in each] for each in found] == [
        ["servo_jp" if control == JOINT else "servo_cp", "jaw/servo_jp"]] * 5
    np.testing.assert_allclose([each[1][1][0] for each in found], jaw + (goal.jaw - jaw) * np.arange(1, 6) / 5)
    if control == JOINT:
        joints = np.array([each[0][1] for each in found])
        np.testing.assert_allclose(joints, before + (goal.joints - before) * np.arange(1, 6)[:, None] / 5, atol=1e-12)
        assert (joints[-1] == goal.joints).all()
        return
    poses += [matrix_from_pose(each[0][1]) for each in found]
    np.testing.assert_allclose(poses[-1], goal.pose(), atol=1e-9)
    steps = [np.append(b[:3, 3] - a[:3, 3], rotation_vector(a[:3, :3].T @ b[:3, :3]))
             for a, b in itertools.pairwise(poses)]
    np.testing.assert_allclose(steps, np.tile(steps[0], (5, 1)), atol=1e-9)


def test_the_next_line_begins_where_the_last_one_ended(model: ArmModel) -> None:
    goal = steering(model, JOINT)
    line = Interpolator(goal, 2)
    goal.take(np.full(7, 0.5))
    last = list(line.setpoints())[-1][0][1]
    goal.take(np.zeros(7))
    assert all((each[0][1] == last).all() for each in line.setpoints())


def test_starts_are_the_same_each_time_and_the_first_is_the_centre(model: ArmModel) -> None:
    one, other = model.starts(), psm().starts()
    assert all((a.joints == b.joints).all() and a.jaw == b.jaw for a, b in zip(one, other, strict=True))
    assert (one[0].joints == model.centre).all()
    assert all(np.linalg.norm(model.tip(each.joints)[:3, 3] - model.middle) < ROOM_M for each in one)
