"""Arms' kinematics by native code, by Python and by pinocchio: the same, wherever joints and goals are."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from functools import cache, partial
from types import SimpleNamespace
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests import stock
from tests.cases import cases
from tests.examples import examples
from tests.native.pinocchio_chain import PinocchioChain, twist_between
from trocar.procs.arm.cartesian import Cartesian
from trocar.procs.document.system import Chain, Tool
from trocar.procs.kinematics import frames
from trocar.procs.kinematics.forward import Kinematics
from trocar.procs.kinematics.gravity import Gravity
from trocar.procs.kinematics.inverse.arms import BENDS, inverse_of
from trocar.procs.kinematics.inverse.solver import InverseSolver
from trocar.procs.kinematics.poses import rotation_from_vector
from trocar.procs.native.fields import CStruct
from trocar.procs.native.library import native

pytestmark = pytest.mark.skipif(native().library is None, reason=f"no native library: {native().why}")

SAME, TRUE = 1e-12, 1e-9  # rad and m: native code and Python; both and pinocchio
TIP = np.eye(4)
TIP[:3, :3], TIP[:3, 3] = rotation_from_vector(np.array((0.4, 0.2, -1.3))), (0.01, -0.02, 0.18)
ARMS = {
    **{name: ("PSM", "PSM", name) for name in stock.TOOLS if name != "LARGE_NEEDLE_DRIVER_420006"},
    "PSM_Si": ("PSM", "PSM_Si", "LARGE_NEEDLE_DRIVER_420006"),
    "ECM": ("ECM", "ECM", ""), "ECM_Si": ("ECM", "ECM_Si", ""),
    "MTML": ("MTM", "MTML", ""), "MTMR": ("MTM", "MTMR", ""),
}
OUTPUTS = {"measured_cp": (7,), "setpoint_cp": (7,), "local_measured_cp": (7,), "local_setpoint_cp": (7,),
           "measured_cv": (6,), "setpoint_cv": (6,), "local_measured_cv": (6,), "body_measured_cf": (6,),
           "spatial_measured_cf": (6,), "jacobian": (6, 8), "spatial_jacobian": (6, 8), "base_frame": (7,),
           "reference_valid": (), "cartesian_valid": (), "reference_frame": ()}
seeds = st.integers(0, 2**32 - 1)


@contextmanager
def without_native() -> Iterator[None]:
    with ExitStack() as stack:
        for module in ("kinematics.forward", "kinematics.inverse.solver", "arm.cartesian", "kinematics.gravity"):
            stack.enter_context(patch(f"trocar.procs.{module}.chosen", by_methods))
        yield


def by_methods(table: CStruct, source: object, prefix: str) -> tuple[Any, ...]:
    """What is chosen without a native library."""
    return tuple(getattr(source, prefix + name) for name in table.functions)


def are_native(*functions: Any) -> list[bool]:
    """Whether each is a function of the native library, not a method."""
    return [isinstance(function, partial) for function in functions]


def parts(name: str) -> tuple[str, Chain, Tool | None, np.ndarray | None]:
    arm_type, chain, tool = ARMS[name]
    return arm_type, stock.chain(chain), stock.tool(tool) if tool else None, TIP if arm_type == "ECM" else None


@cache
def chains(name: str) -> tuple[Kinematics, Kinematics, PinocchioChain]:
    """By native code, by Python, by pinocchio."""
    _, *given = parts(name)
    with without_native():
        python = Kinematics(*given)
    quick = Kinematics(*given)
    assert are_native(quick._update, python._update) == [True, False]
    return quick, python, PinocchioChain(*given)


@cache
def solvers(name: str) -> tuple[InverseSolver, InverseSolver]:
    """By native code and by Python."""
    with without_native():
        python = inverse_of(*parts(name))
    quick = inverse_of(*parts(name))
    assert are_native(quick._newton, python._newton) == [True, False]
    return quick, python


def within(chain: Kinematics, rng: np.random.Generator, margin: float = 0.0) -> np.ndarray:
    """Joints within limits; a snake's bends are pairs."""
    q = chain.lower + (chain.upper - chain.lower) * rng.uniform(margin, 1.0 - margin, chain.n)
    return BENDS @ q[:6] if chain.n == len(BENDS) else q


