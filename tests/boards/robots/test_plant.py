"""The plant: same geometry as the arm's kinematics, calm under the stock gains, no easier to move than a real arm."""

from __future__ import annotations

import dataclasses
from functools import cache

import mujoco
import numpy as np
import pytest

from tests import stock
from tests.boards.robots.arms import LND, PERIOD, arm, psm, robot, system
from tests.cases import cases
from trocar.procs.boards.robots.mechanics import DISC
from trocar.procs.boards.robots.plant import Plant
from trocar.procs.kinematics.coupling import coupling
from trocar.procs.tables.arm_types import ARM_TYPES

PSM_KP = np.array((120.0, 120.0, 6000.0, 6.0, 6.0, 6.0, 6.0))
PSM_KD = np.array((6.0, 5.0, 200.0, 0.09, 0.09, 0.09, 0.09))
PSM_EFFORT = np.array((3.3, 3.3, 19.0, 0.34, 0.34, 0.34, 0.34))
STOCK_KD = {
    ("PSM", "Classic"): (6, 5, 200),
    ("PSM", "Si"): (30, 30, 200),
    ("ECM", "Classic"): (30, 80, 1200, 0.5),
    ("ECM", "Si"): (30, 30, 500, 3),
    ("MTM", "Classic"): (10, 5, 5, 0.35, 0.028, 0.015, 0.005),
}


