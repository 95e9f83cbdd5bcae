"""Long plays of setpoints and efforts: what an arm makes of them in each cycle; see tests.traces."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from random import Random
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.arm.arm_configs import TOOL, fixed_arm
from tests.traces import Trace, shown
from trocar.procs.arm.effort_limits import EffortLimits
from trocar.procs.arm.efforts import COUNT, Efforts, impedance_of
from trocar.procs.arm.joints import JointSpace, joints
from trocar.procs.arm.motion import Mode, Motion, Space
from trocar.procs.kinematics.poses import matrix_from_pose

FOLDER = Path(__file__).parent / "traces"
STEPS = 900
MS = 1_000_000
MOTORS = (3.3, 3.3, 9.9, 0.34, 0.34, 0.34, 0.34)
PAUSES_MS = (*(2,) * 9, *(10,) * 4, 5, 6, 50, 98, 100, 101, 400)
Act = tuple[str, Callable[[], Any]]


def space() -> JointSpace:
    return joints(fixed_arm(), TOOL)


class MotionPlay:
    """A setpoint generator that is told one thing after the other."""

    def __init__(self, chance: Random, jerk_time_s: float) -> None:
        self.chance, self.joints, self.now_ns = chance, space(), 1_000 * MS
        self.motion = Motion(self.joints, jerk_time_s)
        self.motion.hold(np.zeros(7))

    def array(self, *scales: float) -> Any:
        """Numbers for each joint."""
        return np.array([self.chance.choice((0.0, 0.1, -0.05, 0.2)) for _ in range(7)]) * self.chance.choice(scales)

    def acts(self) -> list[Act]:
        motion, now, chance, n = self.motion, self.now_ns, self.chance, self.joints.size
        odd = self.joints.v_max.copy()
        odd[2] = math.nan
        some = np.arange(n) < chance.randint(0, n)
        ratios = chance.choice(((1.0, 1.0), (0.5, 0.5), (0.2, 1.0), (0.001, 0.001)))
        return [
            ("hold", lambda: motion.hold(self.array(1.0))), ("rest", lambda: motion.hold(self.array(0.5), Mode.NONE)),
            *((("servo", lambda: motion.servo(motion.goal + self.array(0.01), None, now)),
               ("servo with velocity", lambda: motion.servo(motion.goal + self.array(0.01), self.array(1.0), now)),
               ("drift", lambda: motion.drift(self.array(1.0, 5.0), now)),
               ("adjust", lambda: motion.adjust(motion.goal + self.array(0.02), moves=False)),
               ("move", lambda: motion.move(self.array(1.0, 2.0), self.array(3.0, 30.0), now))) * 3),
            ("push", lambda: motion.push(chance.choice((None, some)))),
            ("add", lambda: motion.add(self.array(2.0), now + 20 * MS)), ("end feed", motion.end_feed),
            ("bad move", lambda: motion.move(odd, self.array(1.0), now)),
            ("resume", lambda: motion.resume(self.array(1.0), now)), ("ratio", lambda: motion.set_ratio(*ratios, now)),
            ("space", lambda: setattr(motion, "space", chance.choice(list(Space)))),
            ("use", lambda: motion.use(self.joints) if chance.random() < 0.2 else None)]

    def step(self) -> tuple[list[str], list[tuple[str, Any]]]:
        self.now_ns += self.chance.choice(PAUSES_MS) * MS
        motion, now, did = self.motion, self.now_ns, []
        if self.chance.random() < 0.15:
            name, act = self.chance.choice(self.acts())
            did.append(f"{name}: {shown(act())}")
        pending = motion.is_pending(now)
        motion.step(now)
        names = ("mode", "space", "moving", "has_velocity", "goal", "velocity", "effort", "target", "feed", "in_effort",
                 "ratio")
        seen = [(name, getattr(motion, name)) for name in names]
        end = motion.end_ns - now if motion.moving else 0
        return did, [*seen, ("ends in", end / MS), ("feed ends", (motion.feed_end_ns - now) / MS if (
            motion.feed_end_ns < now + 1_000 * MS) else "never"), ("pending", pending),
            ("settled", motion.settled)]


class EffortsPlay:
    """Efforts and wrenches, on a tip that turns."""

    def __init__(self, chance: Random, timeout_s: float) -> None:
        self.chance, self.now_ns, made = chance, 1_000 * MS, space()
        random = np.random.default_rng(3)
        self.base = matrix_from_pose(np.array((0.1, 0.2, 0.3, 0.0, 0.0, 0.6, 0.8)))
        self.cartesian = SimpleNamespace(
            jacobian=random.normal(size=(6, 6)), spatial=random.normal(size=(6, 6)), valid=True, base_known=True,
            tip=np.eye(4), twist=np.array((0.1, 0.2, 0.3, 0.1, 0.0, -0.1)), rotation=self.base[:3, :3],
            to_reference=lambda pose: self.base @ pose)
        limits = EffortLimits(MOTORS, made)
        self.efforts = Efforts(self.cartesian, limits, made.size, timeout_s)  # type: ignore[arg-type]

    def numbers(self, count: int, *scales: float) -> Any:
        return np.array([self.chance.choice((0.0, 0.1, -0.05, 0.2)) for _ in range(count)]) * self.chance.choice(scales)

    def acts(self) -> list[Act]:
        efforts, now, cartesian = self.efforts, self.now_ns, self.cartesian
        values = self.numbers(COUNT, 1.0)
        values[3:7], values[7:11] = (0.0, 0.0, 0.6, 0.8), (0.6, 0.0, 0.0, 0.8)
        still = values.copy()
        still[11:] = 0.0
        tip = matrix_from_pose(np.array((*self.numbers(3, 0.1), 0.0, 0.6, 0.0, 0.8)))
        return [
            ("rest", efforts.rest), ("joint", lambda: efforts.joint(self.numbers(6, 0.0, 1.0, 30.0), now)),
            ("joint", lambda: efforts.joint(self.numbers(6, 1.0), now)),
            ("jaw", lambda: efforts.jaw(self.chance.choice((0.0, 0.1, 1.0)), now)),
            *(("body", lambda absolute=absolute: efforts.body(self.numbers(6, 0.0, 1.0, 9.0), now, absolute=absolute))
              for absolute in (False, True)),
            ("body for a while", lambda: efforts.body(self.numbers(6, 1.0), now, absolute=True, lasts_ns=20 * MS)),
            ("spatial", lambda: efforts.spatial(self.numbers(6, 1.0), now)),
            ("impede", lambda: efforts.impede(impedance_of(values), now)),
            ("impede with nothing", lambda: efforts.impede(impedance_of(still), now)),
            ("feed", lambda: efforts.feed(self.numbers(6, 1.0, 9.0)).copy()),
            ("tip", lambda: setattr(cartesian, "tip", tip)), ("use", lambda: efforts.use(7)),
            ("valid", lambda: setattr(cartesian, "valid", self.chance.random() < 0.7)),
            ("base known", lambda: setattr(cartesian, "base_known", self.chance.random() < 0.7))]

    def step(self) -> tuple[list[str], list[tuple[str, Any]]]:
        self.now_ns += self.chance.choice((2, 2, 10, 18, 20, 100)) * MS
        did = []
        if self.chance.random() < 0.4:
            name, act = self.chance.choice(self.acts())
            did.append(f"{name}: {shown(act())}")
        efforts = self.efforts
        seen: list[tuple[str, Any]] = [("fed clipped", efforts.clipped), ("overdue", efforts.is_overdue(self.now_ns))]
        efforts.step(self.now_ns)
        return did, [*seen, *((name, getattr(efforts, name)) for name in ("law", "effort", "clipped", "wrench"))]


PLAYS: dict[str, Callable[[Random], MotionPlay | EffortsPlay]] = {
    "motion": lambda chance: MotionPlay(chance, 0.0), "motion-with-jerk": lambda chance: MotionPlay(chance, 0.05),
    "efforts": lambda chance: EffortsPlay(chance, 0.1), "efforts-for-ever": lambda chance: EffortsPlay(chance, 0.0),
}


@pytest.mark.parametrize("name", PLAYS)
def test_setpoints_and_efforts_of_a_long_play_are_what_they_were(name: str) -> None:
    play, trace = PLAYS[name](Random(name)), Trace()
    for _ in range(STEPS):
        trace.look(*play.step())
    trace.compare(FOLDER / f"{name}.txt")


def test_a_setpoint_generator_begins_at_rest_and_moves_without_limit_of_jerk() -> None:
    made = space()
    motion = Motion(made)
    assert motion.mode is Mode.NONE and not motion.moving and not motion.has_velocity
    assert (motion.end_ns, motion.ratio) == (0, 1.0)
    motion.hold(np.zeros(7))
    target = np.zeros(7)
    target[0] = 0.3
    assert motion.move(target, np.zeros(7), 5_000 * MS) == ""
    lasts_s = 2.0 * math.sqrt(0.3 / made.a_max[0])
    assert motion.end_ns == pytest.approx(5_000 * MS + lasts_s * 1e9, abs=1000)


def test_a_move_that_cannot_be_gone_on_with_ends_where_it_stands() -> None:
    motion = Motion(space())
    motion.hold(np.zeros(7))
    assert motion.move(np.full(7, 0.1), np.zeros(7), 5_000 * MS) == ""
    motion.ratio_v = 0.0  # nothing can be planned so
    here = np.full(7, 0.05)
    assert not motion.resume(here, 5_100 * MS)
    assert not motion.moving and motion.mode is Mode.POSITION
    assert (motion.goal == here).all() and (motion.target == here).all() and not motion.velocity.any()