def assert_same_solution(quick: InverseSolver, python: InverseSolver, goal: np.ndarray, seed: np.ndarray) -> bool:
    with np.errstate(all="ignore"):
        found = quick.solve(goal, seed), python.solve(goal, seed)
    assert found[0] is found[1]
    np.testing.assert_allclose(quick.q, python.q, atol=SAME, rtol=0)
    assert (quick.reason, quick.axis, quick.steps) == (python.reason, python.axis, python.steps)
    assert quick.steps <= 40
    return found[0]


@pytest.mark.parametrize("name", ARMS)
@given(seeds)
@examples(12)
def test_poses_and_jacobians_are_the_same_three_ways(name: str, seed: int) -> None:
    quick, python, truth = chains(name)
    rng = np.random.default_rng(seed)
    q = rng.normal(0.0, 3.0, quick.n)
    for chain in (quick, python):
        chain.update(q)
        np.testing.assert_allclose(chain.tip, truth.frame(q), atol=TRUE, rtol=0)
        np.testing.assert_allclose(chain.body, truth.body(q), atol=TRUE, rtol=0)
        np.testing.assert_allclose(chain.spatial, truth.spatial(q), atol=TRUE, rtol=0)
        np.testing.assert_allclose(chain.fk(q, np.eye(4)), truth.frame(q), atol=TRUE, rtol=0)
        for link in range(quick.n + 1):
            np.testing.assert_allclose(chain.fk_to(q, link), truth.frame(q, link), atol=TRUE, rtol=0)
    for array in ("tip", "body", "spatial"):
        np.testing.assert_allclose(getattr(quick, array), getattr(python, array), atol=SAME, rtol=0)


@cases("name", ("BOWEL_GRASPER_400127", "ECM", "MTML"))
@cases("value", (math.nan, math.inf, 1e300))
def test_joints_that_are_no_numbers_do_no_harm(name: str, value: float) -> None:
    quick, python, _ = chains(name)
    for joint in range(quick.n):
        q = np.zeros(quick.n)
        q[joint] = value
        for chain in (quick, python):
            with np.errstate(all="ignore"):
                chain.update(q)
        for a, b in ((quick.tip, python.tip), (quick.body, python.body)):
            np.testing.assert_allclose(*(np.where(np.isfinite(x), x, np.nan) for x in (a, b)), rtol=SAME)


@given(seeds)
@examples(60)
def test_the_twist_between_frames_is_that_of_pinocchio(seed: int) -> None:
    rng = np.random.default_rng(seed)
    f, g = np.eye(4), np.eye(4)
    f[:3, :3], f[:3, 3] = rotation_from_vector(rng.normal(0.0, 1.0, 3)), rng.normal(0.0, 1.0, 3)
    turn = rng.normal(0.0, 1.0, 3)
    turn *= 10.0 ** rng.uniform(-12.0, math.log10(3.1)) / np.linalg.norm(turn)
    g[:3, :3], g[:3, 3] = f[:3, :3] @ rotation_from_vector(turn), f[:3, 3] + rng.normal(0.0, 0.1, 3)
    found = frames.twist_between(f.ravel().tolist()[:12], g.ravel().tolist()[:12])
    np.testing.assert_allclose(found, twist_between(f, g), atol=TRUE, rtol=0)


def test_the_twist_of_half_a_turn_is_found() -> None:
    g = np.diag((-1.0, 1.0, -1.0, 1.0))
    g[:3, 3] = (0.1, 0.2, 0.3)
    found = frames.twist_between(np.eye(4).ravel().tolist()[:12], g.ravel().tolist()[:12])
    assert np.abs(found[3:]) == pytest.approx((0.0, math.pi, 0.0), abs=1e-9)