@cache
def recording() -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Positions, velocities, accelerations (a parabola over 11 samples of velocity) and efforts of the real arm."""
    rows = np.loadtxt(stock.find("real/psm_measured_one.csv"), delimiter=",")
    half, period = 5, 1 / 200
    weights = np.arange(-half, half + 1) / (period * np.sum(np.arange(-half, half + 1) ** 2))
    velocity = rows[:, 7:14]
    padded = np.pad(velocity, ((half, half), (0, 0)), mode="edge")
    acceleration = np.array([np.convolve(column, weights[::-1], "valid") for column in padded.T]).T
    return rows[:, :7], velocity, acceleration, rows[:, 14:]


def test_efforts_of_a_real_arm_are_explained() -> None:
    position, velocity, acceleration, effort = recording()
    plant = psm()
    needed = np.zeros_like(effort)
    for k in range(len(needed)):
        plant.data.qpos[:], plant.data.qvel[:], plant.data.qacc[:] = position[k], velocity[k], acceleration[k]
        mujoco.mj_inverse(plant.model, plant.data)
        needed[k] = plant.data.qfrc_inverse + np.sign(velocity[k]) * plant.friction.limit
    residual = ((effort - needed) ** 2).sum(axis=0)
    r_squared = 1.0 - residual / ((effort - effort.mean(axis=0)) ** 2).sum(axis=0)
    assert (r_squared[:3] >= (0.9, 0.8, 0.9)).all()


@pytest.mark.parametrize("tool", ["", LND])
def test_an_unpowered_psm_stays_where_it_is(tool: str) -> None:
    plant = psm(tool)
    start = plant.position.copy()
    for _ in range(3000):
        plant.step(np.zeros(7))
    np.testing.assert_allclose(plant.position, start, atol=1e-4)
    np.testing.assert_allclose(plant.velocity, 0.0, atol=1e-4)


def test_a_push_beyond_friction_moves_the_arm() -> None:
    plant = psm()
    start = plant.position.copy()
    plant.push("PSM1", np.array((0.2, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0)))
    for _ in range(500):
        plant.step(np.zeros(7))
    assert plant.position[0] - start[0] > 0.05
    assert plant.position[2] - start[2] > 0.02
    plant.push("PSM1", np.zeros(7))
    for _ in range(3000):
        plant.step(np.zeros(7))
    np.testing.assert_allclose(plant.velocity, 0.0, atol=1e-3)


def test_a_camera_arm_with_a_mass_falls() -> None:
    chain = stock.chain("ECM")
    link = dataclasses.replace(chain.links[2], mass=1.5, com=(0.0, 0.0, -0.1))
    heavy = dataclasses.replace(chain, links=(*chain.links[:2], link, chain.links[3]))
    plant = Plant(
        system(
            (robot("ECM", "RRPR"),), (dataclasses.replace(arm("ECM", "ECM", "ECM"), chain=heavy, mounting_pitch=0.0),)
        )
    )
    start = plant.position[2]
    for _ in range(200):
        plant.step(np.zeros(4))
    assert plant.position[2] > start + 0.01


@pytest.mark.slow
@pytest.mark.parametrize("direction", [-1.0, 1.0])
def test_stops_hold_full_motor_effort(direction: float) -> None:
    plant = psm("")
    chain = stock.chain("PSM")
    limit = np.array([link.upper if direction > 0 else link.lower for link in chain.links] + [direction * 3.002] * 4)
    for _ in range(5000):
        plant.step(direction * PSM_EFFORT)
    beyond = direction * (plant.position - limit)
    assert (beyond >= 0.0).all(), "the host must be able to reach its own limits"
    assert (beyond[[0, 1, 3, 4, 5, 6]] <= 0.06).all()
    assert beyond[2] <= 0.006


@pytest.mark.slow
@pytest.mark.parametrize(("tool", "delay"), [
    ("", 1), (LND, 2), ("LARGE_NEEDLE_DRIVER_420006", 1), ("NEEDLE_DRIVER_400117", 2)])
def test_stock_gains_follow_and_settle(tool: str, delay: int) -> None:
    plant = psm(tool)
    goal, start = plant.position.copy(), plant.position.copy()
    waiting = [np.zeros(7)] * (delay - 1)
    for k in range(3000):
        share = min(k / 1500, 1.0)
        goal[:] = start + (3 - 2 * share) * share**2 * np.array((0.3, 0.2, 0.05, 0.3, -0.1, 0.3, 0.3))
        effort = np.clip(PSM_KP * (goal - plant.position) - PSM_KD * plant.velocity, -PSM_EFFORT, PSM_EFFORT)
        waiting.append(effort)
        plant.step(waiting.pop(0))
    np.testing.assert_allclose(plant.velocity, 0.0, atol=2e-3)
    np.testing.assert_allclose(plant.position, goal, atol=5e-3)


def test_every_axis_is_heavy_enough_for_its_gain() -> None:
    for (name, generation), gains in STOCK_KD.items():
        for inertia, gain in zip(ARM_TYPES[name].plant[generation].joints, gains, strict=True):
            assert inertia.armature >= 2 * gain * PERIOD
    assert DISC.armature >= 2 * PSM_KD[3] * PERIOD


@cases("tool", stock.TOOLS)
def test_every_instrument_is_heavy_enough_for_the_gains_and_stands_within_its_stops(tool: str) -> None:
    plant = psm(tool)
    assert np.linalg.eigvalsh(plant.motor_inertia()[3:, 3:]).min() >= 2 * PSM_KD[3] * PERIOD
    lower, upper = plant.model.jnt_range.T
    assert ((plant.data.qpos >= lower) & (plant.data.qpos <= upper)).all()


def test_currents_are_efforts_by_the_files_scale() -> None:
    by_current, by_effort = psm(), psm()
    current = np.array((0.3, -0.2, 1.0, 0.02, 0.02, -0.02, 0.01))
    for _ in range(100):
        by_current.step_current(current)
        by_effort.step(current / 0.5)
    np.testing.assert_array_equal(by_current.position, by_effort.position)


def test_discs_move_the_wrist_through_the_coupling() -> None:
    plant = psm()
    pair = coupling(7, stock.chain("PSM"), stock.tool(LND))
    effort = np.array((0.0, 0.0, 0.0, 0.05, -0.04, 0.03, 0.03))
    for _ in range(100):
        plant.step(effort)
    np.testing.assert_allclose(pair.actuator_to_joint @ plant.position, plant.data.qpos, atol=1e-12)
    np.testing.assert_allclose(pair.actuator_to_joint @ plant.velocity, plant.data.qvel, atol=1e-12)
    np.testing.assert_allclose(plant.effort @ plant.data.qvel, effort @ plant.velocity, atol=1e-12)


def test_an_instrument_comes_and_goes_without_a_jump() -> None:
    plant = psm("")
    plant.step(np.array((0.5, 0.0, 0.0, 0.05, 0.0, 0.0, 0.0)))
    position, velocity = plant.position.copy(), plant.velocity.copy()
    assert plant.instrument("PSM1") == ""
    plant.insert_tool("PSM1", stock.tool(LND))
    assert plant.instrument("PSM1") == LND
    np.testing.assert_array_equal(plant.position, position)
    plant.step(np.zeros(7))
    np.testing.assert_allclose(plant.position, position + PERIOD * velocity, atol=1e-3)
    plant.remove_tool("PSM1")
    plant.step(np.zeros(7))
    np.testing.assert_allclose(plant.position, position, atol=1e-2)


def test_the_seed_decides_where_arms_stand() -> None:
    np.testing.assert_array_equal(psm(seed=5).position, psm(seed=5).position)
    assert np.abs(psm(seed=5).position - psm(seed=6).position).max() > 1e-4
    assert (np.abs(psm().position) > 1e-3).all()


@cases(("file", "seed"), [
    ("PSM", 1), ("PSM_Si", 2), ("ECM", 3), ("ECM_Si", 1), ("MTML", 2), ("MTMR", 3)])
def test_every_arm_stands_well_within_its_limits_at_switch_on(file: str, seed: int) -> None:
    kind, chain = file[:3], stock.chain(file)
    types = {"PSM": "RRPRRRR", "ECM": "RRPR", "MTM": "RRRRRRR"}[kind]
    one = dataclasses.replace(arm(file, kind, file), generation="Si" if file.endswith("Si") else "Classic")
    plant = Plant(system((robot(file, types),), (one,), seed))
    joints = (coupling(len(types), chain).actuator_to_joint @ plant.position)[: len(chain.links)]
    lower, upper = np.array([(link.lower, link.upper) for link in chain.links]).T
    room = np.array([0.02 if link.joint_type == "prismatic" else 0.1 for link in chain.links])
    assert ((joints > lower + room) & (joints < upper - room)).all()


def test_robots_without_an_arm_are_loose_axes() -> None:
    plant = Plant(system((robot("PSM1", "RRPRRRR"), robot("gripper", "R")), (arm("PSM1", "PSM", "PSM"),)))
    assert plant.axes == 8
    assert plant.slices["gripper"] == slice(7, 8)
    for _ in range(100):
        plant.step(np.full(8, 0.01))
    assert plant.velocity[7] > 0


def test_potentiometers_sit_on_the_joints_where_the_file_says_so() -> None:
    chain = stock.chain("MTML")
    pair = coupling(7, chain)
    rows = tuple(tuple(float(v) for v in row) for row in pair.joint_to_actuator)
    master = dataclasses.replace(robot("MTML", "RRRRRRR"), joint_to_actuator_position=rows)
    plant = Plant(system((master,), (arm("MTML", "MTM", "MTML"),)))
    plant.step(np.zeros(7))
    np.testing.assert_allclose(plant.pot_position, pair.actuator_to_joint @ plant.position, atol=1e-12)
