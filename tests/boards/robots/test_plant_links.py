"""Links that follow others: an Si arm's parallelogram and a snake's bends move as one rigid mechanism."""

from __future__ import annotations

import dataclasses

import mujoco
import numpy as np
import pytest

from tests import stock
from tests.boards.robots.arms import LND_SI, PERIOD, SNAKE, arm, holding, psm, robot, run, si, system
from trocar.procs.boards.robots.mechanics import MARGIN, MARGIN_SLIDE, WRIST_FRICTION
from trocar.procs.boards.robots.plant import Plant
from trocar.procs.document.system import Chain, ModelVariation, Tool
from trocar.procs.kinematics.coupling import coupling
from trocar.procs.kinematics.forward import Kinematics

PSM_EFFORT = np.array((17.0, 17.0, 40.0, 0.34, 0.34, 0.34, 0.34))
PSM_GAINS = (np.array((600.0, 600.0, 6000.0, *(6.0,) * 4)), np.array((30.0, 30.0, 200.0, *(0.08,) * 4)))
ECM_EFFORT = np.array((17.0, 34.0, 70.0, 6.0))
ECM_GAINS = (np.array((600.0, 600.0, 15000.0, 100.0)), np.array((30.0, 30.0, 500.0, 3.0)))
FREE = ModelVariation("PSM", friction=0.0)


def joints_of(chain: Chain, tool: Tool | None, joints: np.ndarray) -> np.ndarray:
    """Joints of the kinematics from those of the robot: a snake's bends come in pairs, the jaw is none."""
    if tool is None or not tool.snake:
        return joints[: len(chain.links) + (len(tool.links) if tool else 0)].copy()
    pitch, yaw = 0.5 * joints[4:6]
    return np.array((*joints[:4], pitch, yaw, yaw, pitch))


@pytest.mark.parametrize(("generation", "tool"), [("Si", ""), ("Si", LND_SI), ("Si", SNAKE), ("Classic", SNAKE)])
def test_the_tip_is_where_the_kinematics_say_while_it_moves(generation: str, tool: str) -> None:
    plant = si("PSM", -0.7, tool) if generation == "Si" else psm(tool)
    name = "PSM" if generation == "Si" else "PSM1"
    chain, held = stock.chain("PSM_Si" if generation == "Si" else "PSM"), stock.tool(tool) if tool else None
    pair, kinematics = coupling(7, chain, held), Kinematics(chain, held)
    rng = np.random.default_rng(3)
    for _ in range(20):
        effort = rng.normal(size=7) * PSM_EFFORT * (1.0 if generation == "Si" else 0.1)
        run(plant, effort, 20)
        joints = joints_of(chain, held, pair.actuator_to_joint @ plant.position)
        np.testing.assert_allclose(plant.tip(name), kinematics.fk(joints), atol=1e-9)
    assert np.abs(plant.velocity).max() > 0.1


def test_a_parallelogram_moves_as_its_reduced_equations_say() -> None:
    plant = si("PSM", -0.7, LND_SI, like=FREE)
    rng = np.random.default_rng(5)
    followers = [plant.model.joint(f"PSM/{i}").dofadr[0] for i in range(7, 12)]
    leaders = [plant.model.joint(f"PSM/{i}").dofadr[0] for i in range(7)]
    reduced = np.zeros((plant.model.nv, 7))
    reduced[leaders, range(7)] = 1.0
    reduced[followers] = np.array(((0, 1, 0), (0, -1, 0), (0, 1, 0), (0, 0, 0.5), (0, 0, 0.5))) @ np.eye(3, 7)
    for _ in range(30):
        run(plant, rng.normal(size=7) * PSM_EFFORT, 10)
        data, before = mujoco.MjData(plant.model), plant.data.qvel[leaders].copy()
        data.qpos, data.qvel = plant.data.qpos, plant.data.qvel
        mujoco.mj_forward(plant.model, data)
        mass = np.zeros((plant.model.nv, plant.model.nv))
        mujoco.mj_fullM(plant.model, data, mass)
        plant.step(np.zeros(7))
        force = reduced.T @ (data.qfrc_passive + data.qfrc_constraint - data.qfrc_bias)
        wanted = np.linalg.solve(reduced.T @ mass @ reduced, force)
        np.testing.assert_allclose((plant.data.qvel[leaders] - before) / PERIOD, wanted, atol=1e-6)
        np.testing.assert_allclose(plant.data.qvel, reduced @ plant.data.qvel[leaders], atol=1e-11)
        np.testing.assert_allclose(plant.data.qpos, reduced @ plant.data.qpos[leaders], atol=1e-14)


