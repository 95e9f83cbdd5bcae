"""Speed limit and soft wall of effort mode, on joints with mass and friction, late and noisy as real ones are."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from functools import cache
from types import SimpleNamespace
from typing import Any

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
NOISE = 0.03  # standard deviation of measured velocities, of the limits of speed


@dataclass
class Mechanism:
    """Uncoupled joints, with the inertia and friction of the emulated robots."""

    names: list[str]
    space: JointSpace
    most: np.ndarray
    inertia: np.ndarray
    viscous: np.ndarray
    coulomb: np.ndarray

    @property
    def n(self) -> int:
        return self.space.size

    @property
    def zone(self) -> np.ndarray:
        return np.minimum(self.space.effort_zone, MAX_ZONE * (self.space.upper - self.space.lower))

    def middle(self) -> np.ndarray:
        return 0.5 * (self.space.lower + self.space.upper)

    def but(self, which: np.ndarray) -> list[str]:
        """The joints of which something is not so."""
        return [name for name, is_so in zip(self.names, which, strict=True) if not is_so]


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
    return Mechanism([f"{kind} {space.name(axis)}" for axis in range(space.size)], space,
                     EffortLimits(motor_efforts(robot), space).most, inertia,
                     np.array([row.viscous for row in rows]), np.array([row.coulomb for row in rows]))


def together(*parts: Mechanism) -> Mechanism:
    """One mechanism with all their joints, each of which is guarded by itself: many runs cost as much as one."""
    def joined(of: Any, name: str) -> np.ndarray:
        return np.concatenate([getattr(of(part), name) for part in parts])

    space = dataclasses.replace(parts[0].space, **{name: joined(lambda part: part.space, name) for name in (
        "lower", "upper", "effort_speed", "effort_zone")})
    return Mechanism([name for part in parts for name in part.names], space, *(
        joined(lambda part: part, name) for name in ("most", "inertia", "viscous", "coulomb")))


@pytest.fixture(scope="module")
def every() -> Mechanism:
    """The joints of all arms."""
    return together(*map(mechanism, ARMS))


class Run:
    """Joints under efforts, guarded."""

    def __init__(self, arm: Mechanism, position: np.ndarray, noise: np.ndarray | float = 0.0, **ratios: float) -> None:
        """`noise`: standard deviation of measured velocities, of the limits of speed."""
        self.arm, self.noise = arm, noise * arm.space.effort_speed
        self.random = np.random.default_rng(3)
        self.guard = EffortGuard(ratios.get("speed", 1.0), ratios.get("zone", 1.0))
        self.guard.use(arm.space, arm.most)
        self.motion: Any = SimpleNamespace(effort=np.zeros(arm.n), in_effort=np.ones(arm.n, bool))
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
            self.waiting.append(np.minimum(np.maximum(self.motion.effort, -self.arm.most), self.arm.most))
            self.applied.append(self.waiting.pop(0) + hand)
            self._move(self.applied[-1])
            self.speeds.append(self.velocity)
            self.places.append(self.position)

    def _move(self, effort: np.ndarray) -> None:
        arm, step = self.arm, CYCLE_S / STEPS
        friction = arm.coulomb / arm.inertia * step
        kept, pushed = 1.0 - arm.viscous / arm.inertia * step, effort / arm.inertia * step
        for _ in range(STEPS):
            velocity = self.velocity * kept + pushed
            self.velocity = np.copysign(np.maximum(np.abs(velocity) - friction, 0.0), velocity)
            self.position = self.position + self.velocity * step

    def seen(self, what: str, last_s: float | None = None) -> np.ndarray:
        rows = getattr(self, what)
        return np.array(rows if last_s is None else rows[-round(last_s / CYCLE_S) :])


def far(arm: Mechanism) -> Mechanism:
    """The same without a limit anywhere near."""
    space = dataclasses.replace(arm.space, lower=np.full(arm.n, -1e3), upper=np.full(arm.n, 1e3))
    return dataclasses.replace(arm, space=space)


def test_a_constant_effort_settles_at_the_limit_of_speed(every: Mechanism) -> None:
    arm = far(together(every, every))
    noise = np.repeat((0.0, NOISE), every.n)
    run = Run(arm, np.zeros(arm.n), noise)
    run.run(1.6, arm.most)
    share = run.seen("speeds") / arm.space.effort_speed
    assert arm.but(share.max(axis=0) <= 1.2) == [] and arm.but(share[-500:].mean(axis=0) > 0.75) == []
    assert arm.but(share[-500:].max(axis=0) <= 1.1) == []
    assert arm.but(np.ptp(share[-500:], axis=0) < np.where(noise > 0.0, 0.15, 0.02)) == [], "it keeps that speed"


def test_an_effort_comes_to_rest_before_the_limit(every: Mechanism) -> None:
    arm = together(every, every, every, every)
    side, noise = np.repeat((1.0, -1.0, 1.0, -1.0), every.n), np.repeat((0.0, 0.0, NOISE, NOISE), every.n)
    run = Run(arm, arm.middle(), noise)
    run.run(4.0, side * arm.most)
    limit = np.where(side > 0, arm.space.upper, -arm.space.lower)
    place, zone = side * run.seen("places"), arm.zone
    assert arm.but(place.max(axis=0) <= limit) == [], "never beyond"
    assert arm.but((place[-1] > limit - zone) & (place[-1] < limit - 0.05 * zone)) == [], "in the zone"
    still = np.abs(run.seen("speeds", 0.5)) / arm.space.effort_speed
    assert arm.but(still.max(axis=0) < np.where(noise > 0.0, 0.1, 0.005)) == [], "at rest"
    backwards = place.max(axis=0) - place[-1]
    assert arm.but((backwards < 0.25 * zone) | (noise > 0.0)) == [], "without a rebound worth the name"


def test_what_a_hand_pushes_into_the_wall_comes_back_and_stays(every: Mechanism) -> None:
    arm, zone = every, every.zone
    run = Run(arm, arm.space.upper - 1.2 * zone)
    run.run(1.5, np.zeros(arm.n), 0.25 * arm.most)
    pushed = run.places[-1]
    assert arm.but((pushed > arm.space.upper - zone) & (pushed < arm.space.upper)) == []
    run.run(2.0, np.zeros(arm.n))
    assert arm.but(run.places[-1] < pushed - 0.2 * zone) == [], "pushed back"
    assert arm.but((np.abs(run.seen("speeds", 0.3)) < 0.02 * arm.space.effort_speed).all(axis=0)) == [], "lets it be"
    assert arm.but((np.abs(run.seen("applied", 1.9)) <= 0.31 * arm.most).all(axis=0)) == [], "softly"


def test_a_joint_that_is_at_its_limit_already_stays_there(every: Mechanism) -> None:
    arm = every
    run = Run(arm, arm.space.upper - 0.1 * arm.space.effort_zone)
    run.run(0.2, np.zeros(arm.n))
    assert not run.seen("applied").any()
    run = Run(arm, arm.space.upper + 0.01)
    run.run(0.2, arm.most)
    assert not run.seen("applied").any(), "and goes no further"
    run.run(0.3, -arm.most)
    assert arm.but(run.places[-1] < arm.space.upper - arm.space.effort_zone) == [], "but back"


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


def test_each_can_be_switched_off_by_itself() -> None:
    arm = mechanism("PSM")
    fast = Run(far(arm), np.zeros(arm.n), speed=0.0)
    fast.run(1.0, arm.most)
    assert arm.but(np.abs(fast.speeds[-1]) > 1.3 * arm.space.effort_speed) == []
    through = Run(arm, arm.middle(), zone=0.0)
    through.run(2.0, arm.most)
    assert arm.but(through.places[-1] > arm.space.upper) == [] and not through.seen("places", 0.1).max() > 1e3
    wall = Run(arm, arm.middle(), speed=0.0)
    wall.run(2.5, 0.3 * arm.most)
    assert arm.but((wall.seen("places", 0.5) < arm.space.upper).all(axis=0)) == []


def test_joints_that_follow_positions_get_no_effort() -> None:
    arm = mechanism("MTM")
    guard, motion = EffortGuard(1.0, 1.0), Motion(arm.space)
    guard.use(arm.space, arm.most)
    motion.push(np.arange(arm.n) < 3)
    guard.step(arm.middle(), np.full(arm.n, 50.0), motion)
    assert (motion.effort[:3] < 0.0).all() and not motion.effort[3:].any()
