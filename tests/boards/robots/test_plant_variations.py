"""Robots that are not quite what their files say."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from tests import stock
from tests.boards.robots.arms import LND, LND_SI, PERIOD, arm, holding, psm, robot, run, si, system
from trocar.procs.boards.robots.plant import Plant
from trocar.procs.document.system import ModelVariation
from trocar.procs.kinematics.coupling import coupling

GAP = (0.004, 0.006, 0.001, 0.02, 0.02, 0.03, 0.03)
PUSH = np.array((0.5, -0.4, 2.0, 0.02, 0.01, -0.02, 0.02))


def creep(plant: Plant, effort: np.ndarray) -> None:
    """Efforts that grow so slowly that motors hardly bump into their joints."""
    for k in range(2000):
        plant.step(effort * min(k / 1500, 1.0))


def test_without_a_difference_nothing_changes() -> None:
    plain, alike = psm(), psm(LND, 1, 1, ModelVariation("PSM1", backlash=(0.0,) * 7, pot_offset=(0.0,) * 7))
    for plant in (plain, alike):
        run(plant, PUSH, 200)
    np.testing.assert_array_equal(plain.position, alike.position)
    np.testing.assert_array_equal(plain.velocity, alike.velocity)
    np.testing.assert_array_equal(plain.pot_position, alike.pot_position)


def test_a_likeness_of_nobody_is_refused() -> None:
    with pytest.raises(ValueError, match="PSM7: no such robot to vary; there are PSM1, PSM2"):
        psm(LND, 2, 1, ModelVariation("PSM7"))


@pytest.mark.parametrize("what", ["backlash", "pot_offset"])
def test_a_number_for_every_actuator_is_needed(what: str) -> None:
    with pytest.raises(ValueError, match=f"PSM1: 3 numbers of {what}; allowed: 7, one an actuator"):
        psm(LND, 1, 1, ModelVariation("PSM1", backlash=(0.1,) * 3) if what == "backlash" else
            ModelVariation("PSM1", pot_offset=(0.1,) * 3))


def test_more_friction_takes_more_to_move() -> None:
    for friction, moves in ((1.0, True), (3.0, False), (0.0, True)):
        plant = psm(LND, 1, 1, ModelVariation("PSM1", friction=friction))
        start = plant.position.copy()
        plant.push("PSM1", np.array((0.1, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)))
        run(plant, np.zeros(7), 500)
        assert bool(plant.position[0] - start[0] > 0.01) is moves


def test_heavier_motors_start_slower() -> None:
    speeds = []
    for inertia in (1.0, 2.0):
        plant = psm("", 1, 1, ModelVariation("PSM1", inertia=inertia, friction=0.0))
        plant.step(np.array((0.0, 0.0, 0.0, 0.1, 0.1, 0.1, 0.1)))
        speeds.append(plant.velocity[3:].copy())
    np.testing.assert_allclose(speeds[0], 2.0 * speeds[1], rtol=0.1)


def test_heavier_links_take_more_to_hold() -> None:
    place = np.array((0.2, -0.3, 0.15, 0.0, 0.0, 0.0, 0.0))
    usual, heavy = (holding(si("PSM", -0.7, LND_SI, like=ModelVariation("PSM", friction=0.0, mass=mass)), "PSM", place)
                    for mass in (1.0, 1.5))
    assert np.abs(usual[:3]).min() > 0.1
    np.testing.assert_allclose(heavy[:3], 1.5 * usual[:3], atol=1e-6)


def test_a_payload_weighs_at_the_tip() -> None:
    place = np.array((0.2, -0.3, 0.15, 0.3, 0.1, -0.2, 0.2))
    free = ModelVariation("PSM1", friction=0.0)
    loaded, light = psm(LND, 1, 1, dataclasses.replace(free, payload=0.2)), psm(LND, 1, 1, free)
    np.testing.assert_allclose(holding(light, "PSM1", place), 0.0, atol=1e-9)
    rise = []
    for unit in np.eye(7):
        light.place("PSM1", place)
        before = light.tip("PSM1")[2, 3]
        light.place("PSM1", place + 1e-6 * unit)
        rise.append((light.tip("PSM1")[2, 3] - before) / 1e-6)
    held = holding(loaded, "PSM1", place)
    np.testing.assert_allclose(held, 0.2 * 9.81 * np.array(rise), atol=1e-4)
    assert np.abs(held).max() > 0.1


def test_potentiometers_can_be_off() -> None:
    offset = (0.01, -0.02, 0.003, 0.0, 0.1, 0.0, 0.0)
    plant = psm(LND, 1, 1, ModelVariation("PSM1", pot_offset=offset))
    for _ in range(2):
        np.testing.assert_allclose(plant.pot_position - plant.position, offset, atol=1e-12)
        run(plant, PUSH, 20)
    plant.place("PSM1", np.zeros(7))
    np.testing.assert_allclose(plant.pot_position, offset, atol=1e-12)


@pytest.mark.parametrize(("tool", "discs"), [("", (0.0024,) * 4), (LND, (0.0025, 0.0071, 0.0096, 0.0096))])
def test_motors_turn_through_their_play_before_the_joints(tool: str, discs: tuple[float, ...]) -> None:
    plant = psm(tool, 1, 1, ModelVariation("PSM1", backlash=GAP))
    pair = coupling(7, stock.chain("PSM"), stock.tool(tool) if tool else None)
    start = plant.position.copy()
    effort = np.array((0.03, 0.036, 0.23, *discs))  # enough for the motors' half of the friction, not for all
    for direction in (1.0, -1.0, 1.0):
        creep(plant, direction * effort)
        joints = pair.joint_to_actuator @ plant.data.qpos
        np.testing.assert_allclose(plant.position - joints, 0.5 * direction * np.array(GAP), rtol=0.15)
        assert (np.abs(joints - start) < 0.4 * np.array(GAP)).all(), "hardly moved by bumps"
        np.testing.assert_allclose(plant.velocity, 0.0, atol=1e-9)


def test_joints_follow_when_the_play_is_used_up() -> None:
    plant = psm("", 1, 1, ModelVariation("PSM1", backlash=GAP))
    start, tip = plant.position.copy(), plant.tip("PSM1")
    run(plant, np.array((0.5, 0.0, 2.0, 0.0, 0.0, 0.0, 0.0)), 200)
    lead = np.array(GAP)[[0, 2]] * 0.5
    advance = (plant.position - start)[[0, 2]] - lead
    assert (advance > 0.02).all()
    depth = np.linalg.norm(plant.tip("PSM1")[:3, 3]) - np.linalg.norm(tip[:3, 3])
    assert abs(depth) == pytest.approx(advance[1], rel=0.05)


def test_with_play_an_arm_still_settles_under_the_stock_gains() -> None:
    kp, kd = np.array((120.0, 120.0, 6000.0, *(6.0,) * 4)), np.array((6.0, 5.0, 200.0, *(0.09,) * 4))
    plant = psm(LND, 1, 1, ModelVariation("PSM1", backlash=GAP))
    goal = plant.position + np.array((0.1, -0.1, 0.02, 0.2, 0.1, -0.1, 0.1))
    start, waiting = plant.position.copy(), [np.zeros(7)]
    for k in range(2000):
        wanted = start + min(k / 1000, 1.0) * (goal - start)
        waiting.append(kp * (wanted - plant.position) - kd * plant.velocity)
        plant.step(waiting.pop(0))
    np.testing.assert_allclose(plant.position, goal, atol=5e-3)
    np.testing.assert_allclose(plant.velocity, 0.0, atol=2e-3)


def test_potentiometers_on_the_joints_do_not_see_the_play() -> None:
    pair = coupling(7, stock.chain("MTML"))
    rows = tuple(tuple(float(v) for v in row) for row in pair.joint_to_actuator)
    master = dataclasses.replace(robot("MTML", "RRRRRRR"), joint_to_actuator_position=rows)
    like = ModelVariation("MTML", backlash=(0.01,) * 7)
    plant = Plant(system((master,), (arm("MTML", "MTM", "MTML"),), 1, like))
    start, pots = plant.position.copy(), plant.pot_position.copy()
    creep(plant, np.array((0.024, 0.046, 0.022, 0.006, 0.0012, 0.0012, 0.0006)))
    joints = pair.joint_to_actuator @ plant.pot_position
    np.testing.assert_allclose(plant.position - joints, 0.005, rtol=0.15)
    np.testing.assert_allclose(pair.joint_to_actuator @ pots, start, atol=1e-12)


def test_play_survives_an_instrument_change() -> None:
    plant = psm("", 1, 1, ModelVariation("PSM1", backlash=GAP))
    run(plant, PUSH, 50)
    position, velocity = plant.position.copy(), plant.velocity.copy()
    plant.insert_tool("PSM1", stock.tool(LND))
    np.testing.assert_array_equal(plant.position, position)
    plant.step(np.zeros(7))
    np.testing.assert_allclose(plant.position, position + PERIOD * velocity, atol=1e-3)