def test_a_falling_si_arm_keeps_its_energy() -> None:
    plant = si("PSM", -0.7, like=FREE)
    plant.place("PSM", np.array((0.5, 0.6, 0.02, 0.0, 0.0, 0.0, 0.0)))
    model, data = plant.model, plant.data
    weights = model.body_mass * (1.0 - model.body_gravcomp) * 9.81
    mass = np.zeros((model.nv, model.nv))
    total, kinetic = [], 0.0
    for _ in range(200):
        mujoco.mj_forward(model, data)
        mujoco.mj_fullM(model, data, mass)
        kinetic = 0.5 * data.qvel @ mass @ data.qvel
        total.append(kinetic + weights @ data.xipos[:, 2])
        plant.step(np.zeros(7))
    assert kinetic > 2.0
    np.testing.assert_allclose(total, total[0], atol=0.01 * kinetic)


@pytest.mark.slow
@pytest.mark.parametrize("direction", [-1.0, 1.0])
def test_stops_of_an_si_arm_hold_motors_and_weight(direction: float) -> None:
    plant = si("PSM", -0.7)
    links = stock.chain("PSM_Si").links
    limits = [link.upper if direction > 0 else link.lower for link in links] + [direction * 3.002] * 4
    run(plant, direction * PSM_EFFORT, 5000)
    beyond = direction * (plant.position - np.array(limits))
    assert (beyond >= 0.0).all()
    assert (beyond[:3] <= (0.032, 0.032, 0.004)).all(), "the margin, and hardly more"


@pytest.mark.parametrize("kind", ["PSM", "ECM"])
def test_an_si_arm_that_fell_lies_firmly_on_its_stops(kind: str) -> None:
    plant = si(kind, endoscope=1.8)
    run(plant, np.zeros(plant.axes), 3000)
    _, pitch, insertion, *_ = stock.chain(f"{kind}_Si").links
    assert plant.position[1] == pytest.approx(pitch.lower - MARGIN, abs=1e-3)
    assert plant.position[2] == pytest.approx(insertion.upper + MARGIN_SLIDE, abs=1e-4)


@pytest.mark.parametrize("kind", ["PSM", "ECM"])
def test_a_hand_carries_an_si_arm_however_long_it_takes_until_its_next_motion(kind: str) -> None:
    plant = si(kind, -0.7, endoscope=1.8)
    plant.support(kind, True)
    for share in (0.2, 0.3):
        goal = plant.position + share * np.array((0.3, 0.2, 0.05, 0.3, -0.1, 0.2, 0.2))[: plant.axes]
        plant.place(kind, goal)
        run(plant, np.zeros(plant.axes), 2000)
        np.testing.assert_allclose(plant.position, goal, atol=1e-4)
    plant.support(kind, False)
    run(plant, np.zeros(plant.axes), 200)
    assert abs(plant.position - goal).max() > 0.01


@pytest.mark.parametrize(("kind", "tool"), [("PSM", ""), ("PSM", LND_SI), ("PSM", SNAKE), ("ECM", "")])
def test_si_arms_follow_and_settle_under_their_stock_gains(kind: str, tool: str) -> None:
    plant = si(kind, -0.7, tool, endoscope=1.8)
    kp, kd = PSM_GAINS if kind == "PSM" else ECM_GAINS
    most = PSM_EFFORT if kind == "PSM" else ECM_EFFORT
    start = plant.position.copy()
    goal = start + np.array((0.3, 0.2, 0.05, 0.3, -0.1, 0.2, 0.2))[: plant.axes]
    weight = holding(si(kind, -0.7, tool, 1.8, ModelVariation(kind, friction=0.0)), kind, goal)
    waiting = [np.zeros(plant.axes)]  # one period late
    for k in range(2500):
        share = min(k / 1500, 1.0)
        wanted = start + (3 - 2 * share) * share**2 * (goal - start)
        waiting.append(weight + np.clip(kp * (wanted - plant.position) - kd * plant.velocity, -most, most))
        plant.step(waiting.pop(0))
    np.testing.assert_allclose(plant.position, goal, atol=5e-3)
    np.testing.assert_allclose(plant.velocity, 0.0, atol=2e-3)


def test_an_instrument_change_keeps_a_parallelogram_in_place() -> None:
    plant = si("PSM", -0.7)
    run(plant, np.array((5.0, 0.0, 0.0, 0.1, 0.0, 0.0, 0.0)), 20)
    position, velocity = plant.position.copy(), plant.velocity.copy()
    plant.insert_tool("PSM", stock.tool(LND_SI))
    np.testing.assert_array_equal(plant.position, position)
    plant.step(np.zeros(7))
    np.testing.assert_allclose(plant.position[:3], (position + PERIOD * velocity)[:3], atol=1e-4)


