"""A master whose orientation is locked: a hand moves the first three joints, the wrist keeps the tip's axes."""

from __future__ import annotations

import math

import numpy as np
import pytest

from procs.kinematics.poses import matrix_from_pose, pose_from_matrix, rotation_vector
from tests.arm.fake_io import SECOND
from tests.arm.fake_master import MasterRig, actuator_of, master
from tests.arm.test_recovery import restart

START = (0.1, 0.2, 0.1, 0.2, 0.3, 0.1, 0.5)
BASE = (0.1, 0.2, 0.3, 0.0, 0.0, math.sqrt(0.5), math.sqrt(0.5))
LOCKED, UNLOCKED = ("orientation_locked", True), ("orientation_locked", False)


@pytest.fixture
def rig() -> MasterRig:
    """Free of wrenches, and bent."""
    made = MasterRig(master()).homed()
    made.send("set_base_frame", BASE, "world")
    made.send("body/servo_cf", (0,) * 6)
    made.put(*START)
    made.send("body/servo_cf", (0,) * 6)
    made.reports.events.clear()
    return made


def said(rig: MasterRig) -> list[tuple[str, bool]]:
    events = [(e[0], bool(e[2])) for e in rig.reports.of("orientation_locked")]
    rig.reports.events.clear()
    return events


def axes(rig: MasterRig) -> np.ndarray:
    """Of the tip in the reference frame."""
    rig.step()
    return matrix_from_pose(rig.state["measured_cp"])[:3, :3].copy()


def off(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.linalg.norm(rotation_vector(a.T @ b)))


def joints(rig: MasterRig) -> np.ndarray:
    return rig.arm.io.position.copy()


def carry(rig: MasterRig, outer: float, shoulder: float, elbow: float, seconds: float = 1.0) -> float:
    """A hand takes the tip elsewhere; returns the largest step of the joints that follow [rad/s]."""
    count, largest = round(seconds * SECOND / rig.period_ns), 0.0
    start, end = joints(rig)[:3], np.array((outer, shoulder, elbow))
    for k in range(1, count + 1):
        now = np.zeros(7)
        now[:3] = start + (end - start) * k / count
        rig.io.position[:3] = actuator_of(now)[:3]
        before = joints(rig)[3:]
        rig.step()
        largest = max(largest, float(np.abs(joints(rig)[3:] - before).max()) * SECOND / rig.period_ns)
    return largest


def test_orientation_stays_where_it_was_while_the_tip_is_moved(rig: MasterRig) -> None:
    wanted = axes(rig)
    assert rig.send("lock_orientation").outcomes == ["done"] and said(rig) == [LOCKED]
    assert rig.setpoint["in_effort"][:7].tolist() == [True] * 3 + [False] * 4
    assert carry(rig, -0.4, 0.5, -0.2, 2.0) < 2.5
    rig.run(1.0)
    assert off(axes(rig), wanted) < 1e-4 and joints(rig)[0] == pytest.approx(-0.4)
    carry(rig, *START[:3], 2.0)
    rig.run(1.0)
    assert joints(rig) == pytest.approx(START, abs=1e-4), "back where it began"
    assert not rig.reports.of("warning")


def test_locking_does_not_move_anything(rig: MasterRig) -> None:
    before = joints(rig)
    rig.send("lock_orientation")
    rig.run(0.3)
    assert joints(rig) == pytest.approx(before, abs=1e-6)


def test_another_orientation_is_gone_to_smoothly(rig: MasterRig) -> None:
    turned = matrix_from_pose(np.array((0, 0, 0, math.sin(0.15), 0, 0, math.cos(0.15))))[:3, :3] @ axes(rig)
    half = np.zeros((4, 4))
    half[:3, :3], half[3, 3] = turned, 1.0
    quaternion = quaternion_of(half)
    rig.io.largest_step = 0.0
    rig.send("lock_orientation", quaternion)
    rig.run(2.0)
    assert off(axes(rig), turned) < 1e-4
    assert rig.io.largest_step < math.radians(360.0) * rig.period_ns / SECOND
    rig.send("lock_orientation")
    assert said(rig) == [LOCKED], "told once"


def quaternion_of(pose: np.ndarray) -> np.ndarray:
    return pose_from_matrix(pose)[3:]


def test_efforts_of_the_first_three_joints_go_on(rig: MasterRig) -> None:
    rig.send("lock_orientation")
    rig.send("body/servo_cf", (0, 1, 0, 0, 0, 0))
    rig.step()
    jacobian = rig.state["jacobian"][:, :7]
    assert rig.setpoint["in_effort"][:7].tolist() == [True] * 3 + [False] * 4
    assert rig.setpoint["effort"][0] == pytest.approx(float(jacobian[1, 0]), abs=1e-9)
    assert not rig.setpoint["effort"][3:7].any() and rig.arm._lock.locked


