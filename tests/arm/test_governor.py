"""The governor: bounds of speed and acceleration between the target of a stream and what io gets."""

from __future__ import annotations

import math
import os
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from tests.examples import examples
from trocar.procs.arm.governor import LATE_S, MAX_LAG_S, MAX_STEP_NS, Governor
from trocar.procs.tables.arm_types import ARM_TYPES

DATA = Path(os.environ.get("TROCAR_TEST_DATA", Path(__file__).parents[3] / "shared/data")) / "real"
SPEED, ACCELERATION = np.array((2.0, 0.5, 20.0)), np.array((300.0, 60.0, 400.0))
CYCLE_NS = 666_667
SAMPLE_NS = 5_000_000  # recorded at 200 Hz
TOOL_SAMPLE_NS = 20_000_000  # its file has no times: slow motion of a real arm
STEPS_NS = st.sampled_from((CYCLE_NS, CYCLE_NS, CYCLE_NS, 2 * CYCLE_NS, 3_000_000, 30_000_000))


def governor(speed: Any = SPEED, acceleration: Any = ACCELERATION, at: Any = 0.0) -> Governor:
    arrays = {name: np.zeros(len(speed)) for name in ("goal", "target", "asked", "velocity", "feed_velocity")}
    made = Governor(SimpleNamespace(**arrays), np.array(speed), np.array(acceleration),
                    np.full(len(speed), -np.inf), np.full(len(speed), np.inf))
    made.goal[...] = made.target[...] = at
    return made


def step(made: Governor, target: Any, passed_ns: int = CYCLE_NS, *, has_feed: bool = False) -> bool:
    made.target[...] = target
    return made.step(passed_ns, has_feed=has_feed)


NUMBERS = st.floats(-3.0, 3.0) | st.sampled_from((math.nan, math.inf, -math.inf, 1e6, -1e300, 5e-324))


@examples(100)
@given(st.lists(st.tuples(st.tuples(*[NUMBERS] * 3), STEPS_NS), max_size=60))
@example([((math.nan, 1e300, -math.inf), CYCLE_NS)])
@pytest.mark.slow
def test_whatever_is_asked_for_no_joint_exceeds_its_bounds(steps: list[tuple[tuple[float, ...], int]]) -> None:
    made = governor()
    for target, passed_ns in steps:
        before, rate = made.goal.copy(), made.rate.copy()
        step(made, target, passed_ns)
        dt = min(passed_ns, MAX_STEP_NS) * 1e-9
        velocity = (made.goal - before) / dt
        assert np.isfinite(made.goal).all() and np.isfinite(made.rate).all()
        assert (np.abs(velocity) <= SPEED * (1 + 1e-9) + 1e-9).all()
        faster = np.maximum(velocity - np.maximum(rate, 0.0), np.minimum(rate, 0.0) - velocity)
        assert (faster <= ACCELERATION * dt * (1 + 1e-9) + 1e-9).all(), "it speeds up too fast"
        fastest = np.maximum(np.abs(velocity), np.abs(rate))
        assert (np.abs(made.rate) <= fastest * (1 + 1e-9) + 1e-9).all(), "it remembers more than there was"


@examples(50)
@given(st.tuples(*[st.floats(-2.0, 2.0)] * 3), st.tuples(*[st.floats(-1.0, 1.0)] * 3), st.sampled_from((1, 2, 5)))
@pytest.mark.slow
def test_a_constant_target_is_reached_exactly_and_never_passed(target: Any, rate: Any, cycles: int) -> None:
    made = governor()
    made.start(np.array(rate) * SPEED)
    goal, began = np.array(target), made.goal.copy()
    for _ in range(20_000):
        moves = step(made, target, cycles * CYCLE_NS)
        beyond = (made.goal - goal) * np.sign(goal - began)
        assert (beyond <= 1e-12).all() or (made.goal - goal == 0.0).all()
        if not moves:
            break
    assert (made.goal == goal).all() and not made.rate.any()
    assert made.most[0] == 0.0


@examples(40)
@given(st.lists(st.tuples(*[st.floats(-1.0, 1.0)] * 3), min_size=1, max_size=50))
def test_a_stream_within_the_bounds_is_passed_on_unchanged(accelerations: list[tuple[float, ...]]) -> None:
    made, dt = governor(), CYCLE_NS * 1e-9
    target, rate = np.zeros(3), np.zeros(3)
    for share in accelerations:
        rate = np.clip(rate + 0.99 * np.array(share) * ACCELERATION * dt, -0.99 * SPEED, 0.99 * SPEED)
        target = target + rate * dt
        step(made, target)
        assert (made.goal == target).all() and made.most[0] == 0.0


def test_from_rest_no_joint_is_faster_than_its_acceleration_makes_it() -> None:
    made, since_s = governor(), 0.0
    for cycle in range(40):
        before = made.goal.copy()
        step(made, 1.0 if cycle % 3 else made.goal + 1e-4)
        since_s += CYCLE_NS * 1e-9
        assert ((made.goal - before) / (CYCLE_NS * 1e-9) <= ACCELERATION * since_s + 1e-9).all()
    for _ in range(200):
        step(made, made.goal.copy())
    assert not made.rate.any(), "at rest it forgets"


