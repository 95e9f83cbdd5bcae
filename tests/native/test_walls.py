"""Walls by native code and by numpy: the same distances, and the same nearest joints."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as some

from tests.arm.arm_configs import fixed_arm
from tests.kinematics.test_walls import any_wall
from trocar.procs.arm.joints import joints
from trocar.procs.arm.walls import body_of
from trocar.procs.document.walls import PARTS, SHAPES, SIDES
from trocar.procs.kinematics.walls.walls import ArmWalls, pose_of
from trocar.procs.native.library import native

pytestmark = pytest.mark.skipif(native().library is None, reason=f"no native library: {native().why}")

ARM = fixed_arm()
SPACE = joints(ARM, ARM.tool)
N = SPACE.count
SCALE = np.array((0.1, 0.1, 0.01, 0.2, 0.2, 0.2))


def walls_of(rng: np.random.Generator) -> ArmWalls:
    assert SPACE.kinematics is not None
    made = ArmWalls(SPACE.kinematics, body_of(ARM, SPACE), SPACE.lower[:N], SPACE.upper[:N], SPACE.free)
    for place in range(rng.integers(1, 4)):
        changes: dict[str, Any] = {"keep": SIDES[int(rng.random() < 0.2)], "of": PARTS[rng.integers(len(PARTS))],
                                   "margin": float(rng.choice((0.0, 0.002)))}
        wall = any_wall(rng, SHAPES[rng.integers(len(SHAPES))])
        frame = pose_of(wall)
        frame[2, 3] -= 0.1
        made.put(place, type(wall)(wall.name, wall.shape, size=wall.size, **changes), frame)
    return made


@given(some.integers(0, 2**32 - 1), some.booleans())
def test_both_find_the_same_and_nothing_comes_nearer_than_it_may(seed: int, is_step: bool) -> None:
    rng = np.random.default_rng(seed)
    made = walls_of(rng)
    low, high = np.maximum(SPACE.lower[:N], -1.0), np.minimum(SPACE.upper[:N], 1.0)
    low[2] = 0.05
    before = rng.uniform(low, high)
    goal = np.clip(before + rng.normal(size=N) * SCALE, low, high)
    made.before[...], made.goal[...], made.step[...] = before, before, 0.02
    made.look()
    first = made.value.copy()
    made.by_numpy_look()
    np.testing.assert_allclose(made.value, first, rtol=0.0, atol=1e-12)
    results = []
    for keep in (made.keep, made.by_numpy_keep):
        made.goal[...] = goal
        results.append((keep(0.013, int(is_step)), made.goal.copy()))
        made.look()
        assert (made.value >= np.minimum(first, 0.0) - 1e-7).all()
        if is_step and results[-1][0]:
            assert (np.abs(made.goal - before) <= 0.02 + 1e-5).all()
    (pair, ours), (same, theirs) = results
    assert pair == same
    np.testing.assert_allclose(ours, theirs, rtol=0.0, atol=1e-7)
    made.goal[...] = goal
    assert made.way() == made.by_numpy_way()
    made.rates[...] = rng.normal(size=N)
    made.goal[...] = before
    assert made.push() == made.by_numpy_push()
    by_numpy = made.efforts.copy()
    made.push()
    np.testing.assert_allclose(made.efforts, by_numpy, rtol=0.0, atol=1e-9)