@pytest.mark.parametrize("kind", ["PSM", "ECM"])
def test_the_real_links_of_an_si_arm_end_where_its_kinematics_do(kind: str) -> None:
    plant = si(kind)
    plant.place(kind, np.array((0.4, -0.3, 0.1, 0.0, 0.0, 0.0, 0.0))[: plant.axes])
    mujoco.mj_kinematics(plant.model, plant.data)
    last, known = plant.data.body(plant.model.nbody - 1), plant.data.body(f"{kind}/2")
    np.testing.assert_allclose(last.xpos, known.xpos, atol=2e-4)
    np.testing.assert_allclose(last.xmat, known.xmat, atol=1e-5)


def test_robots_with_more_and_fewer_rows_do_not_disturb_each_other() -> None:
    psm_si, ecm_si = si("PSM", -0.7, LND_SI), si("ECM", -0.7, endoscope=1.8)
    classic = psm(SNAKE)
    arms = [dataclasses.replace(arm(kind, kind, f"{kind}_Si", tool), generation="Si", mounting_pitch=-0.7)
            for kind, tool in (("PSM", LND_SI), ("ECM", ""))]
    camera = stock.chain("ECM_Si_physical")
    camera = dataclasses.replace(camera, links=(*camera.links[:-1], dataclasses.replace(camera.links[-1], mass=1.8)))
    robots = (robot("PSM1", "RRPRRRR"), robot("PSM", "RRPRRRR"), robot("PSM9", "R"), robot("ECM", "RRPR"))
    together = Plant(system(robots, (arm("PSM1", "PSM", "PSM", SNAKE), *arms)),
                     {"PSM": stock.chain("PSM_Si_physical"), "ECM": camera})
    rng = np.random.default_rng(8)
    for name, alone in (("PSM1", classic), ("PSM", psm_si), ("ECM", ecm_si)):
        together.place(name, alone.position)
    for plant, name in ((ecm_si, "ECM"), (together, "ECM")):
        plant.brake(name, np.array((True, False, False, False)), True)
    for _ in range(50):
        efforts = rng.normal(size=together.axes) * np.array((*(0.1 * PSM_EFFORT), *PSM_EFFORT, 0.0, *ECM_EFFORT))
        run(together, efforts, 4)
        for name, alone in (("PSM1", classic), ("PSM", psm_si), ("ECM", ecm_si)):
            run(alone, efforts[together.slices[name]], 4)
            np.testing.assert_allclose(together.position[together.slices[name]], alone.position, atol=1e-9)


def test_a_snakes_bend_has_the_friction_of_its_joint() -> None:
    for share, moves in ((0.9, False), (1.1, True)):
        plant = psm(SNAKE)
        plant.place("PSM1", np.zeros(7))
        plant.push("PSM1", share * np.array((0.0, 0.0, 0.0, 0.0, WRIST_FRICTION[1][1], 0.0, 0.0)))
        run(plant, np.zeros(7), 500)
        bend = (coupling(7, stock.chain("PSM"), stock.tool(SNAKE)).actuator_to_joint @ plant.position)[4]
        assert bool(abs(bend) > 0.01) is moves


def test_a_file_with_other_links_is_refused() -> None:
    one = arm("PSM", "PSM", "PSM_Si")
    with pytest.raises(ValueError, match="3 links with masses; allowed: 7"):
        Plant(system((robot("PSM", "RRPRRRR"),), (one,)), {"PSM": stock.chain("PSM_Si")})


@pytest.mark.parametrize(("file", "name", "expected"), [
    ("ECM", "Classic_SD_STRAIGHT", (-0.9278, 1.41582, -13.77753, 0.0)),
    ("ECM_Si", "Si_HD_STRAIGHT", (-2.7534, 10.11702, -16.53305, 0.0)),
])
def test_a_camera_arm_bears_the_endoscope_its_file_names(file: str, name: str, expected: tuple[float, ...]) -> None:
    one = dataclasses.replace(arm("ECM", "ECM", file), endoscope=name, mounting_pitch=0.0,
                              generation="Si" if file.endswith("Si") else "Classic",
                              links=stock.chain("ECM_Si_physical") if file.endswith("Si") else stock.chain("ECM"))
    plant = Plant(system((robot("ECM", "RRPR"),), (one,)))
    held = holding(plant, "ECM", np.array((0.2, -0.3, 0.15, 0.4)))
    np.testing.assert_allclose(held, expected, atol=1e-4)
