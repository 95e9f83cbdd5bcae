"""Trajectories: how long they take, that they stay within limits, end together and can be changed under way."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.cases import cases
from tests.examples import examples
from trocar.procs.kinematics.trajectory import PlanError, Trajectory
from trocar.procs.tables.arm_types import ARM_TYPES


def plan(arm: str, goal: np.ndarray, ratio: float = 1.0, velocity: np.ndarray | None = None) -> Trajectory:
    n = len(goal)
    trajectory = Trajectory(n)
    v_max, a_max = ARM_TYPES[arm].moves.scaled(ratio, ratio)
    start = np.zeros(n) if velocity is None else velocity
    assert trajectory.start(np.zeros(n), start, goal, v_max, a_max, 10.0) is None
    return trajectory


@cases(
    ("arm", "joint", "distance", "durations"),
    [
        ("PSM", 2, 0.12, (1.5492, 2.2, 7.0)),
        ("PSM", 0, math.radians(10), (0.6667, 0.9428, 2.1111)),
        ("PSM", 0, math.radians(90), (2.0, 3.0, 11.0)),
        ("PSM", 0, math.radians(120), (2.3333, 3.6667, 14.3333)),
        ("PSM", 3, math.radians(342), (1.3784,)),
        ("ECM", 2, 0.12, (3.0, 5.0, 21.0)),
        ("ECM", 0, math.radians(30), (1.3333,)),
        ("MTM", 0, math.radians(45), (2.0, 2.8284, 7.0)),
        ("MTM", 6, math.radians(480), (2.3333,)),
    ],
)
def test_moves_from_rest_last_as_long_as_published(
    arm: str, joint: int, distance: float, durations: tuple[float, ...]
) -> None:
    for ratio, duration in zip((1.0, 0.5, 0.1), durations, strict=False):
        goal = np.zeros(len(ARM_TYPES[arm].moves.velocity))
        goal[joint] = distance
        assert plan(arm, goal, ratio).duration == pytest.approx(duration, abs=1e-4)


@cases(
    ("distance", "velocity", "v_max", "a_max", "duration", "halfway", "speed"),
    [
        ((0.5,), (1.0,), (1.0,), (2.0,), 0.75, (0.359375,), (0.75,)),
        ((0.5,), (-1.0,), (1.0,), (2.0,), 1.75, (-0.109375,), (0.75,)),
        ((0.1,), (1.0,), (1.0,), (2.0,), 1.047722558, (0.249430639,), (-0.047722558,)),
        ((0.0,), (0.7,), (1.0,), (2.0,), 0.844974747, (0.117245581,), (-0.144974747,)),
        ((2.0,), (2.5,), (1.0,), (2.0,), 1.6875, (1.40625,), (1.0,)),
        ((0.2,), (-3.0,), (1.0,), (4.0,), 2.325, (-0.8375,), (1.0,)),
        ((1.0, 0.3), (0.5, 0.9), (1.0, 1.0), (2.0, 2.0), 1.3125, (0.59375, 0.299926758), (1.0, 0.0140625)),
        ((1.0, -0.3), (0.5, -0.9), (1.0, 1.0), (2.0, 2.0), 1.3125, (0.59375, -0.229009924), (1.0, -0.113043478)),
        ((1.0, 0.05), (0.0, 0.6), (1.0, 1.0), (1.0, 1.0), 2.0, (0.5, 0.145), (1.0, -0.1)),
        ((1.0, 0.25, 0.0), (0.0, 0.5, 0.0), (0.5, 1.0, 1.0), (1.0,) * 3, 2.5, (0.5, 0.25, 0.0), (0.5, 0.0, 0.0)),
    ],
)
def test_moves_from_a_moving_start_are_those_of_ruckig(
    distance: tuple[float, ...], velocity: tuple[float, ...], v_max: tuple[float, ...], a_max: tuple[float, ...],
    duration: float, halfway: tuple[float, ...], speed: tuple[float, ...]
) -> None:
    trajectory, n = Trajectory(len(distance)), len(distance)
    given = np.zeros(n), np.array(velocity), np.array(distance), np.array(v_max), np.array(a_max)
    assert trajectory.start(*given, 0.0) is None
    assert trajectory.duration == pytest.approx(duration, abs=1e-9)
    position, now = np.zeros((2, n))
    trajectory.evaluate(trajectory.duration / 2.0, position, now)
    np.testing.assert_allclose(position, halfway, atol=1e-9)
    np.testing.assert_allclose(now, speed, atol=1e-9)


@pytest.mark.slow
def test_numbers_at_the_end_of_range_raise_nothing() -> None:
    numbers = (5e-324, 1e-100, 1.0, 1e50, 1e100)
    position, velocity = np.zeros((2, 2))
    for case in itertools.product((1.0, -1.0), (0.0, 1.0), numbers, numbers, numbers, numbers):
        to, way, far, fast, v_max, a_max = case
        given = np.array((to * far, 0.1)), np.array((way * fast, 0.0)), np.array((v_max, 1.0)), np.array((a_max, 1.0))
        for jerk_time_s in (0.0, 0.1):
            trajectory = Trajectory(2, jerk_time_s)
            error = trajectory.start(np.zeros(2), given[1], given[0], *given[2:], 0.0)
            assert error in {None, PlanError.NO_SOLUTION}
            if error is None:
                assert not trajectory.evaluate(0.3 * trajectory.duration, position, velocity)
                assert np.isfinite((position, velocity)).all()
                assert trajectory.evaluate(trajectory.duration, position, velocity)
                assert (position == given[0]).all()


def test_all_joints_go_straight_and_end_together() -> None:
    goal = np.array((0.8, -0.2, 0.05, 1.0, -2.0, 0.3, 0.1))
    trajectory = plan("PSM", goal)
    position, velocity = np.zeros(7), np.zeros(7)
    for share in np.linspace(0.05, 0.95, 19):
        assert not trajectory.evaluate(10.0 + share * trajectory.duration, position, velocity)
        np.testing.assert_allclose(position / goal, position[0] / goal[0], atol=1e-9)
    assert trajectory.evaluate(10.0 + trajectory.duration, position, velocity)
    np.testing.assert_array_equal(position, goal)
    np.testing.assert_array_equal(velocity, 0.0)
    assert not trajectory.active


coordinates = st.lists(st.floats(-1.0, 1.0), min_size=7, max_size=7)


@pytest.mark.slow
@examples(25)
@given(coordinates, coordinates)
def test_a_moving_start_is_continued_within_limits(goal: list[float], speed: list[float]) -> None:
    v_max, a_max = ARM_TYPES["PSM"].moves.scaled()
    velocity = np.array(speed) * v_max
    trajectory = plan("PSM", np.array(goal), velocity=velocity)
    position, now, last, step = np.zeros(7), velocity.copy(), velocity.copy(), 4e-3
    trajectory.evaluate(10.0, position, now)
    np.testing.assert_allclose(position, 0.0, atol=1e-9)
    np.testing.assert_allclose(now, velocity, atol=1e-9)
    for k in range(1, int(trajectory.duration / step) + 2):
        done = trajectory.evaluate(10.0 + k * step, position, now)
        assert (np.abs(now) <= v_max * (1 + 1e-6)).all()
        assert (np.abs(now - last) <= a_max * step * (1 + 1e-6) + 1e-9).all()
        last[...] = now
    assert done


def test_a_new_goal_in_mid_flight_keeps_position_and_velocity() -> None:
    trajectory = plan("PSM", np.full(7, 0.2))
    v_max, a_max = ARM_TYPES["PSM"].moves.scaled()
    position, velocity, after, speed = (np.zeros(7) for _ in range(4))
    trajectory.evaluate(10.3, position, velocity)
    assert trajectory.start(position, velocity, np.zeros(7), v_max, a_max, 10.3) is None
    trajectory.evaluate(10.3, after, speed)
    np.testing.assert_allclose(after, position, atol=1e-12)
    np.testing.assert_allclose(speed, velocity, atol=1e-12)
    assert trajectory.evaluate(10.3 + trajectory.duration, after, speed)
    np.testing.assert_array_equal(after, 0.0)


def test_a_start_above_a_lowered_limit_is_braked() -> None:
    v_max, a_max = ARM_TYPES["PSM"].moves.scaled(0.1)
    trajectory = Trajectory(7)
    assert trajectory.start(np.zeros(7), 5 * v_max, 10 * v_max, v_max, a_max, 0.0) is None
    position, velocity = np.zeros(7), np.zeros(7)
    trajectory.evaluate(0.9 * trajectory.duration, position, velocity)
    assert (np.abs(velocity) <= v_max * (1 + 1e-9)).all()
    assert trajectory.evaluate(trajectory.duration, position, velocity)


def test_a_goal_already_reached_is_done_at_once() -> None:
    trajectory = plan("PSM", np.zeros(7))
    assert trajectory.duration == 0.0
    assert trajectory.evaluate(10.0, np.zeros(7), np.zeros(7))


def test_time_before_the_start_gives_the_start() -> None:
    trajectory = plan("PSM", np.full(7, 0.1))
    position, velocity = np.ones(7), np.ones(7)
    assert not trajectory.evaluate(9.0, position, velocity)
    np.testing.assert_allclose(position, 0.0, atol=1e-12)


def test_an_impossible_plan_is_reported_and_changes_nothing() -> None:
    trajectory = plan("PSM", np.full(7, 0.1))
    v_max, a_max = ARM_TYPES["PSM"].moves.scaled()
    zero, duration = np.zeros(7), trajectory.duration
    nan = np.full(7, math.nan)
    assert trajectory.start(zero, zero, nan, v_max, a_max, 11.0) is PlanError.NOT_FINITE
    assert trajectory.start(zero, zero, zero, zero, a_max, 11.0) is PlanError.LIMITS
    assert trajectory.start(zero, zero, zero, v_max, -a_max, 11.0) is PlanError.LIMITS
    assert trajectory.start(zero[:6], zero, zero, v_max, a_max, 11.0) is PlanError.SIZE
    assert trajectory.active
    assert trajectory.duration == duration
    np.testing.assert_array_equal(trajectory.goal, np.full(7, 0.1))


def test_with_a_jerk_limit_acceleration_comes_up_in_the_time_given() -> None:
    trajectory = Trajectory(1, jerk_time_s=0.2)
    v_max, a_max = np.array([1.0]), np.array([2.0])
    assert trajectory.start(np.zeros(1), np.zeros(1), np.array([2.0]), v_max, a_max, 0.0) is None
    assert trajectory.duration == pytest.approx(2.0 / 1.0 + 1.0 / 2.0 + 0.2, abs=1e-6)
    assert jerks(trajectory).max() <= 2.0 / 0.2 * 1.01


def test_a_new_goal_in_mid_flight_keeps_the_jerk_limit() -> None:
    trajectory = Trajectory(1, jerk_time_s=0.2)
    limits = np.array([1.0]), np.array([2.0])
    position, velocity = np.zeros(1), np.zeros(1)
    assert trajectory.start(position, velocity, np.array([2.0]), *limits, 0.0) is None
    trajectory.evaluate(0.3, position, velocity)
    before = (velocity[0] - velocity_at(trajectory, 0.299)) / 1e-3
    assert trajectory.start(position, velocity, np.array([-1.0]), *limits, 0.3) is None
    assert (velocity_at(trajectory, 0.301) - velocity[0]) / 1e-3 == pytest.approx(before, abs=0.05)
    assert jerks(trajectory, 0.3).max() <= 10.0 * 1.01
    trajectory.forget()
    assert trajectory.start(np.zeros(1), np.zeros(1), np.array([1.0]), *limits, 5.0) is None
    assert velocity_at(trajectory, 5.001) < 1e-4, "from rest again"


@pytest.mark.slow
@examples(10)
@given(st.integers(0, 2**32 - 1))
def test_goals_in_mid_flight_keep_all_limits_with_a_jerk_limit(seed: int) -> None:
    random, step, jerk_time_s = np.random.default_rng(seed), 2e-3, 0.2
    v_max, a_max = 10.0 ** random.uniform(-1.0, 1.0, 3), 10.0 ** random.uniform(-1.0, 1.0, 3)
    trajectory = Trajectory(3, jerk_time_s)
    position, velocity, acceleration, last = np.zeros((4, 3))
    for _ in range(4):
        goal = random.normal(size=3) * 10.0 ** random.uniform(-3.0, 1.0)
        assert trajectory.start(position, velocity, goal, v_max, a_max, 0.0) is None
        steps = int(trajectory.duration / step)
        for k in range(1, min(steps, int(random.integers(2, 400)))):
            last[...] = velocity
            trajectory.evaluate(k * step, position, velocity)
            now = (velocity - last) / step
            assert (np.abs(velocity) <= v_max * (1 + 1e-6)).all()
            assert (np.abs(now) <= a_max * (1 + 1e-6)).all()
            assert (np.abs(now - acceleration) <= a_max / jerk_time_s * step * 1.01).all()
            acceleration = now


@cases("jerk_time_s", [0.0, 0.05, 0.2])
@cases("every_s", [0.002, 0.01, 0.1, 0.3])
def test_the_same_goal_again_and_again_neither_delays_nor_overshoots(jerk_time_s: float, every_s: float) -> None:
    trajectory, limits = Trajectory(1, jerk_time_s), (np.full(1, np.pi / 2.0),) * 2
    position, velocity, goal, now_s = np.zeros(1), np.zeros(1), np.ones(1), 0.0
    assert trajectory.start(position, velocity, goal, *limits, 0.0) is None
    end_s = trajectory.duration
    while now_s < end_s - every_s:
        now_s += every_s
        assert not trajectory.evaluate(now_s, position, velocity) and -1e-9 < position[0] < 1.0 + 1e-9
        assert trajectory.start(position, velocity, goal, *limits, now_s) is None
        assert trajectory.duration == pytest.approx(end_s - now_s, abs=1e-3 if jerk_time_s else 1e-6), "ruckig rounds"


def velocity_at(trajectory: Trajectory, time_s: float) -> float:
    position, velocity = np.zeros(trajectory.n), np.zeros(trajectory.n)
    trajectory.evaluate(time_s, position, velocity)
    return float(velocity[0])


def jerks(trajectory: Trajectory, start_s: float = 0.0) -> np.ndarray:
    """Magnitude of the third derivative along the way, from second differences of velocity."""
    step = 1e-3
    velocity = [velocity_at(trajectory, t) for t in np.arange(start_s, start_s + trajectory.duration - step, step)]
    return np.abs(np.diff(velocity, n=2)) / step**2
