"""A master whose orientation is locked: a hand moves the first three joints, the wrist keeps the tip's axes."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.arm.fake_io import SECOND
from tests.arm.fake_master import MasterHarness, actuator_of, master
from tests.arm.test_recovery import restart
from trocar.procs.kinematics.poses import matrix_from_pose, pose_from_matrix, rotation_vector

START = (0.1, 0.2, 0.1, 0.2, 0.3, 0.1, 0.5)
BASE = (0.1, 0.2, 0.3, 0.0, 0.0, math.sqrt(0.5), math.sqrt(0.5))
LOCKED, UNLOCKED = ("orientation_locked", True), ("orientation_locked", False)


@pytest.fixture
def harness() -> MasterHarness:
    """Free of wrenches, and bent."""
    made = MasterHarness(master()).homed()
    made.send("set_base_frame", BASE, "world")
    made.send("body/servo_cf", (0,) * 6)
    made.put(*START)
    made.send("body/servo_cf", (0,) * 6)
    made.reports.events.clear()
    return made


def reported(harness: MasterHarness) -> list[tuple[str, bool]]:
    events = [(e[0], bool(e[2])) for e in harness.reports.of("orientation_locked")]
    harness.reports.events.clear()
    return events


def axes(harness: MasterHarness) -> np.ndarray:
    """Of the tip in the reference frame."""
    harness.step()
    return matrix_from_pose(harness.state["measured_cp"])[:3, :3].copy()


def off(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.linalg.norm(rotation_vector(a.T @ b)))


def joints(harness: MasterHarness) -> np.ndarray:
    return harness.arm.io.position.copy()


def carry(harness: MasterHarness, outer: float, shoulder: float, elbow: float, seconds: float = 1.0) -> float:
    """A hand takes the tip elsewhere; returns the largest step of the joints that follow [rad/s]."""
    count, largest = round(seconds * SECOND / harness.period_ns), 0.0
    start, end = joints(harness)[:3], np.array((outer, shoulder, elbow))
    for k in range(1, count + 1):
        now = np.zeros(7)
        now[:3] = start + (end - start) * k / count
        harness.io.position[:3] = actuator_of(now)[:3]
        before = joints(harness)[3:]
        harness.step()
        largest = max(largest, float(np.abs(joints(harness)[3:] - before).max()) * SECOND / harness.period_ns)
    return largest


def test_orientation_stays_where_it_was_while_the_tip_is_moved(harness: MasterHarness) -> None:
    wanted = axes(harness)
    assert harness.send("lock_orientation").outcomes == ["done"] and reported(harness) == [LOCKED]
    assert harness.setpoint["in_effort"][:7].tolist() == [True] * 3 + [False] * 4
    assert carry(harness, -0.4, 0.5, -0.2, 2.0) < 2.5
    harness.run(1.0)
    assert off(axes(harness), wanted) < 1e-4 and joints(harness)[0] == pytest.approx(-0.4)
    carry(harness, *START[:3], 2.0)
    harness.run(1.0)
    assert joints(harness) == pytest.approx(START, abs=1e-4), "back where it began"
    assert not harness.reports.of("warning")


def test_locking_does_not_move_anything(harness: MasterHarness) -> None:
    before = joints(harness)
    harness.send("lock_orientation")
    harness.run(0.3)
    assert joints(harness) == pytest.approx(before, abs=1e-6)


def test_another_orientation_is_gone_to_smoothly(harness: MasterHarness) -> None:
    turned = matrix_from_pose(np.array((0, 0, 0, math.sin(0.15), 0, 0, math.cos(0.15))))[:3, :3] @ axes(harness)
    half = np.zeros((4, 4))
    half[:3, :3], half[3, 3] = turned, 1.0
    quaternion = quaternion_of(half)
    harness.io.largest_step = 0.0
    harness.send("lock_orientation", quaternion)
    harness.run(2.0)
    assert off(axes(harness), turned) < 1e-4
    assert harness.io.largest_step < math.radians(360.0) * harness.period_ns / SECOND
    harness.send("lock_orientation")
    assert reported(harness) == [LOCKED], "told once"


def quaternion_of(pose: np.ndarray) -> np.ndarray:
    return pose_from_matrix(pose)[3:]


def test_efforts_of_the_first_three_joints_go_on(harness: MasterHarness) -> None:
    harness.send("lock_orientation")
    harness.send("body/servo_cf", (0, 1, 0, 0, 0, 0))
    harness.step()
    jacobian = harness.state["jacobian"][:, :7]
    assert harness.setpoint["in_effort"][:7].tolist() == [True] * 3 + [False] * 4
    assert harness.setpoint["effort"][0] == pytest.approx(float(jacobian[1, 0]), abs=1e-9)
    assert not harness.setpoint["effort"][3:7].any() and harness.arm._lock.locked


@pytest.mark.parametrize("command", ("unlock_orientation", "free", "hold", "servo_jf", "move_jp", "servo_jp"))
def test_it_ends_with_any_other_mode(harness: MasterHarness, command: str) -> None:
    harness.send("lock_orientation")
    harness.run(0.1)
    reported(harness)
    harness.send(command, START if command.endswith("jp") else (0.0,) * 7 if command.endswith("jf") else ())
    harness.step()
    assert reported(harness) == [UNLOCKED]
    in_effort = command in ("unlock_orientation", "free", "servo_jf")
    assert harness.setpoint["in_effort"][:7].tolist() == [in_effort] * 7
    harness.send("body/servo_cf", (0,) * 6)
    harness.step()
    assert harness.setpoint["in_effort"][:7].all() and reported(harness) == []


def test_it_needs_cartesian_effort_mode(harness: MasterHarness) -> None:
    harness.send("hold")
    request = harness.send("lock_orientation")
    assert request.outcomes == ["refused"] and "body/servo_cf first" in request.replies[0][1]
    assert reported(harness) == []
    assert harness.send("unlock_orientation").outcomes == ["done"]


@pytest.mark.parametrize("quaternion", ((0.0, 0.0, 0.0, 0.0), (1.0, 1.0, 1.0, 1.0), (0.0, 0.0, 1.0)))
def test_what_is_no_orientation_is_refused(harness: MasterHarness, quaternion: tuple[float, ...]) -> None:
    assert harness.send("lock_orientation", quaternion).outcomes == ["refused"] and reported(harness) == []


def test_an_orientation_out_of_reach_is_refused_and_the_old_one_stays(harness: MasterHarness) -> None:
    wanted = axes(harness)
    harness.send("lock_orientation")
    far = np.eye(4)
    far[:3, :3] = wanted @ matrix_from_pose(np.array((0, 0, 0, 0, 1.0, 0, 0)))[:3, :3]
    request = harness.send("lock_orientation", quaternion_of(far))
    assert request.outcomes == ["refused"] and "inverse kinematics" in request.replies[0][1]
    carry(harness, 0.0, 0.3, 0.0)
    harness.run(1.0)
    assert off(axes(harness), wanted) < 1e-4


def test_an_orientation_that_cannot_be_kept_is_one_warning(harness: MasterHarness) -> None:
    joints_at_limit = np.array(START)
    joints_at_limit[4] = 3.2
    harness.put(*joints_at_limit)
    wanted = axes(harness)
    harness.send("lock_orientation")
    carry(harness, 0.1, 0.2, -0.3)
    harness.run(0.5)
    assert len(harness.reports.of("warning")) == 1 and "wrist_pitch would be" in harness.reports.of("warning")[0][2]
    assert joints(harness)[4] < 3.2289 and harness.arm._lock.locked
    carry(harness, 0.1, 0.2, 0.1)
    harness.run(1.0)
    assert off(axes(harness), wanted) < 1e-4
    carry(harness, 0.1, 0.2, -0.3)
    assert len(harness.reports.of("warning")) == 2, "another episode"


def test_the_platform_takes_over_before_the_limit_of_the_yaw(harness: MasterHarness) -> None:
    harness.put(*START[:5], 0.7, 0.5)
    wanted = axes(harness)
    harness.send("lock_orientation")
    carry(harness, -0.5, 0.2, 0.1, 2.0)
    harness.run(1.0)
    assert off(axes(harness), wanted) < 1e-4 and abs(joints(harness)[5]) < 0.7854 - 0.08
    assert abs(joints(harness)[3] - START[3]) > 0.02


@pytest.mark.parametrize("lock", (False, True))
def test_a_process_that_dies_leaves_it_held_and_unlocked(harness: MasterHarness, lock: bool) -> None:
    if lock:
        harness.send("lock_orientation")
    carry(harness, 0.2, 0.25, 0.0)
    restart(harness)
    held = harness.io.position.copy()
    harness.io.largest_step = 0.0
    harness.run(0.5)
    assert harness.arm.state == "HOMED" and harness.state["is_homed"]
    assert np.allclose(harness.io.position, held, atol=1e-12) and harness.io.largest_step < 1e-12
    assert not harness.setpoint["in_effort"].any() and reported(harness) == [UNLOCKED]


def test_a_process_that_was_stopped_goes_on_from_where_io_held(harness: MasterHarness) -> None:
    harness.send("lock_orientation")
    carry(harness, 0.1, 0.6, 0.1, 0.2)
    for _ in range(300):  # SIGSTOP, SIGCONT
        harness.now_ns += harness.period_ns
        harness.setpoint.set("mode", 0)
        harness.io.flag("holding", True)
        harness.io.cycle(harness.now_ns, harness.setpoint)
    harness.io.largest_step = 0.0
    harness.step()
    harness.io.flag("holding", False)
    harness.run(0.5)
    assert harness.io.largest_step < math.radians(90.0) * harness.period_ns / SECOND
