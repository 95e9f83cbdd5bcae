"""Inverse kinematics against the goals of the original routines, the whole workspace, and goals that cannot be had."""

from __future__ import annotations

import json
import math
from functools import cache
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from tests import stock
from tests.cases import cases
from tests.examples import examples
from trocar.procs.kinematics.forward import Kinematics
from trocar.procs.kinematics.inverse.arms import BENDS, inverse_of
from trocar.procs.kinematics.inverse.master import Master
from trocar.procs.kinematics.inverse.solver import InverseSolver
from trocar.procs.kinematics.poses import rotation_from_vector

STRAIGHT = np.array(((0.0, 1.0, 0.0, 0.0), (-1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0), (0.0, 0.0, 0.0, 1.0)))
TILT = rotation_from_vector(np.array((math.radians(30.0), 0.0, 0.0)))
LND, SI_LND, SNAKE = "LARGE_NEEDLE_DRIVER_400006", "LARGE_NEEDLE_DRIVER_420006", "NEEDLE_DRIVER_400117"
ARMS = {
    "PSM_LARGE_NEEDLE_DRIVER_400006": ("PSM", "PSM", LND),
    "PSM_PROGRASP_FORCEPS_400093": ("PSM", "PSM", "PROGRASP_FORCEPS_400093"),
    "PSM_Si_LARGE_NEEDLE_DRIVER_420006": ("PSM", "PSM_Si", SI_LND),
    "PSM_NEEDLE_DRIVER_400117_snake": ("PSM", "PSM", SNAKE),
    "ECM_straight": ("ECM", "ECM", ""),
    "ECM_Si_up": ("ECM", "ECM_Si", ""),
    "MTML": ("MTM", "MTML", ""),
    "MTMR": ("MTM", "MTMR", ""),
}
RECORDED = ("PSM_LARGE_NEEDLE_DRIVER_400006", "PSM_NEEDLE_DRIVER_400117_snake", "ECM_straight", "MTML")
MAX_STEPS = 40


@cache
def arm(name: str) -> tuple[InverseSolver, Kinematics]:
    """Solver and forward kinematics with the tip."""
    arm_type, chain_name, tool_name = ARMS[name]
    chain, tool = stock.chain(chain_name), stock.tool(tool_name) if tool_name else None
    tip = None
    if arm_type == "ECM":
        tip = STRAIGHT.copy()
        if name.endswith("up"):
            tip[:3, :3] = tip[:3, :3] @ TILT
    return inverse_of(arm_type, chain, tool, tip), Kinematics(chain, tool, tip)


def spread(forward: Kinematics, parts: list[float]) -> Any:
    """Joints at these parts (0 to 1) of their ranges; a snake's second bends repeat the first."""
    q = forward.lower + (forward.upper - forward.lower) * np.array(parts[: forward.n])
    return BENDS @ q[:6] if forward.n == len(BENDS) else q


def assert_reached(solver: InverseSolver, forward: Kinematics, goal: Any) -> None:
    tip = forward.fk(solver.q)
    assert np.abs(tip[:3, 3] - goal[:3, 3]).max() < 1e-7
    assert np.abs(tip[:3, :3] - goal[:3, :3]).max() < 1e-6
    assert np.all(solver.q >= forward.lower) and np.all(solver.q <= forward.upper)
    assert (solver.reason, solver.axis) == ("", -1)


@pytest.mark.parametrize("name", RECORDED)
def test_goals_of_the_original_routines_are_reached_from_near_and_from_home(name: str) -> None:
    solver, forward = arm(name)
    seeds = 0
    for line in stock.find(f"golden/kinematics/{name}.jsonl").read_text().splitlines()[1:]:
        record = json.loads(line)
        for each in record.get("ik", ()):
            goal = np.array(record["fk"])
            assert solver.solve(goal, np.array(each["seed"])), (each["kind"], record["i"], solver.reason)
            assert_reached(solver, forward, goal)
            assert solver.steps <= MAX_STEPS
            seeds += 1
    assert seeds >= 300


