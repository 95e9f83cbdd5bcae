"""Numbers in the frame of an arm's base act like the same ones in its reference frame; other frames are refused."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from tests.arm.arm_configs import fixed_arm
from tests.arm.fake_io import ArmHarness
from tests.arm.test_cartesian_commands import bent
from trocar.procs.kinematics.poses import matrix_from_pose, pose_from_matrix
from trocar.procs.tables import codes

BASE = np.array((0.1, 0.2, 0.3, 0.5, 0.5, 0.5, 0.5))
R = matrix_from_pose(BASE)[:3, :3]
P = BASE[:3]
LOCAL, REFERENCE = "PSM1_base", "table"
ITSELF = (0.0, 0.0, 0.0, 1.0)
SHIFT = np.array((0.002, -0.001, 0.003, 0.0, 0.0, np.sin(0.02), np.cos(0.02)))
TWIST = np.array((0.01, 0.002, -0.003, 0.01, -0.02, 0.03))
WRENCH = np.array((0.3, -0.2, 0.5, 0.01, 0.02, -0.03))
GAINS = np.tile((-100.0, -50.0, -200.0, 0.0, 0.0, 0.0, *[0.0] * 18), 2)


def homed() -> ArmHarness:
    harness = bent()
    harness.send("set_base_frame", BASE, REFERENCE)
    harness.run(0.05)
    return harness


def tip(harness: ArmHarness) -> Any:
    """Near the measured tip, in the base."""
    near = matrix_from_pose(np.array(harness.state["local_measured_cp"])).copy()
    near[:3, 3] += (0.002, -0.001, 0.001)
    return pose_from_matrix(near)


def moved(pose: Any) -> Any:
    """A pose in the base, in the reference frame."""
    return pose_from_matrix(matrix_from_pose(BASE) @ matrix_from_pose(np.array(pose)))


def turned(vector: Any) -> Any:
    return np.concatenate((R @ vector[:3], R @ vector[3:]))


def increment(pose: Any) -> Any:
    """A shift and a turn in axes of the base, in those of the reference frame."""
    made = np.eye(4)
    made[:3, 3], made[:3, :3] = R @ pose[:3], R @ matrix_from_pose(np.array(pose))[:3, :3] @ R.T
    return pose_from_matrix(made)


def at_reference(wrench: Any) -> Any:
    """A wrench at the base's origin, at that of the reference frame."""
    force, torque = R @ wrench[:3], R @ wrench[3:]
    return np.concatenate((force, torque + np.cross(P, force)))


def rotation(quaternion: Any) -> Any:
    return moved((0.0, 0.0, 0.0, *quaternion))[3:]


def impedance(place: Any, axes: Any, orientation: Any) -> Any:
    return np.concatenate((place, axes, orientation, GAINS))


Numbers = Callable[[ArmHarness], Any]
COMMANDS: dict[str, tuple[Numbers, Numbers]] = {
    "servo_cp": (lambda h: (*tip(h), *TWIST), lambda h: (*moved(tip(h)), *turned(TWIST))),
    "servo_cr": (lambda h: SHIFT, lambda h: increment(SHIFT)),
    "servo_cs": (lambda h: (*tip(h), *TWIST, *WRENCH, 1, 1, 1),
                 lambda h: (*moved(tip(h)), *turned(TWIST), *turned(WRENCH), 1, 1, 1)),
    "move_cp": (tip, lambda h: moved(tip(h))),
    "move_cr": (lambda h: SHIFT, lambda h: increment(SHIFT)),
    "servo_cf": (lambda h: WRENCH, lambda h: turned(WRENCH)),
    "body/servo_cf": (lambda h: WRENCH, lambda h: turned(WRENCH)),
    "spatial/servo_cf": (lambda h: WRENCH, lambda h: at_reference(WRENCH)),
    "servo_ci": (lambda h: impedance(tip(h)[:3], BASE[3:], tip(h)[3:]),
                 lambda h: impedance(moved(tip(h))[:3], rotation(BASE[3:]), moved(tip(h))[3:])),
}


