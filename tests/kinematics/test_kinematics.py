"""Chains against the numbers of the original routines and of a real arm."""

from __future__ import annotations

import dataclasses
import json
from functools import cache

import numpy as np
import pytest

from tests import stock
from tests.cases import cases
from trocar.procs.kinematics.forward import Kinematics
from trocar.procs.kinematics.poses import pose_from_matrix, rotation_from_vector

LND = "LARGE_NEEDLE_DRIVER_400006"
STRAIGHT = np.array(((0.0, 1.0, 0.0, 0.0), (-1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0), (0.0, 0.0, 0.0, 1.0)))


@cache
def arm(name: str) -> Kinematics:
    if name == "PSM":
        return Kinematics(stock.chain("PSM"), stock.tool(LND))
    if name == "snake":
        return Kinematics(stock.chain("PSM"), stock.tool("NEEDLE_DRIVER_400117"))
    if name == "PSM_Si":
        return Kinematics(stock.chain("PSM_Si"), stock.tool("LARGE_NEEDLE_DRIVER_420006"))
    return Kinematics(stock.chain(name), tip=STRAIGHT if name == "ECM" else None)


GOLDEN = {
    "PSM": "PSM_LARGE_NEEDLE_DRIVER_400006",
    "snake": "PSM_NEEDLE_DRIVER_400117_snake",
    "ECM": "ECM_straight",
    "MTML": "MTML",
}


@pytest.mark.parametrize("name", GOLDEN)
def test_original_routines_agree_on_poses_and_jacobians(name: str) -> None:
    chain = arm(name)
    lines = stock.find(f"golden/kinematics/{GOLDEN[name]}.jsonl").read_text().splitlines()
    meta = json.loads(lines[0])["meta"]
    np.testing.assert_allclose(chain.lower, meta["lower"])
    np.testing.assert_allclose(chain.upper, meta["upper"])
    for line in lines[1:]:
        record = json.loads(line)
        q = np.array(record["q"])
        chain.update(q)
        np.testing.assert_allclose(chain.tip, record["fk"], atol=1e-12, rtol=0)
        np.testing.assert_allclose(chain.body, record["jb"], atol=1e-12, rtol=0)
        np.testing.assert_allclose(chain.fk(q), record["fk"], atol=1e-12, rtol=0)
        if "fk_notip" in record:
            np.testing.assert_allclose(chain.fk_to(q, chain.n), record["fk_notip"], atol=1e-12, rtol=0)
        np.testing.assert_allclose(chain.body_jacobian(q), record["jb"], atol=1e-12, rtol=0)
        np.testing.assert_allclose(chain.spatial_jacobian(q), record["js"], atol=1e-12, rtol=0)
        if "fk_links" in record:
            links = np.array(record["fk_links"])
            np.testing.assert_allclose([chain.fk_to(q, k + 1) for k in range(len(links))], links, atol=1e-12, rtol=0)


def test_a_real_arm_reported_the_same_tip() -> None:
    rows = np.loadtxt(stock.find("real/classic_tool_fixed.csv"), delimiter=",", skiprows=1)
    chain = arm("PSM")
    poses = np.array([chain.fk(q).copy() for q in np.ascontiguousarray(rows[:, 1:7])])
    distance = np.linalg.norm(poses[:, :3, 3] - rows[:, 7:10], axis=1)
    assert np.median(distance) <= 1e-9
    rotations = np.array([rotation_from_vector(v) for v in rows[:, 10:13]])
    assert np.median(np.abs(poses[:, :3, :3] - rotations).max(axis=(1, 2))) <= 1e-9


PSM_Q = (0.2, -0.3, 0.15, 0.4, -0.5, 0.6)
MTM_Q = (0.1, 0.2, 0.3, -0.4, 0.5, -0.6, 0.7)


