"""Distances of segments from shapes and the body of an arm, against MuJoCo and against samples."""

from __future__ import annotations

import math
from typing import Any

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as some

from tests import stock
from tests.arm.arm_configs import CHAIN, TOOL
from trocar.procs.document.walls import PARTS, SHAPES, SIZES, Wall
from trocar.procs.kinematics.forward import Kinematics
from trocar.procs.kinematics.poses import matrix_from_pose
from trocar.procs.kinematics.walls import shapes
from trocar.procs.kinematics.walls.body import ArmBody, points_at
from trocar.procs.kinematics.walls.walls import objection_to, size_of

THIN = 1e-6  # m, radius of a capsule that stands for a segment
SEEDS = some.integers(0, 2**32 - 1)
IN_MUJOCO = {"box": "box", "sphere": "sphere", "cylinder": "cylinder", "capsule": "capsule"}


def any_wall(rng: np.random.Generator, shape: str) -> Wall:
    size = tuple(rng.uniform(0.01, 0.08, SIZES[shape]).tolist()) if shape != "cone" else (float(rng.uniform(0.1, 1.4)),)
    turn, place = rng.normal(size=4), rng.uniform(-0.1, 0.1, 3)
    return Wall("w", shape, tuple(place.tolist()), tuple((turn / np.linalg.norm(turn)).tolist()), size)


def found(wall: Wall, a: Any, b: Any, keeps_in: bool = False) -> shapes.Nearest:
    frame = matrix_from_pose(np.array((*wall.position, *wall.orientation)))[:3].ravel().tolist()
    return shapes.nearest(SHAPES.index(wall.shape), keeps_in, frame, size_of(wall), list(a), list(b))


def by_mujoco(wall: Wall, a: Any, b: Any) -> float:
    """The distance of a segment from a wall's shape."""
    x, y, z, w = wall.orientation
    frame = matrix_from_pose(np.array((*wall.position, *wall.orientation)))
    size, place = np.array((*size_of(wall), 0.0, 0.0, 0.0))[:3], np.array(wall.position)
    if wall.shape == "capsule":  # ours begins at its place, theirs has it in the middle
        size[1] /= 2
        place = place + frame[:3, 2] * size[1]
    numbers = (f"size='{' '.join(map(str, size[: max(1, SIZES[wall.shape])]))}'"
               f" pos='{' '.join(map(str, place))}' quat='{w} {x} {y} {z}'")
    ends = " ".join(map(str, (*a, *b)))
    model = mujoco.MjModel.from_xml_string(
        f"<mujoco><option ccd_tolerance='1e-9'/><worldbody><geom type='{IN_MUJOCO[wall.shape]}' {numbers}/>"
        f"<geom type='capsule' size='{THIN}' fromto='{ends}'/></worldbody></mujoco>")
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return float(mujoco.mj_geomDistance(model, data, 0, 1, 1.0, np.zeros(6))) + THIN


@given(SEEDS, some.sampled_from(sorted(IN_MUJOCO)))
def test_a_segment_outside_a_shape_is_as_far_from_it_as_mujoco_says(seed: int, shape: str) -> None:
    rng = np.random.default_rng(seed)
    wall, (a, b) = any_wall(rng, shape), rng.uniform(-0.25, 0.25, (2, 3))
    ours = found(wall, a, b).value
    if ours > 1e-4:
        assert ours == pytest.approx(by_mujoco(wall, a, b), abs=2e-6)
    else:  # MuJoCo says of some boxes that a segment through them is outside
        inside = [found(wall, point, point).value for point in np.linspace(a, b, 2000)]
        assert ours - 1e-7 <= min(inside) <= ours + 1e-4