def effect(name: str, numbers: Numbers, frame: str) -> Any:
    """Setpoints, their velocities and efforts after a while."""
    harness = homed()
    before = np.concatenate((harness.state["setpoint_position"][:6], np.zeros(6)))
    request = harness.send(name, numbers(harness), frame)
    assert request.outcomes[-1] in ("done", "accepted"), request.replies
    found = []
    for _ in range(3):
        harness.run(0.02)
        motion = harness.arm.control.motion
        found.append(np.concatenate((harness.state["setpoint_position"][:6], motion.effort[:6])))
    assert np.abs(found[-1] - before).max() > 1e-5, "it has an effect"
    return np.array(found)


@pytest.mark.parametrize("name", COMMANDS)
def test_numbers_in_the_base_act_like_the_same_ones_in_the_reference_frame(name: str) -> None:
    local, reference = COMMANDS[name]
    assert effect(name, local, LOCAL) == pytest.approx(effect(name, reference, REFERENCE), abs=1e-7)


@pytest.mark.parametrize("name", ["servo_cp", "servo_cr", "servo_cs", "move_cp", "move_cr", "servo_ci"])
def test_without_a_frame_the_reference_frame_is_meant(name: str) -> None:
    reference = COMMANDS[name][1]
    assert effect(name, reference, "") == pytest.approx(effect(name, reference, REFERENCE), abs=1e-12)


@pytest.mark.parametrize(("name", "frame"), [("body/servo_cf", "PSM1"), ("spatial/servo_cf", LOCAL)])
def test_wrenches_have_by_default_the_frame_in_which_they_are_published(name: str, frame: str) -> None:
    def numbers(_: ArmHarness) -> Any:
        return WRENCH

    assert effect(name, numbers, "") == pytest.approx(effect(name, numbers, frame), abs=1e-12)


def test_another_frame_is_refused_with_those_that_are_known() -> None:
    harness = homed()
    before = harness.state["setpoint_position"].copy()
    for name, (_, numbers) in COMMANDS.items():
        with harness.hurried():
            harness.run(2.5)  # the warning is not repeated before
        harness.reports.events.clear()
        for frame in ("world", "PSM2_base", "psm1_base", "Cart"):
            request = harness.send(name, numbers(harness), frame)
            assert request.outcomes == ["refused"], (name, frame)
            assert all(known in request.replies[0][1] for known in (frame, REFERENCE, LOCAL)), (name, frame)
        assert [event for event in harness.reports.of("warning") if codes.UNKNOWN_FRAME.code in map(str, event)], name
    harness.run(0.05)
    assert harness.state["setpoint_position"] == pytest.approx(before, abs=1e-9)


@pytest.mark.parametrize("name", ["servo_cp", "servo_cr", "move_cp", "move_cr"])
def test_in_its_base_an_arm_moves_where_its_base_frame_is_not_known(name: str) -> None:
    harness = homed()
    harness.send("set_base_frame")
    request = harness.send(name, COMMANDS[name][0](harness)[:7], LOCAL)
    assert request.outcomes[-1] in ("done", "accepted")


def test_the_base_frame_at_the_time_of_the_command_counts() -> None:
    harness = homed()
    goal = tip(harness)
    for k in range(5):
        harness.send("set_base_frame", (*BASE[:3] + 0.0005 * k, *BASE[3:]), REFERENCE)
        assert harness.send("servo_cp", goal, LOCAL).outcomes == ["done"]
        harness.run(0.05)
    assert harness.state["local_measured_cp"][:3] == pytest.approx(goal[:3], abs=1e-6)


def test_a_reference_frame_never_has_the_name_of_the_base() -> None:
    harness = ArmHarness(fixed_arm()).homed()
    assert harness.send("set_base_frame", BASE, LOCAL).outcomes == ["refused"]
    assert harness.state["base_frame"] == pytest.approx((0, 0, 0, *ITSELF))
    assert harness.send("set_base_frame", BASE).outcomes == ["done"]
    assert harness.state["reference_frame"] not in (b"", LOCAL.encode())
    assert harness.send("set_base_frame", (0.0, 0.0, 0.0, *ITSELF), LOCAL).outcomes == ["done"]
    assert harness.state["reference_frame"] == LOCAL.encode()


def test_a_name_without_a_pose_keeps_it_and_a_long_one_is_refused() -> None:
    harness = homed()
    harness.send("set_base_frame", (*BASE[:3] + 0.001, *BASE[3:]))
    assert harness.state["reference_frame"] == REFERENCE.encode()
    assert harness.send("set_base_frame", BASE, "x" * 25).outcomes == ["refused"]
    assert harness.state["reference_frame"] == REFERENCE.encode()
