"""Walls by native code and by numpy: the same distances, and the same nearest joints."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as some

from tests import stock
from tests.arm.arm_configs import fixed_arm
from tests.arm.fake_master import master
from tests.arm.test_ecm import ecm
from tests.kinematics.test_walls import any_wall
from trocar.procs.arm.joints import JointSpace, body_of, joints
from trocar.procs.document.system import ArmConfig
from trocar.procs.document.walls import PARTS, SHAPES, SIDES, Wall
from trocar.procs.kinematics.walls.walls import ArmWalls, pose_of
from trocar.procs.native.library import native

pytestmark = pytest.mark.skipif(native().library is None, reason=f"no native library: {native().why}")

DEMO = fixed_arm()
ARMS = {"PSM": (DEMO, DEMO.tool), "snake": (DEMO, stock.tool("NEEDLE_DRIVER_400117")), "ECM": (ecm(), None),
        "MTM": (master(), None)}
STEP = 0.01


def walls_of(rng: np.random.Generator, space: JointSpace, arm: ArmConfig) -> ArmWalls:
    """Walls near the tip of an arm."""
    n, kinematics = space.count, space.kinematics
    assert kinematics is not None
    made = ArmWalls(kinematics, body_of(arm, space), space.lower[:n], space.upper[:n], space.free)
    for place in range(rng.integers(1, 4)):
        changes: dict[str, Any] = {"keep": SIDES[int(rng.random() < 0.2)], "of": PARTS[rng.integers(len(PARTS))],
                                   "margin": float(rng.choice((0.0, 0.002)))}
        wall = any_wall(rng, SHAPES[rng.integers(len(SHAPES))])
        frame = pose_of(wall)
        frame[:3, 3] += kinematics.fk(made.before, np.eye(4))[:3, 3] if arm.type == "MTM" else (0.0, 0.0, -0.1)
        made.put(place, Wall(wall.name, wall.shape, size=wall.size, **changes), frame)
    return made


@pytest.mark.parametrize("kind", ARMS)
@given(some.integers(0, 2**32 - 1), some.booleans())
def test_both_find_the_same_and_nothing_comes_nearer_or_goes_faster_than_it_may(kind: str, seed: int,
                                                                               is_step: bool) -> None:
    rng, (arm, tool) = np.random.default_rng(seed), ARMS[kind]
    space = joints(arm, tool)
    n = space.count
    made = walls_of(rng, space, arm)
    low, high = np.maximum(space.lower[:n], -1.0), np.minimum(space.upper[:n], 1.0)
    middle, width = 0.5 * (low + high), 0.4 * (high - low)
    free = made.free @ rng.uniform(-1.0, 1.0, made.m)
    before = middle + width * free / max(1.0, float(np.abs(free).max()))
    change = made.free @ rng.normal(size=made.m)
    goal = before + (STEP if is_step else 0.1) * change / max(1.0, float(np.abs(change).max()))
    made.before[...], made.goal[...], made.step[...] = before, before, np.array((-STEP, STEP))[:, None]
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
        assert not is_step or (np.abs(made.goal - before) <= STEP + 1e-12).all()
    (pair, ours), (same, theirs) = results
    assert pair == same
    np.testing.assert_allclose(ours, theirs, rtol=0.0, atol=1e-6)
    made.goal[...] = goal
    assert made.way() == made.by_numpy_way()
    assert made.meets(0.013) == made.by_numpy_meets(0.013)
    made.group[:2] = 0
    assert made.slow(0.013) == made.by_numpy_slow(0.013)
    share = float(made.share[0])
    made.slow(0.013)
    assert share == pytest.approx(float(made.share[0]), abs=1e-9)
    made.rates[...], made.goal[...] = rng.normal(size=n), before
    assert made.push() == made.by_numpy_push()
    by_numpy = made.efforts.copy()
    made.push()
    np.testing.assert_allclose(made.efforts, by_numpy, rtol=0.0, atol=1e-9)