@given(SEEDS, some.sampled_from(SHAPES), some.booleans())
def test_no_point_of_a_segment_is_nearer_and_the_distance_grows_along_the_normal(seed: int, shape: str,
                                                                                keeps_in: bool) -> None:
    rng = np.random.default_rng(seed)
    wall, (a, b) = any_wall(rng, shape), rng.uniform(-0.15, 0.15, (2, 3))
    nearest = found(wall, a, b, keeps_in)
    for share in (*np.linspace(0.0, 1.0, 60), nearest.along):
        point = a + share * (b - a)
        assert found(wall, point, point, keeps_in).value >= nearest.value - 1e-7
    at, step = a + nearest.along * (b - a), 1e-6 * np.array(nearest.normal)
    assert np.linalg.norm(nearest.normal) == pytest.approx(1.0, abs=1e-9)
    assert found(wall, at + step, at + step, keeps_in).value >= found(wall, at, at, keeps_in).value + 0.5e-6


def test_inside_and_outside_of_each_shape() -> None:
    origin = (0.0, 0.0, 0.0)
    expected = {"plane": ((0, 0, -0.01), -0.01), "box": ((0.02, 0, 0), -0.01), "sphere": ((0, 0.01, 0), -0.02),
                "cylinder": ((0, 0, 0.035), -0.005), "capsule": ((0, 0, 0.09), -0.01), "cone": ((0, 0, 0.1), -0.05)}
    sizes = {"box": (0.06, 0.1, 0.1), "sphere": (0.03,), "cylinder": (0.05, 0.08), "capsule": (0.02, 0.08),
             "cone": (math.radians(30.0),)}
    for shape, (point, distance) in expected.items():
        wall = Wall("w", shape, origin, size=sizes.get(shape, ()))
        assert found(wall, point, point).value == pytest.approx(distance, abs=1e-12), shape
        assert found(wall, point, point, keeps_in=True).value == pytest.approx(-distance, abs=1e-12)


@given(SEEDS)
def test_the_body_of_a_psm_goes_from_its_remote_centre_to_the_end_of_its_jaw(seed: int) -> None:
    kinematics = Kinematics(CHAIN, TOOL)
    body = ArmBody(kinematics, 0.004, 0.02)
    q = np.random.default_rng(seed).uniform(kinematics.lower, kinematics.upper)
    q[2] = max(q[2], 0.02)
    points = points_at(kinematics, q, list(zip(body.of.tolist(), body.place, strict=True)))
    tip = kinematics.fk(q, np.eye(4))
    assert points[0] == pytest.approx((0.0, 0.0, 0.0), abs=1e-12)
    assert points[-2] == pytest.approx(tip[:3, 3], abs=1e-12)
    assert points[-1] == pytest.approx(tip[:3, 3] + 0.02 * tip[:3, 2], abs=1e-12)
    along = points[1] / np.linalg.norm(points[1])
    assert points[1] == pytest.approx(along * (q[2] - 0.4318 + 0.4162), abs=1e-9), "the wrist is on the shaft"
    for joint in range(6):  # no point is faster than `reach` says
        ahead = q.copy()
        ahead[joint] += 1e-6
        others = points_at(kinematics, ahead, list(zip(body.of.tolist(), body.place, strict=True)))
        assert np.linalg.norm(others - points, axis=1).max() <= 1e-6 * body.reach[joint] * (1.0 + 1e-3) + 1e-12
    assert all(map(body.has, PARTS))


def test_a_master_has_its_tip_only() -> None:
    body = ArmBody(Kinematics(stock.chain("MTML")), 0.004)
    assert [part for part in PARTS if body.has(part)] == ["tip", "instrument"] and body.parts.tolist() == [1]


@pytest.mark.parametrize(("wall", "arm_type"), [
    (Wall("a", "box", size=(0.1,)), "PSM"), (Wall("a", "sphere", size=(0.0,)), "PSM"),
    (Wall("a", "cone", size=(1.6,)), "PSM"), (Wall("a", "plane", of="shaft"), "MTM"),
    (Wall("a", "plane", of="jaw"), "ECM"), (Wall("a", "plane", orientation=(0.0, 0.0, 0.0, 0.0)), "PSM")])
def test_a_wall_that_cannot_be_is_named_with_its_reason(wall: Wall, arm_type: str) -> None:
    assert objection_to(wall, arm_type)
    assert not objection_to(Wall("a", "plane"), arm_type)
