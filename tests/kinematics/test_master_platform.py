"""A master's platform, of which the tip does not depend: it moves no further than needed, and without jumps."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.examples import examples
from tests.kinematics.test_inverse import arm, spread
from trocar.procs.kinematics.inverse.master import PITCH, PLATFORM, YAW, YAW_MARGIN

PARTS: Final = st.lists(st.floats(0.0, 1.0), min_size=7, max_size=7)
MASTERS: Final = ("MTML", "MTMR")
# The stock alignment of MTMR with PSM1: the original turns the platform to -1.41 rad, with the yaw at -0.78.
BEFORE: Final = np.array((-0.1, 0.1, 0.1, 0.0, 0.4, -0.1, 0.0))
ALIGNED: Final = np.array(((-0.203898, -0.969597, 0.135303), (0.803951, -0.2447, -0.542019),
                           (0.558649, -0.00174, 0.829402)))
ORIGINAL_PLATFORM: Final = -1.41
NO_FURTHER: Final = 1e-3  # rad: what the room at the limits of yaw and pitch may cost
INSIDE: Final = 1e-3  # rad from the limits of the pitch, where the platform depends on it by a square root


@pytest.mark.parametrize("name", MASTERS)
@examples(200)
@given(parts=PARTS, seed=PARTS)
def test_the_platform_never_moves_further_than_to_a_known_solution(name: str, parts: list[float],
                                                                   seed: list[float]) -> None:
    solver, forward = arm(name)
    known, start = spread(forward, parts), spread(forward, seed)
    known[PITCH] = np.clip(known[PITCH], forward.lower[PITCH] + INSIDE, forward.upper[PITCH] - INSIDE)
    known[YAW] *= 1.0 - YAW_MARGIN / forward.upper[YAW]
    start[:PLATFORM] = known[:PLATFORM]
    goal = forward.fk(known, np.eye(4))
    assert solver.solve(goal, start), solver.reason
    assert abs(solver.q[PLATFORM] - start[PLATFORM]) <= abs(known[PLATFORM] - start[PLATFORM]) + NO_FURTHER
    assert np.abs(forward.fk(solver.q, np.eye(4)) - goal).max() < 1e-9


@pytest.mark.parametrize("name", MASTERS)
@examples(20)
@given(parts=PARTS, amplitudes=PARTS)
def test_along_small_steps_no_joint_jumps(name: str, parts: list[float], amplitudes: list[float]) -> None:
    solver, forward = arm(name)
    middle = forward.lower + (forward.upper - forward.lower) * (0.25 + 0.5 * np.array(parts))
    here, last = middle.copy(), middle
    solver.solve(forward.fk(middle, np.eye(4)), middle)
    for k in range(300):
        last, goal_joints = here, middle + 0.2 * np.array(amplitudes) * math.sin(0.02 * k)
        assert solver.solve(forward.fk(goal_joints, np.eye(4)), last), solver.reason
        here = solver.q.copy()
        assert np.abs(here - last).max() < 0.05


def test_an_alignment_takes_no_more_of_the_platform_than_in_the_original() -> None:
    solver, forward = arm("MTMR")
    goal = forward.fk(BEFORE, np.eye(4))
    goal[:3, :3] = ALIGNED
    assert solver.solve(goal, BEFORE)
    assert ORIGINAL_PLATFORM <= solver.q[PLATFORM] < 0.0


def test_the_platform_rests_while_the_wrist_can_follow() -> None:
    solver, forward = arm("MTMR")
    here = BEFORE.copy()
    for yaw in np.linspace(-0.1, -0.6, 100):
        wanted = BEFORE.copy()
        wanted[YAW] = yaw
        assert solver.solve(forward.fk(wanted, np.eye(4)), here)
        here = solver.q.copy()
    assert here == pytest.approx(wanted, abs=1e-9)


def test_a_yaw_near_its_limit_goes_no_nearer() -> None:
    solver, forward = arm("MTMR")
    here = BEFORE.copy()
    here[YAW] = -0.75
    for yaw in np.linspace(-0.75, -1.1, 100):
        wanted = BEFORE.copy()
        wanted[YAW] = yaw
        assert solver.solve(forward.fk(wanted, np.eye(4)), here)
        assert np.abs(solver.q - here).max() < 0.05
        here = solver.q.copy()
    assert here[YAW] == pytest.approx(-0.75, abs=1e-3) and here[PLATFORM] != 0.0