@pytest.mark.parametrize("name", ARMS)
@given(seeds, st.sampled_from((1e-4, 1e-2, 0.3, 3.0)))
@examples(12)
def test_joints_for_a_pose_are_the_same_both_ways_and_true(name: str, seed: int, away: float) -> None:
    (quick, python), (forward, _, truth) = solvers(name), chains(name)
    rng = np.random.default_rng(seed)
    q = within(forward, rng, 0.05)
    goal = truth.frame(q)
    start = q + away * rng.uniform(-1.0, 1.0, len(q))
    if assert_same_solution(quick, python, goal, np.clip(start, forward.lower, forward.upper)):
        if ARMS[name][0] == "ECM":
            assert np.abs(truth.frame(quick.q)[:3, 3] - goal[:3, 3]).max() < 1e-8
        else:
            assert np.abs(twist_between(goal, truth.frame(quick.q))).max() < 1e-8


@pytest.mark.parametrize("name", ARMS)
@given(seeds, st.sampled_from((0.1, 0.6, 10.0, 1e9)))
@examples(12)
def test_goals_out_of_reach_end_the_same_both_ways(name: str, seed: int, size: float) -> None:
    (quick, python), (forward, *_) = solvers(name), chains(name)
    rng = np.random.default_rng(seed)
    goal, at = np.eye(4), within(forward, rng)
    goal[:3, :3], goal[:3, 3] = rotation_from_vector(rng.normal(0.0, 2.0, 3)), size * rng.uniform(-1.0, 1.0, 3)
    assert_same_solution(quick, python, goal, at)
    most = rng.uniform(1e-9, 0.1, len(at))
    for solver in (quick, python):
        solver.approach(goal, at, most)
        assert np.all(np.abs(solver.q - at) <= most[: len(at)] + SAME) or forward.n == len(BENDS)
        assert np.all(solver.q >= np.minimum(forward.lower, at) - SAME)
        assert np.all(solver.q <= np.maximum(forward.upper, at) + SAME)
    np.testing.assert_allclose(quick.q, python.q, atol=SAME, rtol=0)


@cases("name", ARMS)
@cases("value", (math.nan, math.inf, -math.inf, 1e160, 1e308))
def test_goals_and_seeds_that_are_no_numbers_end_at_the_seed(name: str, value: float) -> None:
    (quick, python), (forward, *_) = solvers(name), chains(name)
    middle = within(forward, np.random.default_rng(0))
    for place in range(12):
        goal = forward.fk(middle, np.eye(4))
        goal.ravel()[place] = value
        if ARMS[name][0] != "ECM":
            assert not assert_same_solution(quick, python, goal, middle)
        for solver in (quick, python):
            with np.errstate(all="ignore"):
                solver.approach(goal, middle, np.full(len(middle), 0.01))
            assert np.isfinite(solver.q).all()
    for solver in (quick, python):
        assert not solver.solve(forward.fk(middle, np.eye(4)), np.full(len(middle), math.nan))


@pytest.mark.slow
def test_the_recording_of_a_real_arm_is_followed_the_same_both_ways() -> None:
    recorded = np.loadtxt(stock.find("real/classic_tool_fixed.csv"), delimiter=",", skiprows=1)[:, 1:7]
    quick, python = solvers("LARGE_NEEDLE_DRIVER_400006")
    forward, _, truth = chains("LARGE_NEEDLE_DRIVER_400006")
    at = recorded[0]
    for q in recorded:
        goal = truth.frame(q)
        if np.all((q >= forward.lower) & (q <= forward.upper)):
            assert assert_same_solution(quick, python, goal, at)
            np.testing.assert_allclose(quick.q, q, atol=TRUE, rtol=0)
            at = quick.q.copy()


def cartesian(name: str, rows: np.ndarray, base: np.ndarray) -> tuple[Cartesian, dict[str, np.ndarray]]:
    """With a record of its own."""
    chain = Kinematics(*parts(name)[1:])
    record = {key: np.full(shape, 7.0 if shape else 0.0) for key, shape in OUTPUTS.items()}
    readings: Any = SimpleNamespace(rows=rows, valid=True, changed=True)
    made = Cartesian(record.__getitem__, readings, "PSM1")
    joints: Any = SimpleNamespace(kinematics=chain, count=chain.n, free=BENDS if chain.n == len(BENDS) else None)
    made.use(joints)
    made.set_base(base)
    return made, record