@pytest.mark.parametrize("command", ("unlock_orientation", "free", "hold", "servo_jf", "move_jp", "servo_jp"))
def test_it_ends_with_any_other_mode(rig: MasterRig, command: str) -> None:
    rig.send("lock_orientation")
    rig.run(0.1)
    said(rig)
    rig.send(command, START if command.endswith("jp") else (0.0,) * 7 if command.endswith("jf") else ())
    rig.step()
    assert said(rig) == [UNLOCKED]
    in_effort = command in ("unlock_orientation", "free", "servo_jf")
    assert rig.setpoint["in_effort"][:7].tolist() == [in_effort] * 7
    rig.send("body/servo_cf", (0,) * 6)
    rig.step()
    assert rig.setpoint["in_effort"][:7].all() and said(rig) == []


def test_it_needs_cartesian_effort_mode(rig: MasterRig) -> None:
    rig.send("hold")
    request = rig.send("lock_orientation")
    assert request.outcomes == ["refused"] and "body/servo_cf first" in request.replies[0][1]
    assert said(rig) == []
    assert rig.send("unlock_orientation").outcomes == ["done"]


@pytest.mark.parametrize("quaternion", ((0.0, 0.0, 0.0, 0.0), (1.0, 1.0, 1.0, 1.0), (0.0, 0.0, 1.0)))
def test_what_is_no_orientation_is_refused(rig: MasterRig, quaternion: tuple[float, ...]) -> None:
    assert rig.send("lock_orientation", quaternion).outcomes == ["refused"] and said(rig) == []


def test_an_orientation_out_of_reach_is_refused_and_the_old_one_stays(rig: MasterRig) -> None:
    wanted = axes(rig)
    rig.send("lock_orientation")
    far = np.eye(4)
    far[:3, :3] = wanted @ matrix_from_pose(np.array((0, 0, 0, 0, 1.0, 0, 0)))[:3, :3]
    request = rig.send("lock_orientation", quaternion_of(far))
    assert request.outcomes == ["refused"] and "inverse kinematics" in request.replies[0][1]
    carry(rig, 0.0, 0.3, 0.0)
    rig.run(1.0)
    assert off(axes(rig), wanted) < 1e-4


def test_an_orientation_that_cannot_be_kept_is_one_warning(rig: MasterRig) -> None:
    joints_at_limit = np.array(START)
    joints_at_limit[4] = 3.2
    rig.put(*joints_at_limit)
    wanted = axes(rig)
    rig.send("lock_orientation")
    carry(rig, 0.1, 0.2, -0.3)
    rig.run(0.5)
    assert len(rig.reports.of("warning")) == 1 and "wrist_pitch would be" in rig.reports.of("warning")[0][2]
    assert joints(rig)[4] < 3.2289 and rig.arm._lock.locked
    carry(rig, 0.1, 0.2, 0.1)
    rig.run(1.0)
    assert off(axes(rig), wanted) < 1e-4
    carry(rig, 0.1, 0.2, -0.3)
    assert len(rig.reports.of("warning")) == 2, "another episode"


def test_the_platform_takes_over_at_the_limit_of_the_yaw(rig: MasterRig) -> None:
    rig.put(*START[:5], 0.7, 0.5)
    wanted = axes(rig)
    rig.send("lock_orientation")
    carry(rig, -0.5, 0.2, 0.1, 2.0)
    rig.run(1.0)
    assert off(axes(rig), wanted) < 1e-4 and abs(joints(rig)[5]) == pytest.approx(0.7854, abs=1e-4)
    assert abs(joints(rig)[3] - START[3]) > 0.02


@pytest.mark.parametrize("lock", (False, True))
def test_a_process_that_dies_leaves_it_held_and_unlocked(rig: MasterRig, lock: bool) -> None:
    if lock:
        rig.send("lock_orientation")
    carry(rig, 0.2, 0.25, 0.0)
    restart(rig)
    held = rig.io.position.copy()
    rig.io.largest_step = 0.0
    rig.run(0.5)
    assert rig.arm.state == "HOMED" and rig.state["is_homed"]
    assert np.allclose(rig.io.position, held, atol=1e-12) and rig.io.largest_step < 1e-12
    assert not rig.setpoint["in_effort"].any() and said(rig) == [UNLOCKED]


def test_a_process_that_was_stopped_goes_on_from_where_io_held(rig: MasterRig) -> None:
    rig.send("lock_orientation")
    carry(rig, 0.1, 0.6, 0.1, 0.2)
    for _ in range(300):  # SIGSTOP, SIGCONT
        rig.now_ns += rig.period_ns
        rig.setpoint.set("mode", 0)
        rig.io.flag("holding", True)
        rig.io.cycle(rig.now_ns, rig.setpoint)
    rig.io.largest_step = 0.0
    rig.step()
    rig.io.flag("holding", False)
    rig.run(0.5)
    assert rig.io.largest_step < math.radians(90.0) * rig.period_ns / SECOND