@pytest.mark.parametrize("speed", (0.1, 0.5, 1.3))
def test_a_stream_that_leaves_out_every_third_cycle_is_passed_on_unchanged(speed: float) -> None:
    made, target = governor(), 0.0
    rate = 0.0
    for cycle in range(3000):
        rate = min(speed, rate + 0.3 * 100.0 * CYCLE_NS * 1e-9)
        if cycle % 3:
            target += rate * 1.5 * CYCLE_NS * 1e-9
        made.target[...] = (target, 0.2 * target, target)
        made.step(CYCLE_NS, has_feed=False)
        assert made.goal[0] == target and made.goal[2] == target


def test_what_is_not_a_number_is_no_target() -> None:
    made = governor(at=0.5)
    step(made, (0.6, 0.5, 0.5))
    here = made.goal.copy()
    step(made, (math.nan,) * 3)
    assert (made.goal == here).all() and made.most[0] == math.inf
    made.asked[...] = (0.5, math.nan, 0.5)
    assert made.lag() == (math.inf, 1)


def test_after_a_pause_it_goes_on_from_where_it_is() -> None:
    made = governor()
    for _ in range(100):
        step(made, 1e6)
    here = made.goal.copy()
    step(made, 1e6, 10_000_000_000)
    assert (made.goal - here <= SPEED * 0.005 * 1.000001).all()


def test_velocities_that_come_with_a_target_are_bounded() -> None:
    made = governor()
    made.feed[...] = (100.0, -0.2, -1e9)
    step(made, 0.0, has_feed=True)
    assert made.velocity.tolist() == [2.0, -0.2, -20.0]


def test_a_wall_may_clip_the_setpoint() -> None:
    made = governor()

    def wall(before: Any, setpoint: Any, bounds: Any, seconds: float) -> bool:
        assert (bounds[0] <= 1e-12).all() and (setpoint - before <= bounds[1] + 1e-12).all() and seconds > 0.0
        if setpoint[0] <= 0.01:
            return False
        setpoint[0] = 0.01
        return True

    made.clip = wall
    for _ in range(100):
        moves = step(made, 0.02)
    assert made.goal.tolist() == [0.01, 0.02, 0.02] and made.clipped and moves


def recording(name: str) -> Any:
    file = DATA / name
    if not file.exists():
        pytest.skip(f"no recordings of real arms: {file} is absent (TROCAR_TEST_DATA)")
    return np.loadtxt(file, delimiter=",", skiprows=int(name.startswith("classic")))


def fastest(positions: Any) -> Any:
    """A thousand samples of a recording, of which the one in the middle is the fastest."""
    middle = int(np.abs(np.diff(positions, axis=0)).max(axis=1).argmax())
    return positions[max(middle - 500, 0) : middle + 500]


RECORDINGS = (("PSM", "psm_measured_one.csv", slice(0, 7), SAMPLE_NS),
              ("MTM", "mtm_measured_one.csv", slice(0, 7), SAMPLE_NS),
              ("PSM", "classic_tool_fixed.csv", slice(1, 7), TOOL_SAMPLE_NS))


@pytest.mark.parametrize(("arm", "name", "columns", "sample_ns"), RECORDINGS)
def test_no_sample_of_a_real_arm_is_changed(arm: str, name: str, columns: slice, sample_ns: int) -> None:
    positions = fastest(recording(name)[:, columns])
    servo, n = ARM_TYPES[arm].servo, positions.shape[1]
    made = governor(servo.speed[:n], servo.acceleration[:n], positions[0])
    for sample in positions[1:]:
        made.target[...] = sample
        made.advance(sample_ns * 1e-9, 0)
        assert (made.goal == sample).all()


@pytest.mark.parametrize(("arm", "name", "columns", "sample_ns"), RECORDINGS)
def test_streamed_at_its_own_rate_the_motion_of_a_real_arm_is_followed_without_a_word(
        arm: str, name: str, columns: slice, sample_ns: int) -> None:
    positions = fastest(recording(name)[:, columns])
    servo, n = ARM_TYPES[arm].servo, positions.shape[1]
    made = governor(servo.speed[:n], servo.acceleration[:n], positions[0])
    for sample in positions[1:]:
        made.asked[...] = sample
        assert made.most[0] <= LATE_S and made.lag()[0] <= MAX_LAG_S
        for _ in range(sample_ns // CYCLE_NS):
            step(made, sample)


@pytest.mark.parametrize("name", ("psm_measured_one.csv", "mtm_measured_one.csv"))
def test_no_velocity_of_a_real_arm_is_changed(name: str) -> None:
    servo = ARM_TYPES[name[:3].upper()].servo
    assert (np.abs(recording(name)[:, 7:14]) <= servo.speed).all()


@pytest.mark.parametrize("name", ARM_TYPES)
def test_every_actuator_of_every_arm_has_bounds(name: str) -> None:
    row = ARM_TYPES[name]
    assert len(row.servo.speed) == len(row.servo.acceleration) == row.actuators
    assert (np.array(row.servo.speed)[: row.joints] > np.array(row.moves.velocity)[: row.joints]).all()
    assert (np.array(row.servo.acceleration) > np.array(row.moves.acceleration)).all()
