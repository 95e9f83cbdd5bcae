"""The guard and the limits of efforts against plain formulas, a joint after the other."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.arm.arm_configs import TOOL, bare_arm, fixed_arm
from trocar.procs.arm.effort_limits import EffortGuard, EffortLimits, motor_efforts
from trocar.procs.arm.joints import joints
from trocar.procs.document.arms import ArmConfig

MOTORS = np.array((3.3, 3.3, 9.9, 0.34, 0.34, 0.0, 0.34))
SPRING, FREE_SHARE, MAX_ZONE = 0.3, 0.5, 0.2  # docs/configuration.md


class GuardedJoint:
    """One joint by the words of the guard's docstring."""

    def __init__(self, lower: float, upper: float, speed: float, zone: float, most: float) -> None:
        self.lower, self.upper, self.speed, self.most = lower, upper, speed, most
        self.zone = min(zone, MAX_ZONE * (upper - lower))
        self.seen = {1.0: 0.0, -1.0: 0.0}

    def effort(self, asked: float, q: float, v: float, speed_ratio: float, *, has_zone: bool) -> float:
        damping = self.most / (FREE_SHARE * self.speed)
        pushed, back = asked, 0.0
        for way, room in ((1.0, self.upper - q), (-1.0, q - self.lower)):
            left = min(1.0, max(0.0, room / max(self.zone, 1e-9))) if has_zone else 1.0
            self.seen[way] = max(self.seen[way], left) if has_zone else 0.0
            if speed_ratio or left < 1.0:
                bound = damping * (self.speed * (speed_ratio or 1.0) * left - way * v)
                pushed = way * min(way * pushed, bound)
            back -= way * SPRING * self.most * (self.seen[way] - left) * has_zone
        return min(self.most, max(-self.most, pushed)) + back


@pytest.mark.parametrize(("speed", "zone"), [(1.0, 1.0), (0.0, 1.0), (1.0, 0.0), (0.5, 2.0), (2.0, 30.0)])
def test_guarded_efforts_are_those_of_the_formula(speed: float, zone: float) -> None:
    random, arm = np.random.default_rng(7), joints(fixed_arm(), TOOL)
    most = np.array((2.0, 1.5, np.inf, 0.3, 0.2, 0.2, 0.16))
    guard, n = EffortGuard(speed, zone), arm.size
    guard.use(arm, most)
    rows = [GuardedJoint(arm.lower[j], arm.upper[j], arm.effort_speed[j], arm.effort_zone[j] * zone,
                         most[j] if np.isfinite(most[j]) else 0.0)
            for j in range(n)]
    for step in range(120):
        if step % 40 == 0:
            guard.begin()
            for row in rows:
                row.seen = {1.0: 0.0, -1.0: 0.0}
        inside = random.uniform(-0.05, 1.05, n)
        q = np.where(random.random(n) < 0.3, random.choice((arm.lower, arm.upper)), arm.lower + inside * (
            arm.upper - arm.lower))
        v, asked = random.normal(size=n) * arm.effort_speed, random.normal(size=n) * 2.0
        motion: Any = SimpleNamespace(effort=asked.copy(), in_effort=random.random(n) < 0.8)
        guard.step(q, v, motion)
        guarded = [rows[j].effort(asked[j], q[j], v[j], speed, has_zone=bool(zone)) for j in range(n)]
        expected = np.where(np.isfinite(most) & motion.in_effort, guarded, asked)
        assert motion.effort == pytest.approx(expected, abs=1e-9)


def loads(arm: Any, effort: Any, motors: Any) -> Any:
    """Of every joint, then of every motor."""
    return np.append(np.abs(effort) / arm.rated, np.abs(effort @ arm.to_joint) / np.maximum(motors, 1e-9))


@pytest.mark.parametrize("config", [(fixed_arm(), TOOL), (bare_arm(), None)], ids=["instrument", "bare"])
def test_clipped_efforts_are_all_that_can_be_given(config: tuple[ArmConfig, Any]) -> None:
    random, arm = np.random.default_rng(8), joints(*config)
    motors = MOTORS.copy()
    motors[5] = 0.34
    limits = EffortLimits(motors, arm)
    groups = [set(range(3, arm.size))] if arm.kinematics is not None else []
    for _ in range(200):
        asked = random.normal(size=arm.size) * random.choice((0.05, 0.5, 3.0), size=arm.size)
        asked[random.random(arm.size) < 0.3] = 0.0
        worst = loads(arm, asked, motors)
        wrench = asked.copy()
        outside = limits.clip(wrench, together=True)
        assert wrench == pytest.approx(asked / max(1.0, worst.max())), "a wrench keeps its direction"
        alone = asked.copy()
        assert (limits.clip(alone, together=False) == outside).all()
        drives = arm.to_joint != 0.0
        expected = [(worst[j] > 1.0 or bool((drives[j] & (worst[arm.size:] > 1.0)).any() and asked[j])) for j in range(
            arm.size)]
        assert outside.tolist() == expected
        rated = np.clip(asked, -arm.rated, arm.rated)
        over = loads(arm, rated, motors)[arm.size:]
        for joint in range(arm.size):
            sharing = next((group for group in groups if joint in group and joint != 3), {joint})
            sharing = sharing - {3} if len(sharing) > 1 else sharing
            motor_load = max(over[motor] for motor in range(arm.axes) if any(drives[j, motor] for j in sharing))
            assert alone[joint] == pytest.approx(rated[joint] / max(1.0, motor_load), abs=1e-12)


def test_most_is_what_all_motors_give_together_but_no_more_than_rated() -> None:
    arm = joints(fixed_arm(), TOOL)
    limits = EffortLimits(MOTORS, arm)
    motors = np.maximum(MOTORS, 1e-9)
    expected = [min(sum(abs(arm.to_actuator[m, j]) * motors[m] for m in range(arm.axes)), arm.rated[j])
                for j in range(arm.size)]
    assert limits.most == pytest.approx(expected)
    assert (EffortLimits((), arm).most == arm.rated).all()
    assert (EffortLimits((), joints(bare_arm())).most[3:] == 0.343642).all()


def test_a_robot_of_which_one_motor_has_no_constant_has_no_known_efforts() -> None:
    def robot(*constants: float) -> Any:
        return SimpleNamespace(actuators=[SimpleNamespace(maximum_current=2.0, effort_to_current=each)
                                          for each in constants])

    assert motor_efforts(robot(0.5, -0.25)) == (4.0, 8.0) and motor_efforts(robot(0.5, 0.0)) == ()
