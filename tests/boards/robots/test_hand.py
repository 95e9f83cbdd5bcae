"""A hand pulls a tip to a pose, firmly and not too hard."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import numpy.typing as npt
import pytest

from tests.boards.robots.arms import arm, robot, system
from trocar.procs.boards.robots.hand import Grip, Hands, wrench
from trocar.procs.boards.robots.plant import Plant
from trocar.procs.kinematics import poses

Floats = npt.NDArray[np.float64]
STEP_S = 1e-3
ROBOTS = ("MTML", "MTMR")


class Body:
    """A free body of a master's tip's mass, stepped as the physics is."""

    mass, inertia = 0.4, 4e-4

    def __init__(self) -> None:
        self.before_step: list[Callable[[], None]] = []
        self.pose = np.eye(4)
        self.twist = np.zeros(6)
        self.pulled = np.zeros(6)
        self.strongest = np.zeros(2)

    def tip(self, robot: str) -> Floats:
        return self.pose.copy()

    def tip_twist(self, robot: str) -> Floats:
        return self.twist.copy()

    def pull(self, robot: str, wrench: Floats) -> None:
        self.pulled = wrench.copy()
        self.strongest = np.maximum(self.strongest, [np.linalg.norm(wrench[:3]), np.linalg.norm(wrench[3:])])

    def step(self, count: int = 1) -> None:
        for _ in range(count):
            self.pulled = np.zeros(6)
            for hook in self.before_step:
                hook()
            self.twist[:3] += self.pulled[:3] / self.mass * STEP_S
            self.twist[3:] += self.pulled[3:] / self.inertia * STEP_S
            self.pose[:3, 3] += self.twist[:3] * STEP_S
            self.pose[:3, :3] = poses.rotation_from_vector(self.twist[3:] * STEP_S) @ self.pose[:3, :3]


def _pose(x: float, y: float, z: float, turn: float = 0.0, axis: tuple[float, float, float] = (0, 0, 1)) -> Floats:
    sine = math.sin(0.5 * turn)
    return np.array((x, y, z, *(sine * a for a in axis), math.cos(0.5 * turn)))


def test_the_tip_comes_to_the_commanded_pose_and_stays() -> None:
    body = Body()
    hands = Hands(body, ROBOTS)  # type: ignore[arg-type]  # a plant as far as it goes
    target = _pose(0.03, -0.02, 0.05, 0.9, (0.6, 0.0, 0.8))
    hands.hold("MTML", target)
    body.step(1500)
    reached = poses.pose_from_matrix(body.pose)
    assert reached == pytest.approx(target, abs=1e-3)
    assert np.abs(body.twist).max() < 5e-3


def test_force_and_torque_stay_within_their_limits() -> None:
    body = Body()
    hands = Hands(body, ROBOTS)  # type: ignore[arg-type]  # a plant as far as it goes
    hands.hold("MTML", _pose(10.0, -7.0, 3.0, 3.0))
    body.step(50)
    assert body.strongest == pytest.approx([20.0, 0.4])
    hands.hold("MTML", _pose(-10.0, 0.0, 0.0, -3.0), Grip(most_force=5.0, most_torque=0.1))
    body.strongest[:] = 0.0
    body.step(50)
    assert body.strongest == pytest.approx([5.0, 0.1])


def test_a_half_turn_away_is_pulled_around_the_right_axis() -> None:
    target = poses.matrix_from_pose(_pose(0, 0, 0, math.pi, (0, 1, 0)))
    torque = wrench(target, Grip(most_torque=10.0), np.eye(4), np.zeros(6))[3:]
    assert np.abs(torque) == pytest.approx([0.0, 0.4 * math.pi, 0.0], abs=1e-6)


def test_without_a_hand_nothing_is_asked_before_a_step() -> None:
    body = Body()
    hands = Hands(body, ROBOTS)  # type: ignore[arg-type]  # a plant as far as it goes
    hands.hold("MTML", _pose(1, 0, 0))
    hands.hold("MTMR", _pose(1, 0, 0))
    hands.release("MTML")
    assert len(body.before_step) == 1
    hands.release("MTMR")
    assert body.before_step == []
    hands.release("MTMR")  # nobody holds it: nothing happens


def test_a_new_pose_keeps_the_grip() -> None:
    body = Body()
    hands = Hands(body, ROBOTS)  # type: ignore[arg-type]  # a plant as far as it goes
    hands.hold("MTML", _pose(0.001, 0, 0), Grip(stiffness=1000.0))
    hands.hold("MTML", _pose(0.002, 0, 0))
    hands.pull()
    assert body.pulled[0] == pytest.approx(2.0)


@pytest.mark.parametrize(("pose", "reason"), [
    ([0, 0, 0, 0, 0, 0, 1, 2], "7 numbers"),
    ([0, float("nan"), 0, 0, 0, 0, 1], "finite"),
    ([0, 0, float("inf"), 0, 0, 0, 1], "finite"),
    ([0, 0, 0, 0, 0, 0, 0], "length 0"),
    ([0, 0, 0, 1, 0, 0, 1], "length 1.41"),
])
def test_what_is_no_pose_is_refused_and_the_hand_stays(pose: list[float], reason: str) -> None:
    body = Body()
    hands = Hands(body, ROBOTS)  # type: ignore[arg-type]  # a plant as far as it goes
    hands.hold("MTML", _pose(0.01, 0, 0))
    with pytest.raises(ValueError, match=reason):
        hands.hold("MTML", np.array(pose, dtype=float))
    hands.pull()
    assert body.pulled[0] == pytest.approx(2.0)


def test_only_arms_can_be_held() -> None:
    hands = Hands(Body(), ROBOTS)  # type: ignore[arg-type]  # a plant as far as it goes
    with pytest.raises(KeyError, match="MTML_gripper: no arm to hold; there are MTML, MTMR"):
        hands.hold("MTML_gripper", _pose(0, 0, 0))
    with pytest.raises(KeyError, match="there are MTML, MTMR"):
        hands.release("")


def test_damping_follows_the_stiffness_unless_it_is_given() -> None:
    assert Grip.of() == Grip()
    soft = Grip.of(50.0)
    assert (soft.stiffness, soft.damping, soft.turning_stiffness) == (50.0, 6.0, 0.4)
    assert Grip.of(50.0, 0.1, 1.0, 0.001, 3.0, 0.2) == Grip(50.0, 0.1, 1.0, 0.001, 3.0, 0.2)
    for bad in ((-1.0,), (float("nan"),), (1.0, 11.0), (1.0, 1.0, 1.0, 1.0, 1e9)):
        with pytest.raises(ValueError, match=r"a hand's .* allowed: 0 to"):
            Grip.of(*bad)


def test_a_masters_gripper_is_led_to_a_pose_and_let_go() -> None:
    master = arm("MTML", "MTM", "MTML")
    plant = Plant(system((robot("MTML", "RRRRRRR"),), (master,)))
    hands, goal, idle = Hands(plant, ROBOTS), plant.tip("MTML"), np.zeros(7)
    goal[:3, 3] += (0.03, -0.02, 0.04)
    goal[:3, :3] = poses.rotation_from_vector(np.array((0.2, 0.3, -0.25))) @ goal[:3, :3]
    hands.hold("MTML", poses.pose_from_matrix(goal))
    for _ in range(1000):
        plant.step(idle)
    tip = plant.tip("MTML")
    assert np.abs(tip[:3, 3] - goal[:3, 3]).max() < 1e-3
    assert np.abs(poses.rotation_vector(goal[:3, :3] @ tip[:3, :3].T)).max() < 0.02  # what friction leaves
    hands.release("MTML")
    assert plant.before_step == []
    plant.push("MTML", np.array((0.3, 0, 0, 0, 0, 0, 0)))
    for _ in range(300):
        plant.step(idle)
    assert np.abs(plant.tip("MTML")[:3, 3] - goal[:3, 3]).max() > 0.01
