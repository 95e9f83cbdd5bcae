"""Speed limit and soft wall of effort mode, on joints with mass and friction, late and noisy as real ones are."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest

from trocar.procs.arm.effort_limits import MAX_ZONE, EffortGuard, EffortLimits, motor_efforts
from trocar.procs.arm.joints import JointSpace, joints
from trocar.procs.arm.motion import Motion
from trocar.procs.boards.robots.mechanics import arm_inertia, wrist_inertia
from trocar.procs.config import PROJECT_CONFIGS, load_system
from trocar.procs.tables.arm_types import ARM_TYPES

ARMS = {"PSM": "demo", "PSM Si": "demo-psm-si", "ECM": "demo-ecm", "ECM Si": "demo-ecm-si", "MTM": "demo-mtm"}
CYCLE_S = 1 / 1500
LATE = 2  # cycles from what is measured to what it makes the motor do
STEPS = 4  # of the mechanism in a cycle


@dataclass
class Mechanism:
    """All joints of an arm, uncoupled, with the inertia and friction of the emulated robots."""

    space: JointSpace
    most: np.ndarray
    inertia: np.ndarray
    viscous: np.ndarray
    coulomb: np.ndarray

    @property
    def n(self) -> int:
        return self.space.size

    def middle(self) -> np.ndarray:
        return 0.5 * (self.space.lower + self.space.upper)


@cache
def mechanism(kind: str) -> Mechanism:
    system = load_system(PROJECT_CONFIGS / "systems" / f"{ARMS[kind]}.yaml").system
    assert system is not None
    arm = system.arms[0]
    robot = next(robot for robot in system.io(arm.io).robots if robot.name == arm.robot)
    space = joints(arm, arm.tool)
    row = arm_inertia(arm.type, arm.generation, ARM_TYPES[arm.type].joints)
    assert row is not None
    rows = [*row.joints, *(wrist_inertia(np.array(arm.tool.actuator_to_joint)) if arm.tool else ())]
    inertia = np.array([row.armature for row in rows])
    inertia[:2] += row.shaft[0]
    return Mechanism(space, EffortLimits(motor_efforts(robot), space).most, inertia,
                     np.array([row.viscous for row in rows]), np.array([row.coulomb for row in rows]))


class Run:
    """An arm under efforts, guarded."""

    def __init__(self, arm: Mechanism, position: np.ndarray, noise: float = 0.0, **ratios: float) -> None:
        """`noise`: standard deviation of measured velocities, of the limits of speed."""
        self.arm, self.noise = arm, noise * arm.space.effort_speed
        self.random = np.random.default_rng(3)
        self.guard = EffortGuard(ratios.get("speed", 1.0), ratios.get("zone", 1.0))
        self.guard.use(arm.space, arm.most)
        self.motion = Motion(arm.space)
        self.motion.push()
        self.guard.begin()
        self.position, self.velocity = position.copy(), np.zeros(arm.n)
        self.waiting = [np.zeros(arm.n) for _ in range(LATE)]
        self.speeds: list[np.ndarray] = []
        self.places: list[np.ndarray] = []
        self.applied: list[np.ndarray] = []

    def run(self, seconds: float, effort: np.ndarray, hand: np.ndarray | float = 0.0) -> None:
        """Efforts (n,) as they are asked for, and what a hand does beside."""
        for _ in range(round(seconds / CYCLE_S)):
            self.motion.effort[...] = effort
            measured = self.velocity + self.noise * self.random.standard_normal(self.arm.n)
            self.guard.step(self.position, measured, self.motion)
            self.waiting.append(np.clip(self.motion.effort, -self.arm.most, self.arm.most))
            self.applied.append(self.waiting[0] + hand)
            self._move(self.waiting.pop(0) + hand)
            self.speeds.append(self.velocity.copy())
            self.places.append(self.position.copy())

    def _move(self, effort: np.ndarray) -> None:
        arm, step = self.arm, CYCLE_S / STEPS
        for _ in range(STEPS):
            pushed = self.velocity + (effort - arm.viscous * self.velocity) / arm.inertia * step
            friction = arm.coulomb / arm.inertia * step
            self.velocity = np.sign(pushed) * np.maximum(np.abs(pushed) - friction, 0.0)
            self.position = self.position + self.velocity * step

    def seen(self, what: str, last_s: float | None = None) -> np.ndarray:
        rows = np.array(getattr(self, what))
        return rows if last_s is None else rows[-round(last_s / CYCLE_S) :]


def far(arm: Mechanism) -> Mechanism:
    """The same without a limit anywhere near."""
    space = dataclasses.replace(arm.space, lower=np.full(arm.n, -1e3), upper=np.full(arm.n, 1e3))
    return dataclasses.replace(arm, space=space)


@pytest.mark.parametrize("kind", ARMS)
@pytest.mark.parametrize("noise", (0.0, 0.03))
def test_a_constant_effort_settles_at_the_limit_of_speed(kind: str, noise: float) -> None:
    arm = far(mechanism(kind))
    run = Run(arm, np.zeros(arm.n), noise)
    run.run(2.0, arm.most)
    share = run.seen("speeds") / arm.space.effort_speed
    assert (share <= 1.2).all() and (share[-500:].mean(axis=0) > 0.75).all()
    assert (share[-500:] <= 1.1).all()
    assert (np.ptp(share[-500:], axis=0) < (0.15 if noise else 0.02)).all(), "it keeps that speed"


@pytest.mark.parametrize("kind", ARMS)
@pytest.mark.parametrize("side", (1.0, -1.0))
@pytest.mark.parametrize("noise", (0.0, 0.03))
def test_an_effort_comes_to_rest_before_the_limit(kind: str, side: float, noise: float) -> None:
    arm = mechanism(kind)
    run = Run(arm, arm.middle(), noise)
    run.run(4.0, side * arm.most)
    limit = np.where(side > 0, arm.space.upper, -arm.space.lower)
    place = side * run.seen("places")
    zone = np.minimum(arm.space.effort_zone, MAX_ZONE * (arm.space.upper - arm.space.lower))
    assert (place <= limit).all(), "never beyond"
    assert (place[-1] > limit - zone).all() and (place[-1] < limit - 0.05 * zone).all(), "in the zone"
    still = np.abs(run.seen("speeds", 0.5)) / arm.space.effort_speed
    assert still.max() < (0.1 if noise else 0.005), "at rest"
    if not noise:
        backwards = place.max(axis=0) - place[-1]
        assert (backwards < 0.25 * zone).all(), "without a rebound worth the name"


@pytest.mark.parametrize("kind", ARMS)
def test_what_a_hand_pushes_into_the_wall_comes_back_and_stays(kind: str) -> None:
    arm = mechanism(kind)
    zone = np.minimum(arm.space.effort_zone, MAX_ZONE * (arm.space.upper - arm.space.lower))
    run = Run(arm, arm.space.upper - 1.2 * zone)
    run.run(2.0, np.zeros(arm.n), 0.25 * arm.most)
    pushed = run.places[-1]
    assert (pushed > arm.space.upper - zone).all() and (pushed < arm.space.upper).all()
    run.run(2.0, np.zeros(arm.n))
    assert (run.places[-1] < pushed - 0.2 * zone).all(), "pushed back"
    assert (np.abs(run.seen("speeds", 0.3)) < 0.02 * arm.space.effort_speed).all(), "and lets it be"
    assert (np.abs(run.seen("applied", 1.9)) <= 0.31 * arm.most).all(), "softly"


@pytest.mark.parametrize("kind", ARMS)
def test_a_joint_that_is_at_its_limit_already_stays_there(kind: str) -> None:
    arm = mechanism(kind)
    run = Run(arm, arm.space.upper - 0.1 * arm.space.effort_zone)
    run.run(0.5, np.zeros(arm.n))
    assert not run.seen("applied").any()
    run = Run(arm, arm.space.upper + 0.01)
    run.run(0.5, arm.most)
    assert not run.seen("applied").any(), "and goes no further"
    run.run(0.3, -arm.most)
    assert (run.places[-1] < arm.space.upper - arm.space.effort_zone).all(), "but back"


@pytest.mark.parametrize("kind", ARMS)
def test_nothing_is_changed_at_ordinary_speeds_away_from_limits(kind: str) -> None:
    arm = mechanism(kind)
    guard, motion = EffortGuard(1.0, 1.0), Motion(arm.space)
    guard.use(arm.space, arm.most)
    motion.push()
    random = np.random.default_rng(1)
    for _ in range(200):
        asked = random.uniform(-1.0, 1.0, arm.n) * arm.most
        motion.effort[...] = asked
        guard.step(arm.middle(), random.uniform(-0.49, 0.49, arm.n) * arm.space.effort_speed, motion)
        assert motion.effort.tolist() == asked.tolist()
    motion.effort[...] = 0.0
    guard.step(arm.middle(), 0.99 * arm.space.effort_speed, motion)
    assert not motion.effort.any(), "a hand is not braked below the limit"


@pytest.mark.slow
def test_each_can_be_switched_off_by_itself() -> None:
    arm = mechanism("PSM")
    fast = Run(far(arm), np.zeros(arm.n), speed=0.0)
    fast.run(1.0, arm.most)
    assert (np.abs(fast.speeds[-1]) > 1.3 * arm.space.effort_speed).all()
    through = Run(arm, arm.middle(), zone=0.0)
    through.run(2.0, arm.most)
    assert (through.places[-1] > arm.space.upper).all() and not through.seen("places", 0.1).max() > 1e3
    wall = Run(arm, arm.middle(), speed=0.0)
    wall.run(3.0, 0.3 * arm.most)
    assert (wall.seen("places", 0.5) < arm.space.upper).all()


def test_joints_that_follow_positions_get_no_effort() -> None:
    arm = mechanism("MTM")
    guard, motion = EffortGuard(1.0, 1.0), Motion(arm.space)
    guard.use(arm.space, arm.most)
    motion.push(np.arange(arm.n) < 3)
    guard.step(arm.middle(), np.full(arm.n, 50.0), motion)
    assert (motion.effort[:3] < 0.0).all() and not motion.effort[3:].any()