@pytest.mark.parametrize("name", ARMS)
@given(seeds, st.booleans(), st.sampled_from((0.0, 1e-9, 1.0)), st.sampled_from((0, 1, 2, 3)))
@examples(12)
def test_records_of_the_tip_are_the_same_both_ways(name: str, seed: int, absolute: bool, speed: float, parts: int
                                                   ) -> None:
    rng = np.random.default_rng(seed)
    quick, _, truth = chains(name)
    rows = rng.normal(0.0, 1.0, (6, quick.n + 1))
    rows[0, : quick.n], rows[3, : quick.n] = within(quick, rng), within(quick, rng)
    rows[1:3] *= speed
    rows[4:] *= speed
    base = np.eye(4)
    base[:3, :3], base[:3, 3] = rotation_from_vector(rng.normal(0.0, 1.0, 3)), rng.normal(0.0, 1.0, 3)
    with without_native():
        python, python_record = cartesian(name, rows, base)
    made, record = cartesian(name, rows, base)
    assert are_native(made._show, python._show) == [True, False]
    twist = rng.normal(0.0, 1.0, 6)
    for each in (made, python):
        each.absolute = absolute
        each.want(parts)
        each.update()
        np.testing.assert_allclose(each.tip, truth.frame(rows[0, : quick.n]), atol=TRUE, rtol=0)
        np.testing.assert_allclose(each.rotation, (base @ each.tip)[:3, :3], atol=TRUE, rtol=0)
        np.testing.assert_allclose(each.body_twist, truth.body(rows[0, : quick.n]) @ rows[1, : quick.n], atol=TRUE)
        np.testing.assert_allclose(each.spatial, truth.spatial(rows[0, : quick.n]), atol=TRUE)
        shown = each.shown_spatial[:, : quick.n]
        assert np.array_equal(shown, each.spatial) if parts & each.SPATIAL else np.isnan(shown).all()
        for wrench in (each.body_wrench, each.spatial_wrench):
            assert (np.isfinite if parts & each.WRENCHES else np.isnan)(wrench).all()
        if parts & each.WRENCHES and not absolute and name != "NEEDLE_DRIVER_400117" and quick.n >= 6:
            wrench = each.jacobian @ each.jacobian.T @ each.body_wrench  # pinv(Jᵀ) · effort
            np.testing.assert_allclose(wrench, each.jacobian @ rows[2, : quick.n], atol=1e-6)
    for key, array in record.items():
        np.testing.assert_allclose(array, python_record[key], atol=SAME, rtol=SAME, err_msg=key)
    np.testing.assert_allclose(made.rates(twist), python.rates(twist), atol=SAME, rtol=SAME)
    assert not made.rates(np.zeros(6)).any()


@pytest.mark.parametrize(("name", "camera", "link"), [("ECM", 1.5, 2), ("ECM_Si_physical", 1.8, 5),
                                                      ("PSM_Si_physical", None, 0)])
@given(seeds)
@examples(20)
def test_holding_efforts_are_the_same_three_ways(name: str, camera: float | None, link: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    chain, up = stock.chain(name), rng.normal(0.0, 9.81, 3)
    quick = Gravity(chain, 4, up, camera)
    with without_native():
        python = Gravity(chain, 4, up, camera)
    assert are_native(quick._hold, python._hold) == [True, False]
    q = rng.normal(0.0, 1.0, 4)
    truth = PinocchioChain(chain, masses={} if camera is None else {link: camera})
    torques = quick.bear @ truth.efforts(quick.follow @ q[: quick.moved], up)
    for each in (quick, python):
        np.testing.assert_allclose(each.effort(q)[: each.moved], torques, atol=TRUE, rtol=TRUE)
    np.testing.assert_allclose(quick.efforts, python.efforts, atol=SAME, rtol=SAME)
