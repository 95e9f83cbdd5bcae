"""What people and brakes do to robots: pull at a tip, put an axis somewhere, hold an actuator."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from tests import stock
from tests.boards.robots.arms import LND, LND_SI, PERIOD, SNAKE, arm, psm, robot, run, si, system
from trocar.procs.boards.robots.mechanics import GRIPPER_INITIAL
from trocar.procs.boards.robots.plant import Plant
from trocar.procs.document.system import ModelVariation
from trocar.procs.kinematics.coupling import coupling
from trocar.procs.kinematics.forward import Kinematics

FIRST_THREE = np.array((True, True, True, False, False, False, False))
FREE = ModelVariation("PSM1", friction=0.0)


def master() -> Plant:
    """A master with its gripper, as the site's files have them."""
    gripper = robot("MTML_gripper", "R")
    loose = dataclasses.replace(gripper.actuators[0], effort_to_current=0.0, encoder=None)
    robots = robot("MTML", "RRRRRRR"), dataclasses.replace(gripper, actuators=(loose,))
    return Plant(system(robots, (dataclasses.replace(arm("MTML", "MTM", "MTML"), mounting_pitch=0.3),)))


@pytest.mark.parametrize("tool", [LND, SNAKE])
def test_the_tip_moves_as_its_twist_says(tool: str) -> None:
    plant = psm(tool)
    run(plant, np.array((0.5, -0.4, 2.0, 0.05, 0.02, -0.05, 0.05)), 100)
    before = plant.tip("PSM1")
    plant.step(np.zeros(7))
    twist, after = plant.tip_twist("PSM1"), plant.tip("PSM1")
    np.testing.assert_allclose((after - before)[:3, 3] / PERIOD, twist[:3], atol=1e-3)
    turning = (after - before)[:3, :3] @ after[:3, :3].T / PERIOD
    np.testing.assert_allclose((turning[2, 1], turning[0, 2], turning[1, 0]), twist[3:], rtol=0.02)
    assert np.abs(twist[:3]).max() > 0.05
    assert np.abs(twist[3:]).max() > 1.0


def test_a_pull_at_the_tip_is_a_push_of_the_joints() -> None:
    wrench = np.array((3.0, -2.0, 4.0, 0.02, 0.05, -0.03))
    pulled, pushed = psm(LND, 1, 1, FREE), psm(LND, 1, 1, FREE)
    joints = (coupling(7, stock.chain("PSM"), stock.tool(LND)).actuator_to_joint @ pulled.position)
    kinematics = Kinematics(stock.chain("PSM"), stock.tool(LND))
    kinematics.update(joints[:6].copy())
    turn = kinematics.tip[:3, :3]
    body = np.concatenate((turn.T @ wrench[:3], turn.T @ wrench[3:]))
    pushed.push("PSM1", np.append(kinematics.body.T @ body, 0.0))
    pulled.pull("PSM1", wrench)
    for plant in (pulled, pushed):
        plant.step(np.zeros(7))
    assert np.abs(pushed.velocity).max() > 1e-3
    np.testing.assert_allclose(pulled.velocity, pushed.velocity, atol=1e-9)


def test_a_pull_is_in_the_axes_of_a_tilted_base() -> None:
    plant = si("PSM", -0.7, LND_SI, like=ModelVariation("PSM", friction=0.0))
    twin = si("PSM", -0.7, LND_SI, like=ModelVariation("PSM", friction=0.0))
    plant.pull("PSM", np.array((0.0, 0.0, -50.0, 0.0, 0.0, 0.0)))
    for one in (plant, twin):
        one.step(np.zeros(7))
    pulled = plant.tip_twist("PSM") - twin.tip_twist("PSM")
    assert pulled[2] < -0.01


