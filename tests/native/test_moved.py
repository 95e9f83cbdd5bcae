"""Walls that move with another arm, by native code and by numpy: the same; and their distances those of MuJoCo."""

from __future__ import annotations

import functools
from typing import Any

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as some

from tests.native.test_walls import ARMS
from trocar.procs.arm.joints import JointSpace, body_of, joints
from trocar.procs.document.walls import PARTS
from trocar.procs.kinematics.walls.body import PART_BITS, points_at
from trocar.procs.kinematics.walls.moved import MovedWalls
from trocar.procs.kinematics.walls.walls import MOST, ArmWalls
from trocar.procs.native.library import native

pytestmark = pytest.mark.skipif(native().library is None, reason=f"no native library: {native().why}")
OTHERS = tuple(kind for kind in ARMS if kind != "MTM")
Array = Any


def turned(rng: np.random.Generator, away: float) -> Array:
    """A random pose (4, 4)."""
    quaternion, pose = rng.normal(size=4), np.eye(4)
    x, y, z, w = quaternion / np.linalg.norm(quaternion)
    pose[:3, :3] = ((1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)),
                    (2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)),
                    (2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)))
    pose[:3, 3] = rng.uniform(-away, away, 3)
    return pose


def some_joints(rng: np.random.Generator, space: JointSpace) -> Array:
    """Joints (size,) within their limits, but at most 1 rad."""
    low, high = np.maximum(space.lower, -1.0), np.minimum(space.upper, 1.0)
    q = rng.uniform(low, high)
    q[2] = rng.uniform(0.06, 0.2)
    return q if space.paired is None else space.paired @ q


def capsules(space: JointSpace, kind: str, q: Array, base: Array) -> list[tuple[Array, Array, float]]:
    """Ends and radius of each segment of an arm at joints (size,)."""
    body = body_of(ARMS[kind][0], space)
    assert space.kinematics is not None
    points = points_at(space.kinematics, q[: space.count], list(zip(body.of.tolist(), body.place, strict=True)))
    points = points @ base[:3, :3].T + base[:3, 3]
    rows = zip(body.starts, body.stops, body.radius, body.solid, strict=True)
    return [(points[start], points[stop], radius) for start, stop, radius, is_solid in rows if is_solid]


@functools.cache
def mujoco_capsules(count: int) -> tuple[Any, Any]:
    """A model with so many capsules, and its data; made once, because MuJoCo needs 5 ms for it."""
    geoms = count * "<geom type='capsule' size='1 1'/>"
    model = mujoco.MjModel.from_xml_string(
        f"<mujoco><option ccd_tolerance='1e-9'/><worldbody>{geoms}</worldbody></mujoco>")
    return model, mujoco.MjData(model)


def by_mujoco(one: list[tuple[Array, Array, float]], two: list[tuple[Array, Array, float]], most: float = 1.0) -> float:
    """The least distance of two bodies, if it is less than `most`."""
    model, data = mujoco_capsules(len(one) + len(two))
    for k, (a, b, radius) in enumerate((*one, *two)):
        half = 0.5 * float(np.linalg.norm(b - a))
        model.geom_size[k, :2], model.geom_rbound[k] = (radius, half), radius + half
        mujoco.mju_quatZ2Vec(quaternion := np.zeros(4), b - a if half > 1e-9 else np.array((0.0, 0.0, 1.0)))
        mujoco.mju_quat2Mat(data.geom_xmat[k], quaternion)
        data.geom_xpos[k] = 0.5 * (a + b)
    return min(float(mujoco.mj_geomDistance(model, data, i, len(one) + j, most, None))
               for i in range(len(one)) for j in range(len(two)))


@pytest.mark.parametrize("kind", OTHERS)
@given(some.integers(0, 2**32 - 1), some.sampled_from(OTHERS), some.booleans())
def test_the_distance_of_two_arms_is_that_of_mujoco(kind: str, seed: int, other: str, by_tip: bool) -> None:
    rng, spaces = np.random.default_rng(seed), [joints(*ARMS[each]) for each in (kind, other)]
    ours, theirs = spaces
    n, at, there = ours.count, *(some_joints(rng, space) for space in spaces)
    relation, body = turned(rng, 0.15), body_of(ARMS[other][0], theirs)
    assert ours.kinematics is not None and theirs.kinematics is not None
    made = ArmWalls(ours.kinematics, body_of(ARMS[kind][0], ours), ours.lower[:n], ours.upper[:n], ours.free, 8)
    moved = MovedWalls(theirs.kinematics, body, theirs.to_joint[: theirs.count], theirs.to_actuator @ there)
    last = MOST + int(body.solid.sum())
    moved.fill(made.frames[MOST:last], made.size[MOST:last], None)
    given_relation = relation @ theirs.kinematics.fk(there[: theirs.count], np.eye(4)) if by_tip else relation
    moved.relation[...], moved.by_tip[...] = given_relation[:3], by_tip
    made.guards[MOST:last], made.goal[...] = PART_BITS[PARTS[3]], at[:n]
    found = []
    for follow in (moved.follow, moved.by_numpy_follow):
        made.frames[MOST:], made.size[MOST:, 1] = 0.0, 0.0
        assert follow() == 1
        for look in (made.look, made.by_numpy_look):
            look()
            found.append(made.value.min())
    np.testing.assert_allclose(found, found[0], rtol=0.0, atol=1e-12)
    truth = by_mujoco(capsules(ours, kind, at, np.eye(4)), capsules(theirs, other, there, relation))
    if truth > 1e-4:
        assert found[0] == pytest.approx(truth, abs=2e-6)
    else:
        assert found[0] < 2e-4


@given(some.integers(0, 2**32 - 1))
def test_a_wall_hangs_at_the_tip_of_another_arm(seed: int) -> None:
    rng, space = np.random.default_rng(seed), joints(*ARMS["ECM"])
    assert space.kinematics is not None
    q, relation, pose = some_joints(rng, space), turned(rng, 0.2), turned(rng, 0.1)
    moved = MovedWalls(space.kinematics, body_of(ARMS["ECM"][0], space), space.to_joint, space.to_actuator @ q)
    frames = np.zeros((1, 3, 4))
    moved.fill(frames, np.zeros((1, 3)), pose)
    moved.relation[...] = relation[:3]
    wanted = relation @ space.kinematics.fk(q, np.eye(4)) @ pose
    for follow in (moved.follow, moved.by_numpy_follow):
        frames[...] = 0.0
        assert follow() == 1
        np.testing.assert_allclose(frames[0], wanted[:3], rtol=0.0, atol=1e-12)
    for spoiled in (np.nan, -1e30, 4.0):
        moved.position[1] = spoiled
        assert moved.follow() == 0 and moved.by_numpy_follow() == 0
        np.testing.assert_allclose(frames[0], wanted[:3], rtol=0.0, atol=1e-12)
