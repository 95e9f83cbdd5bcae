"""Coulomb friction: what rests stays where it is to the last digit, what slides is held back by just the limit."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.examples import examples
from trocar.procs.boards.robots.friction import STIFFNESS, Friction

PERIOD = 1e-3
ARMATURE = np.array((0.1, 4e-4, 2.0))
LIMIT = np.array((0.05, 0.004, 3.0))


class Masses:
    """Joints with friction and whatever inertia hangs on them, moved as the plant moves them."""

    def __init__(self, coupled: np.ndarray | None = None) -> None:
        inertia = np.diag(ARMATURE) + (coupled @ coupled.T if coupled is not None else 0.0)
        self.inverse = np.linalg.inv(inertia)
        self.friction = Friction(LIMIT, ARMATURE, PERIOD)
        self.position, self.velocity = np.zeros(3), np.zeros(3)

    def step(self, effort: np.ndarray) -> None:
        """One period."""
        self.velocity += PERIOD * self.inverse @ (effort - self.friction.oppose(self.velocity))
        self.position += PERIOD * self.velocity


shares = st.lists(st.floats(-1.0, 1.0), min_size=3, max_size=3).map(np.array)
couplings = st.lists(st.floats(-1.0, 1.0), min_size=9, max_size=9).map(
    lambda values: 0.5 * np.sqrt(ARMATURE)[:, None] * np.reshape(values, (3, 3))
)


LEAST = LIMIT * PERIOD**2 / (STIFFNESS * ARMATURE)  # what the spring yields at the limit


@examples(20)
@given(share=shares, coupled=couplings)
def test_a_load_below_the_limit_never_moves_a_joint(share: np.ndarray, coupled: np.ndarray) -> None:
    masses = Masses(coupled)
    for k in range(400):
        masses.step(0.9 * LIMIT * share * min(k / 200, 1.0))
    start = masses.position.copy()
    assert (np.abs(start) <= LEAST).all()
    for _ in range(400):
        masses.step(0.9 * LIMIT * share)
    np.testing.assert_allclose(masses.position, start, atol=1e-3 * LEAST.min())
    np.testing.assert_allclose(masses.friction.oppose(masses.velocity), 0.9 * LIMIT * share, atol=1e-3 * LIMIT.max())


@examples(20)
@given(steady=shares, shaking=shares, pace=st.floats(0.01, 2.0))
def test_shaking_below_the_limit_moves_a_joint_nowhere(steady: np.ndarray, shaking: np.ndarray, pace: float) -> None:
    masses = Masses()
    rests = []
    for _ in range(3):
        for k in range(200):
            masses.step(0.35 * LIMIT * (steady + shaking * np.sin(pace * k) * (k < 100)))
        rests.append(masses.position.copy())
    assert (np.abs(rests) <= LEAST).all()
    np.testing.assert_allclose(rests[2], rests[0], atol=1e-6 * LEAST.min())


def test_a_load_beyond_the_limit_is_diminished_by_it() -> None:
    masses = Masses()
    for _ in range(400):
        masses.step(3.0 * LIMIT)
    np.testing.assert_allclose(masses.velocity, 0.4 * 2.0 * LIMIT / ARMATURE, rtol=0.01)


@examples(30)
@given(kick=shares, coupled=couplings)
@pytest.mark.slow
def test_what_was_kicked_comes_to_rest_and_stays(kick: np.ndarray, coupled: np.ndarray) -> None:
    masses = Masses(coupled)
    masses.velocity[:] = 0.1 * kick * LIMIT / ARMATURE
    for _ in range(1500):
        masses.step(np.zeros(3))
    start = masses.position.copy()
    for _ in range(1000):
        masses.step(np.zeros(3))
    np.testing.assert_allclose(masses.position, start, atol=1e-12)


def test_a_sliding_joint_is_slowed_by_just_the_limit() -> None:
    masses = Masses()
    masses.velocity[:] = LIMIT / ARMATURE
    for _ in range(500):
        masses.step(np.zeros(3))
    np.testing.assert_allclose(masses.velocity, 0.5 * LIMIT / ARMATURE, rtol=0.01)


def test_a_joint_that_is_put_somewhere_rests_there() -> None:
    masses = Masses()
    for _ in range(100):
        masses.step(0.9 * LIMIT)
    masses.friction.relax(np.array((1,)))
    assert masses.friction.oppose(np.zeros(3))[1] == 0.0
    np.testing.assert_allclose(masses.friction.oppose(np.zeros(3))[[0, 2]], 0.9 * LIMIT[[0, 2]], rtol=1e-6)