def test_a_pull_lasts_one_step_and_adds_up() -> None:
    plant, twin = psm(LND, 1, 1, FREE), psm(LND, 1, 1, FREE)
    force = np.array((5.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    for part in (0.5, 0.5):
        plant.pull("PSM1", part * force)
    twin.pull("PSM1", force)
    for one in (plant, twin):
        one.step(np.zeros(7))
    np.testing.assert_allclose(plant.velocity, twin.velocity, atol=1e-12)
    speed = plant.velocity[:3].copy()
    run(plant, np.zeros(7), 49)
    plant.pull("PSM1", np.zeros(6))
    plant.step(np.zeros(7))
    np.testing.assert_allclose(plant.velocity[:3], speed, atol=1e-2 * np.abs(speed).max())


def test_hooks_run_before_every_step() -> None:
    plant, twin = psm(LND, 1, 1, FREE), psm(LND, 1, 1, FREE)
    force, seen = np.array((5.0, 0.0, 0.0, 0.0, 0.0, 0.0)), []
    plant.before_step += [lambda: seen.append(plant.position.copy()), lambda: plant.pull("PSM1", force)]
    for k in range(10):
        np.testing.assert_array_equal(plant.position, twin.position)
        twin.pull("PSM1", force)
        twin.step(np.zeros(7))
        plant.step(np.zeros(7))
        assert len(seen) == k + 1
    np.testing.assert_array_equal(plant.position, twin.position)
    assert np.abs(seen[-1] - seen[0]).max() > 0.0


@pytest.mark.parametrize("kind", ["PSM", "ECM"])
def test_brakes_hold_an_arm_without_motors(kind: str) -> None:
    plant = si(kind, -0.7, endoscope=1.8)
    count = plant.axes
    start = plant.position.copy()
    plant.brake(kind, np.arange(count) < 3, True)
    run(plant, np.zeros(count), 3000)
    np.testing.assert_allclose(plant.position, start, atol=1e-12)
    plant.brake(kind, np.arange(count) < 3, False)
    run(plant, np.zeros(count), 300)
    assert np.abs(plant.position - start).max() > 0.02


def test_a_braked_actuator_stands_still_whatever_pulls() -> None:
    plant = psm()
    plant.brake("PSM1", FIRST_THREE, True)
    start = plant.position.copy()
    rng = np.random.default_rng(2)
    for _ in range(300):
        plant.pull("PSM1", 100.0 * rng.normal(size=6) * np.array((1.0, 1.0, 1.0, 0.0, 0.0, 0.0)))
        plant.step(rng.normal(size=7) * np.array((100.0, 100.0, 1000.0, 0.3, 0.3, 0.3, 0.3)))
        np.testing.assert_allclose(plant.position[:3], start[:3], atol=1e-12)
        np.testing.assert_allclose(plant.velocity[:3], 0.0, atol=1e-9)
    assert np.abs(plant.position[3:] - start[3:]).max() > 0.1


def test_brakes_hold_actuators_behind_a_coupling() -> None:
    plant = psm()
    held = np.array((False, False, False, False, True, False, False))
    plant.brake("PSM1", held, True)
    start = plant.position.copy()
    run(plant, np.array((0.0, 0.0, 0.0, 0.02, 0.3, 0.02, -0.05)), 300)
    assert plant.position[4] == pytest.approx(start[4], abs=1e-12)
    assert (np.abs(plant.position - start)[[3, 5, 6]] > 0.01).all()


def test_a_brake_stops_a_moving_actuator_at_once() -> None:
    plant = psm()
    run(plant, np.array((1.0, 0.0, 5.0, 0.0, 0.0, 0.0, 0.0)), 100)
    where = plant.position.copy()
    assert abs(plant.velocity[0]) > 0.3
    plant.brake("PSM1", np.arange(7) == 0, True)
    plant.step(np.zeros(7))
    assert plant.position[0] == pytest.approx(where[0], abs=1e-12)
    assert abs(plant.velocity[2]) > 0.3, "the other one goes on"


def test_a_braked_arm_can_be_put_elsewhere() -> None:
    plant = si("ECM", -0.7, endoscope=1.8)
    plant.brake("ECM", np.array((True, True, True, False)), True)
    place = np.array((0.4, 0.3, 0.1, -0.2))
    plant.place("ECM", place)
    np.testing.assert_allclose(plant.position, place, atol=1e-12)
    run(plant, np.zeros(4), 200)
    np.testing.assert_allclose(plant.position, place, atol=1e-9)


def test_a_brake_outlasts_an_instrument_change() -> None:
    plant = si("PSM", -0.7)
    plant.brake("PSM", FIRST_THREE, True)
    start = plant.position.copy()
    plant.insert_tool("PSM", stock.tool(LND_SI))
    run(plant, np.zeros(7), 200)
    np.testing.assert_allclose(plant.position[:3], start[:3], atol=1e-12)


def test_a_gripper_stays_where_a_person_puts_it() -> None:
    plant = master()
    at = plant.slices["MTML_gripper"]
    assert plant.position[at] == pytest.approx([GRIPPER_INITIAL], abs=0.05)
    for opening in (0.0, 1.0):
        plant.place("MTML_gripper", np.array((opening,)))
        run(plant, np.zeros(8), 200)
        np.testing.assert_allclose(plant.position[at], opening, atol=1e-12)
        np.testing.assert_allclose(plant.pot_position[at], opening, atol=1e-12)


@pytest.mark.parametrize("backlash", [(), (0.01,) * 7])
def test_an_arm_that_is_put_somewhere_is_at_rest_there(backlash: tuple[float, ...]) -> None:
    plant, place = psm(LND, 1, 1,
                       ModelVariation("PSM1", backlash=backlash)), np.array((0.2, 0.1, 0.12, 0.1, 0.1, 0.1, 0.1))
    for push in (0.04, 2.0):
        plant.push("PSM1", np.array((push, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)))
        run(plant, np.array((0.02, 0.02, 0.0, 0.0, 0.0, 0.0, 0.0)), 100)
        plant.push("PSM1", np.zeros(7))
        plant.place("PSM1", place)
        for _ in range(2):
            np.testing.assert_allclose(plant.position, place, atol=1e-12)
            np.testing.assert_allclose(plant.velocity, 0.0, atol=1e-12)
            np.testing.assert_allclose(plant.pot_position, place, atol=1e-12)
            plant.step(np.zeros(7))


def test_placing_one_robot_leaves_the_others_moving() -> None:
    plant, twin = master(), master()
    effort = np.array((0.5, 0.3, 0.2, 0.1, 0.01, 0.01, 0.005, 0.0))
    for one in (plant, twin):
        run(one, effort, 50)
    plant.place("MTML_gripper", np.array((0.9,)))
    for one in (plant, twin):
        run(one, effort, 50)
    np.testing.assert_array_equal(plant.position[:7], twin.position[:7])
    assert np.abs(plant.velocity[:7]).max() > 0.1


def test_a_masters_roll_stops_where_its_file_says() -> None:
    plant = master()
    run(plant, np.array((0.0, 0.0, 0.0, 0.0, 0.0, 0.0, -0.02, 0.0)), 3000)
    assert plant.position[6] == pytest.approx(stock.chain("MTML").links[6].lower, abs=0.01)


def test_robots_that_are_not_there_are_named() -> None:
    plant = psm()
    for attempt in (lambda: plant.place("PSM9", np.zeros(7)), lambda: plant.tip("PSM9"),
                    lambda: plant.brake("PSM9", FIRST_THREE, True), lambda: plant.pull("PSM9", np.zeros(6))):
        with pytest.raises(KeyError, match="PSM9"):
            attempt()
