"""A stream of poses that leaves what the arm can reach: it goes as near as it can, says so, and never jumps."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.arm.arm_configs import fixed_arm
from tests.arm.fake_io import PERIOD_NS, ArmHarness
from tests.examples import examples
from trocar.procs.arm.reach import QUICKEST
from trocar.procs.kinematics.poses import matrix_from_pose, pose_from_matrix, rotation_from_vector
from trocar.procs.tables.arm_types import ARM_TYPES

STRAIGHT = (0.0, 0.0, 0.12, 0.0, 0.0, 0.0)
SERVO = np.array(ARM_TYPES["PSM"].servo.speed[:6])
V_MAX = np.array((math.radians(90.0), math.radians(90.0), 0.2, QUICKEST, QUICKEST, QUICKEST))


class Stream:
    """A homed arm that follows goals, one each cycle, and how far its joints went in each."""

    def __init__(self) -> None:
        self.harness = ArmHarness(fixed_arm()).homed()
        self.harness.go(STRAIGHT)
        self.harness.reports.events.clear()
        self.start = matrix_from_pose(np.array(self.harness.state["setpoint_cp"]))
        self.limits = self.harness.arm.joints.lower[:6], self.harness.arm.joints.upper[:6]
        self.largest = np.zeros(6)
        self.reported = ""
        self.may_end = False

    @property
    def joints(self) -> Any:
        return self.harness.arm.control.motion.goal[:6].copy()

    def follow(self, by: Any = (0.0, 0.0, 0.0), turn: Any = (0.0, 0.0, 0.0)) -> str:
        """A goal that many m and rad from where it began; what was answered."""
        goal = self.start.copy()
        goal[:3, 3] += by
        goal[:3, :3] = rotation_from_vector(np.array(turn)) @ goal[:3, :3]
        before = self.joints
        request = self.harness.send("servo_cp", pose_from_matrix(goal))
        if self.may_end and request.outcomes == ["refused"]:
            self.harness.run(0.6)
            return "ended"
        assert request.outcomes == ["done"], request.replies
        self.largest = np.maximum(self.largest, np.abs(self.joints - before))
        lower, upper = self.limits
        assert (self.joints >= lower - 1e-9).all() and (self.joints <= upper + 1e-9).all()
        self.reported = request.replies[0][1]
        return self.reported

    def place(self, by: Any) -> float:
        """How far the tip is from a goal."""
        tip = matrix_from_pose(np.array(self.harness.state["setpoint_cp"]))
        return float(np.linalg.norm(tip[:3, 3] - self.start[:3, 3] - by))


@pytest.fixture(scope="module")
def made() -> Stream:
    return Stream()


@pytest.fixture
def stream(made: Stream) -> Iterator[Stream]:
    """Where it began, nothing told yet."""
    made.harness.go(STRAIGHT)
    made.harness.run(2.2)
    made.harness.reports.events.clear()
    made.largest[:] = 0.0
    start = made.start
    yield made
    made.start = start


def test_deeper_than_it_can_go_it_stays_at_the_limit_and_comes_back(stream: Stream) -> None:
    deep = np.linspace(0.0, 0.2, 400)  # 8 cm more than there is
    for depth in deep:
        stream.follow((0.0, 0.0, -depth))
    assert stream.reported == "at its limit: insertion would be 0.32, above its limit 0.24"
    assert stream.joints[2] == pytest.approx(0.24)
    for depth in deep[::-1]:
        stream.follow((0.0, 0.0, -depth))
    assert stream.reported == "" and stream.joints == pytest.approx(STRAIGHT, abs=1e-6)
    assert stream.largest[2] < 0.0009 and (stream.largest[[0, 1, 3, 4, 5]] < 1e-6).all()
    assert len(stream.harness.reports.of("warning")) == 1 and not stream.harness.reports.of("error")


def test_along_a_limit_the_tip_goes_on(stream: Stream) -> None:
    for depth in np.linspace(0.0, 0.15, 300):
        stream.follow((0.0, 0.0, -depth))
    for aside in np.linspace(0.0, 0.05, 300):
        stream.follow((aside, 0.0, -0.15))
    goal, centre = stream.start[:3, 3] + (0.05, 0.0, -0.15), 0.24 - 0.0065
    stream.harness.run(0.01)
    tip = np.array(stream.harness.state["setpoint_cp"][:3])
    nearest = goal * centre / np.linalg.norm(goal)  # about on the sphere that it can reach
    assert tip == pytest.approx(nearest, abs=1.5e-3)


@pytest.mark.parametrize("back", (0.5, 1.0))
@pytest.mark.slow
def test_a_roll_at_its_end_does_not_turn_once_around(stream: Stream, back: float) -> None:
    end = stream.limits[1][3]
    about = np.array((0.0, 0.0, -1.0))  # the shaft
    angles = np.linspace(0.0, end + 1.0, 800)
    for angle in angles:
        stream.follow(turn=about * angle)
    assert abs(stream.joints[3]) == pytest.approx(end) and stream.reported.startswith("at its limit: roll")
    for angle in angles[::-1][: round(back * len(angles))]:
        stream.follow(turn=about * angle)
    assert stream.reported == "" and stream.largest[3] <= V_MAX[3] * PERIOD_NS * 1e-9 * 1.01 + angles[1]
    assert stream.place((0.0, 0.0, 0.0)) < 1e-6


def test_the_tip_keeps_its_place_where_the_wrist_can_bend_no_further(stream: Stream) -> None:
    for angle in np.linspace(0.0, 2.0, 1000):
        stream.follow(turn=(angle, 0.0, 0.0))
    stream.harness.run(0.01)
    assert stream.reported.startswith("at its limit: ") and stream.place((0.0, 0.0, 0.0)) < 1e-3


@pytest.mark.slow
def test_through_the_cannula_nothing_jumps(stream: Stream) -> None:
    stream.follow((0.001, 0.0005, 0.0))
    stream.largest[:] = 0.0
    for height in (*np.linspace(0.0, 0.2, 500), *np.linspace(0.2, 0.0, 500)):
        stream.follow((0.001, 0.0005, height))
        assert stream.joints[2] >= 0.06
    assert (stream.largest <= SERVO * PERIOD_NS * 1e-9 * 1.01).all()
    for _ in range(1500):
        stream.follow((0.001, 0.0005, 0.0))
    assert stream.reported == "" and stream.place((0.001, 0.0005, 0.0)) < 1e-6


@pytest.mark.parametrize("turn", [(math.pi, 0.0, 0.0), (0.0, 2.3, 0.4), (-1.5, 1.5, 1.5), (0.3, 0.0, 3.0)])
def test_a_stream_from_rest_to_a_pose_turned_too_far_is_refused(stream: Stream, turn: tuple[float, ...]) -> None:
    here = stream.joints
    goal = stream.start.copy()
    goal[:3, 3] += (0.01, 0.0, 0.002)
    goal[:3, :3] = rotation_from_vector(np.array(turn)) @ goal[:3, :3]
    for _ in range(50):
        assert stream.harness.send("servo_cp", pose_from_matrix(goal)).outcomes == ["refused"]
    assert np.array_equal(stream.joints, here)
    stream.harness.run(0.6)
    assert not stream.follow()


@pytest.mark.parametrize("turn", [(1.3, 0.5, 0.0), (0.5, 1.2, 0.5), (-0.9, 0.9, 0.7)])
def test_a_stream_from_rest_to_an_unreachable_pose_settles(stream: Stream, turn: tuple[float, ...]) -> None:
    stream.harness.go((0.3, 0.2, 0.13, 0.5, 1.1, -1.1))
    stream.start, joints = matrix_from_pose(np.array(stream.harness.state["setpoint_cp"])), []
    for _ in range(1000):
        assert stream.follow((0.01, 0.0, 0.002), turn).startswith("at its limit")
        joints.append(stream.joints)
    assert np.abs(np.diff(joints[-50:], axis=0)).max() < 1e-6
    for joint in np.transpose(joints):
        assert reversals(joint) <= 2


def reversals(values: Any) -> int:
    """How often a joint turns round, by more than a degree each time."""
    count, way, furthest = 0, 0.0, values[0]
    for value in values:
        if way * (value - furthest) >= 0.0:
            way, furthest = way or value - values[0], value
        elif abs(value - furthest) > math.radians(1.0):
            count, way, furthest = count + 1, value - furthest, value
    return count


@pytest.mark.slow
@examples(5)
@given(st.lists(st.tuples(*[st.floats(-0.3, 0.3)] * 3, *[st.floats(-2.0, 2.0)] * 3), min_size=2, max_size=5))
def test_wherever_the_goals_go_it_follows_without_a_jump(made: Stream, points: list[tuple[float, ...]]) -> None:
    made.harness.run(0.6)
    made.largest[:] = 0.0
    made.may_end = True
    here = np.zeros(6)
    for point in (*points, (0.0,) * 6):
        steps = 500
        for part in np.linspace(0.0, 1.0, steps):
            now = here + part * (np.array(point) - here)
            if made.follow(now[:3], now[3:]) == "ended":  # further goals from there would be as far away
                made.harness.go(STRAIGHT)
                here = np.zeros(6)
                break
        else:
            here = np.array(point)
    made.may_end = False
    made.harness.go(STRAIGHT)
    made.harness.run(0.6)
    assert not made.follow()
    assert (made.largest <= SERVO * PERIOD_NS * 1e-9 * 1.01).all()


@pytest.mark.slow
def test_a_stream_that_was_held_up_does_not_make_up_for_it_at_once(stream: Stream) -> None:
    for angle in np.linspace(0.0, 1.2, 300):
        stream.follow(turn=(angle, 0.0, 0.0))
    for angle in np.linspace(1.2, 2.4, 20):  # far beyond what the wrist can do
        stream.follow((0.0, 0.0, -0.03), turn=(angle, 0.0, 0.0))
    assert stream.reported.startswith("at its limit: ")
    stream.follow()
    assert stream.reported.endswith("returning from the limit")
    stream.largest[:] = 0.0
    stream.harness.run(0.05)
    stream.follow()
    assert (stream.largest <= V_MAX * 0.0301).all(), stream.largest
    for _ in range(1500):
        stream.follow()
    assert stream.reported == "" and stream.place((0.0, 0.0, 0.0)) < 1e-6