@pytest.mark.parametrize("name", ARMS)
@examples(60)
@given(parts=st.lists(st.floats(0.0, 1.0), min_size=7, max_size=7), seed=st.lists(st.floats(0.0, 1.0), min_size=7,
                                                                                 max_size=7))
def test_wherever_an_arm_can_be_it_can_be_sent(name: str, parts: list[float], seed: list[float]) -> None:
    solver, forward = arm(name)
    goal = forward.fk(spread(forward, [*parts, 0.5])).copy()
    depth = np.linalg.norm(forward.fk_to(spread(forward, [*parts, 0.5]), 4)[:3, 3])
    # A shaft that ends in the remote centre shows its direction nowhere; snakes find it from their wrist's length on.
    assume(ARMS[name][0] == "MTM" or depth > (0.011 if forward.n == len(BENDS) else 1e-3))
    assert solver.solve(goal, spread(forward, [*seed, 0.5])), solver.reason
    assert_reached(solver, forward, goal)


@cases("name", ARMS)
def test_goals_out_of_reach_are_refused_with_the_joint_to_blame(name: str) -> None:
    solver, forward = arm(name)
    refused = 0
    for line in stock.find("golden/kinematics/ik_unreachable.jsonl").read_text().splitlines():
        record = json.loads(line)
        if record["arm"] != name:
            continue
        goal, seed = np.array(record["goal"]), np.array(record["ik"]["seed"])
        if solver.solve(goal, seed):
            if ARMS[name][0] == "ECM":  # where it looks follows from the place
                np.testing.assert_allclose(forward.fk(solver.q)[:3, 3], goal[:3, 3], atol=1e-7)
            else:
                assert_reached(solver, forward, goal)
            continue
        refused += 1
        assert np.array_equal(solver.q, seed) and solver.reason and solver.steps <= MAX_STEPS
        if solver.axis >= 0:
            assert solver.reason.startswith(f"{solver.kinematics.names[solver.axis]} would be ")
            assert "its limit" in solver.reason
    assert refused >= 8


@cases("name", ARMS)
def test_metres_away_is_refused(name: str) -> None:
    solver, forward = arm(name)
    middle = spread(forward, [0.5] * 8)
    goal = forward.fk(middle).copy()
    goal[:3, 3] += (3.0, 0.0, -2.0)
    assert not solver.solve(goal, middle)
    assert solver.reason and np.array_equal(solver.q, middle)


@cases("name", ARMS)
@cases("value", [math.nan, math.inf, 1e300])
def test_what_is_no_number_is_refused(name: str, value: float) -> None:
    solver, forward = arm(name)
    middle = spread(forward, [0.5] * 8)
    goal = forward.fk(middle).copy()
    for place in ((0, 0), (2, 3)) if not math.isfinite(value) else ((2, 3),):
        wrong = goal.copy()
        wrong[place] = value
        with np.errstate(all="ignore"):
            assert not solver.solve(wrong, middle)
        assert np.array_equal(solver.q, middle) and solver.reason
    broken = middle.copy()
    broken[0] = math.nan
    assert not solver.solve(goal, broken) and solver.reason == "goal or seed is not finite"


PSM_Q = np.array((0.2, -0.3, 0.15, 0.4, -0.5, 0.6))


@pytest.mark.parametrize(("shift", "turn", "expected"), [
    ((0.010, -0.005, 0.003), 0.0, (0.275590, -0.267787, 0.148061, 0.464517, -0.498835, 0.509569)),
    ((0.0, 0.0, 0.0), 0.2, (0.190934, -0.297873, 0.150504, 0.593801, -0.611086, 0.501626)),
])
def test_an_independent_model_finds_the_same_joints(
        shift: tuple[float, ...], turn: float, expected: tuple[float, ...]) -> None:
    solver, forward = arm("PSM_LARGE_NEEDLE_DRIVER_400006")
    goal = forward.fk(PSM_Q).copy()
    goal[:3, 3] += shift
    goal[:3, :3] = goal[:3, :3] @ rotation_from_vector(np.array((0.0, 0.0, turn)))
    assert solver.solve(goal, PSM_Q)
    np.testing.assert_allclose(solver.q, expected, atol=1e-6, rtol=0)