@cases(
    ("name", "q", "position", "quaternion"),
    [
        ("PSM", (0, 0, 0.12, 0, 0, 0), (0, 0, -0.1135), (-0.707107, -0.707107, -0.000003, 0.000003)),
        ("PSM", PSM_Q, (0.028454, 0.045917, -0.131813), (0.773064, 0.391849, 0.498211, 0.024760)),
        ("PSM_Si", (0, 0, 0.12, 0, 0, 0), (0, 0, -0.1135), (-0.707107, -0.707107, -0.000003, 0.000003)),
        ("PSM_Si", PSM_Q, (0.028454, 0.045917, -0.131813), (0.773064, 0.391849, 0.498211, 0.024760)),
        ("ECM", (0, 0, 0.12, 0), (0, 0, -0.1207), (1, 0, 0, 0)),
        ("ECM", (0.2, -0.3, 0.15, 0.4), (0.028603, 0.044535, -0.141099), (-0.967184, 0.180835, -0.067206, 0.165341)),
        ("MTML", (0,) * 7, (-0.000001, -0.364499, -0.1288), (-0.500003, -0.499997, -0.500001, 0.499999)),
        ("MTML", MTM_Q, (0.030267, -0.301670, 0.033084), (-0.858583, -0.208967, -0.465381, 0.050870)),
        ("MTMR", (0,) * 7, (-0.000001, -0.364499, -0.1288), (-0.500003, -0.499997, -0.500001, 0.499999)),
        ("MTMR", (0.1, 0.2, 0.3, 0.4, 0.5, -0.6, 0.7), (0.030267, -0.301670, 0.033084),
         (-0.806793, -0.485114, -0.247871, 0.228713)),
    ],
)
def test_published_poses_are_met(
    name: str, q: tuple[float, ...], position: tuple[float, ...], quaternion: tuple[float, ...]
) -> None:
    pose = pose_from_matrix(arm(name).fk(np.array(q, dtype=float)))
    np.testing.assert_allclose(pose[:3], position, atol=2e-6)
    sign = np.sign(pose[3:] @ np.array(quaternion, dtype=float))
    np.testing.assert_allclose(sign * pose[3:], quaternion, atol=5e-6)


def test_the_published_body_jacobian_is_met() -> None:
    expected = (
        (0.047265, -0.117018, -0.479429, 0, -0.0091, 0),
        (0.088806, 0.079274, -0.495517, 0.003601, 0, 0),
        (0.089799, -0.017675, 0.724301, 0.002463, 0, 0),
        (-0.63052, -0.341746, 0, -0.479429, 0, -1),
        (0.691682, -0.654769, 0, -0.495517, -0.825338, 0),
        (-0.352165, -0.674157, 0, 0.724301, -0.564639, 0),
    )
    np.testing.assert_allclose(arm("PSM").body_jacobian(np.array(PSM_Q)), expected, atol=5e-6)


def test_a_base_offset_moves_tip_and_spatial_jacobian() -> None:
    chain = stock.chain("PSM")
    base = ((0.0, -1.0, 0.0, 0.1), (1.0, 0.0, 0.0, 0.2), (0.0, 0.0, 1.0, 0.3), (0.0, 0.0, 0.0, 1.0))
    moved = Kinematics(dataclasses.replace(chain, base=base), stock.tool(LND))
    q = np.array(PSM_Q)
    np.testing.assert_allclose(moved.fk(q), np.array(base) @ arm("PSM").fk(q), atol=1e-14)
    np.testing.assert_allclose(moved.fk_to(q, 0), base, atol=1e-14)
    np.testing.assert_allclose(moved.body_jacobian(q), arm("PSM").body_jacobian(q), atol=1e-13)


def test_body_jacobian_predicts_small_moves() -> None:
    chain, q, step = arm("PSM"), np.array(PSM_Q), 1e-7
    before = chain.fk(q).copy()
    jacobian = chain.body_jacobian(q).copy()
    for joint in range(chain.n):
        after = chain.fk(q + step * np.eye(chain.n)[joint])
        twist = (np.linalg.inv(before) @ after - np.eye(4)) / step
        expected = (*twist[:3, 3], twist[2, 1], twist[0, 2], twist[1, 0])
        np.testing.assert_allclose(jacobian[:, joint], expected, atol=1e-6)


def test_only_alpha_is_snapped_to_a_right_angle() -> None:
    chain = stock.chain("PSM")
    link = dataclasses.replace(chain.links[0], alpha=1.5708, offset=1.5708)
    pose = Kinematics(dataclasses.replace(chain, links=(link,))).fk(np.zeros(1))
    assert pose[1, 1] == 0.0
    assert pose[0, 0] == pytest.approx(np.cos(1.5708), abs=1e-16)


def test_an_unknown_convention_is_refused() -> None:
    with pytest.raises(ValueError, match="standard or modified"):
        Kinematics(dataclasses.replace(stock.chain("PSM"), convention="classic"))
