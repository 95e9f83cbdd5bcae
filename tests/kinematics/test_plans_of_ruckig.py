"""Random trajectories compared with those of ruckig: durations, positions and velocities along the whole way."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from trocar.procs.kinematics.poses import Array
from trocar.procs.kinematics.trajectory import Trajectory

ruckig = pytest.importorskip("ruckig", reason="no package of ruckig for this machine", exc_type=ImportError)
Random = np.random.Generator
Problem = tuple[Array, Array, Array, Array, Array]
SAME = 1e-9
PROBLEMS = 300
SHARES = (0.0, 0.01, 0.08, 0.2, 0.35, 0.5, 0.65, 0.8, 0.92, 0.999)


def way(random: Random, distance: Array, v_max: Array) -> Array:
    """A velocity along a straight line to the goal, or away from it."""
    slowest = np.min(v_max / np.maximum(np.abs(distance), 1e-9))
    return np.asarray(distance * random.uniform(-1.0, 1.0) * slowest)


STARTS: dict[str, Callable[[Random, Array, Array], Array]] = {
    "at rest": lambda random, distance, v_max: np.zeros_like(distance),
    "moving": lambda random, distance, v_max: random.uniform(-1.0, 1.0, len(distance)) * v_max,
    "some moving": lambda random, distance, v_max: (
        random.uniform(-1.0, 1.0, len(distance)) * v_max * random.integers(0, 2, len(distance))),
    "too fast": lambda random, distance, v_max: random.uniform(-3.0, 3.0, len(distance)) * v_max,
    "to the goal": lambda random, distance, v_max: np.sign(distance) * random.uniform(0.0, 1.0, len(distance)) * v_max,
    "from the goal": lambda random, distance, v_max: np.sign(distance) * random.uniform(-1.0, 0, len(distance)) * v_max,
    "in a straight line": way,
}


def problem(random: Random, start: str) -> Problem:
    """Position, velocity, goal and limits."""
    n = int(random.integers(1, 9))
    v_max, a_max = 10.0 ** random.uniform(-1.0, 1.0, n), 10.0 ** random.uniform(-1.0, 1.5, n)
    if random.random() < 0.2:
        v_max[:], a_max[:] = v_max[0], a_max[0]
    distance = random.normal(size=n) * 10.0 ** random.uniform(-2.0, 1.0) * (random.random(n) < 0.8)
    if random.random() < 0.1:
        distance[:] = 0.0
    position = random.normal(size=n) * random.choice((0.0, 1.0, 10.0))
    return position, STARTS[start](random, distance, v_max), position + distance, v_max, a_max


def planned(position: Array, velocity: Array, goal: Array, v_max: Array, a_max: Array) -> ruckig.Trajectory | None:
    """The plan of ruckig; None: it finds none."""
    n = len(goal)
    request, found = ruckig.InputParameter(n), ruckig.Trajectory(n)
    request.synchronization = ruckig.Synchronization.Phase
    request.current_position, request.current_velocity = position.tolist(), velocity.tolist()
    request.target_position, request.max_velocity = goal.tolist(), v_max.tolist()
    request.max_acceleration, request.max_jerk = a_max.tolist(), [math.inf] * n
    try:
        ruckig.Ruckig(n).calculate(request, found)
    except (ruckig.RuckigError, ValueError):
        return None
    return found


@pytest.mark.slow
@pytest.mark.parametrize("start", STARTS)
def test_a_plan_is_that_of_ruckig_from_a_start(start: str) -> None:
    random, compared = np.random.default_rng(44), 0
    for _ in range(PROBLEMS):
        given = problem(random, start)
        own, theirs = Trajectory(len(given[0])), planned(*given)
        assert own.start(*given, 0.0) is None
        if theirs is None:  # its own formulas lose too many digits
            continue
        compared += 1
        assert abs(own.duration - theirs.duration) <= SAME * max(1.0, theirs.duration)
        position, velocity = np.zeros((2, own.n))
        for share in SHARES:
            time_s = share * theirs.duration
            own.evaluate(time_s, position, velocity)
            there, speed, _ = theirs.at_time(time_s)
            assert np.abs(position - there).max() <= SAME
            assert np.abs(velocity - speed).max() <= SAME
    assert compared > 0.98 * PROBLEMS