@pytest.mark.parametrize("roll", [-4.4, -2.0, 2.0, 4.4])
def test_a_roll_stays_on_the_turn_it_is_on(roll: float) -> None:
    solver, forward = arm("PSM_LARGE_NEEDLE_DRIVER_400006")
    q = PSM_Q.copy()
    q[3] = roll
    goal = forward.fk(q).copy()
    assert solver.solve(goal, q + 0.01 * np.array((1, 1, 0.1, 1, 1, 1)))
    assert solver.q[3] == pytest.approx(roll, abs=1e-6)
    seed = q.copy()
    seed[:3] += (-0.8, 0.7, 0.05)  # far away: the geometry's answer comes on the same turn
    seed[3] += 0.1 * math.copysign(1.0, -roll)
    assert solver.solve(goal, seed) and solver.q[3] == pytest.approx(roll, abs=1e-6)


def test_a_seed_that_is_close_takes_two_or_three_steps() -> None:
    solver, forward = arm("PSM_LARGE_NEEDLE_DRIVER_400006")
    goal = forward.fk(PSM_Q).copy()
    assert solver.solve(goal, PSM_Q + 2e-4 * np.array((1, -1, 0.1, 1, -1, 1)))
    assert solver.steps <= 3


def test_an_endoscope_looks_along_its_shaft_and_tells_by_how_much_a_goal_was_tilted() -> None:
    solver, forward = arm("ECM_straight")
    q = np.array((0.2, -0.3, 0.15, 0.4))
    goal = forward.fk(q).copy()
    assert solver.solve(goal, q) and solver.tilt == pytest.approx(0.0, abs=1e-6)  # type: ignore[attr-defined]
    goal[:3, :3] = rotation_from_vector(np.array((0.3, 0.0, 0.0))) @ goal[:3, :3]
    assert solver.solve(goal, q) and 0.1 < solver.tilt <= 0.3  # type: ignore[attr-defined]
    np.testing.assert_allclose(forward.fk(solver.q)[:3, 3], goal[:3, 3], atol=1e-9)
    goal[:3, :3] = goal[:3, :3] @ rotation_from_vector(np.array((math.pi, 0.0, 0.0)))
    assert not solver.solve(goal, q) and "away from the shaft" in solver.reason


def test_what_no_solver_fits_is_refused_by_name() -> None:
    with pytest.raises(ValueError, match="PSM: no inverse kinematics for PSM of 3 joints"):
        inverse_of("PSM", stock.chain("PSM"))
    with pytest.raises(ValueError, match="no inverse kinematics for MTM of 4 joints"):
        inverse_of("MTM", stock.chain("ECM"))


@pytest.mark.parametrize("name", ("MTML", "MTMR"))
@given(st.lists(st.floats(0.0, 1.0), min_size=17, max_size=17))
@examples(40)
def test_a_masters_wrist_faces_where_it_is_told_wherever_the_arm_is(name: str, parts: list[float]) -> None:
    _, forward = arm(name)
    here, seed = spread(forward, parts[:7]), spread(forward, parts[7:14])
    goal = forward.fk(spread(forward, [*parts[14:], *parts[3:7]]), np.eye(4)).copy()
    found = Master(stock.chain(name)).facing(goal[:3, :3], here, seed)
    assume(found is not None)
    assert np.array_equal(found[:3], here[:3]) and abs(found[5]) <= forward.upper[5]
    tip = forward.fk(found, np.eye(4))
    assert np.abs(tip[:3, :3] - goal[:3, :3]).max() < 1e-4
    assert np.abs(found[4:] - seed[4:])[[0, 2]].max() <= math.pi + 1e-9
