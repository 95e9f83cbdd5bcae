"""Efforts that nobody asks for again: a PSM or ECM holds, a master is let go of; none at all last for ever."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.arm.arm_configs import fixed_arm
from tests.arm.fake_io import ArmHarness
from tests.arm.fake_master import MasterHarness, master
from tests.arm.fake_requests import FakeRequest
from tests.arm.test_master_efforts import bent, borne, gains, joint_effort
from tests.kinematics.test_gravity import parameters

DEEP = (0.0, 0.0, 0.12, 0.0, 0.0, 0.0)
PUSH = (0.0, 0.0, 0.5, 0.0, 0.0, 0.0)
POSITION, EFFORT = 1, 3


def deep(**changes: Any) -> ArmHarness:
    harness = ArmHarness(fixed_arm(**changes)).homed()
    harness.go(DEEP)
    harness.reports.events.clear()
    return harness


def reported(harness: ArmHarness) -> list[str]:
    return [event[2] for event in harness.reports.of("warning") if event[1] == "effort-timeout"]


def impedance(harness: ArmHarness, stiffness: float) -> list[float]:
    tip = np.array(harness.state["measured_cp"])
    return [*tip[:3], 0, 0, 0, 1, *tip[3:], *gains((stiffness,) * 3, (0.0,) * 3)]


@pytest.mark.parametrize("command", ("servo_jf", "body/servo_cf", "spatial/servo_cf", "jaw/servo_jf", "servo_ci"))
def test_an_arm_whose_client_has_died_holds_and_says_so_once(command: str) -> None:
    harness = deep()
    values = {"jaw/servo_jf": (0.05,), "servo_ci": impedance(harness, -100.0)}.get(command, PUSH)
    harness.send(command, values)
    harness.run(0.09)
    assert harness.state["control_mode"] == EFFORT and harness.setpoint["in_effort"][:7].all()
    harness.run(0.02)
    assert harness.state["control_mode"] == POSITION and not harness.setpoint["in_effort"].any()
    assert harness.setpoint["position"][:3] == pytest.approx(harness.io.position[:3])
    harness.run(3.0)
    assert reported(harness) == ["PSM1: no effort command for 0.1 s; holding"]


def test_efforts_that_are_asked_for_again_go_on() -> None:
    harness = deep()
    for _ in range(20):
        harness.send("servo_jf", PUSH)
        harness.run(0.05)
    assert harness.state["control_mode"] == EFFORT and not reported(harness)
    harness.run(0.1)
    assert harness.state["control_mode"] == POSITION


def test_a_stream_that_is_too_slow_is_told_once_another_client_anew() -> None:
    harness = deep()
    for _ in range(10):
        harness.send("servo_jf", PUSH)
        harness.run(0.3)
    assert len(reported(harness)) == 1
    harness.run(0.5)
    harness.send("servo_jf", PUSH)
    harness.run(0.2)
    assert len(reported(harness)) == 2


@pytest.mark.parametrize("command", ("servo_jf", "body/servo_cf", "spatial/servo_cf", "servo_ci", "free"))
def test_no_efforts_last_for_ever(command: str) -> None:
    harness = deep()
    harness.send(command, {"servo_ci": impedance(harness, 0.0), "free": ()}.get(command, (0.0,) * 6))
    harness.run(3.0)
    assert harness.state["control_mode"] == EFFORT and not reported(harness)


def test_efforts_that_were_taken_back_end_nothing() -> None:
    harness = deep()
    harness.send("servo_jf", PUSH)
    harness.send("servo_jf", (0.0,) * 6)
    harness.send("jaw/servo_jf", (0.05,))
    harness.send("jaw/servo_jf", (0.0,))
    harness.run(1.0)
    assert harness.state["control_mode"] == EFFORT and not reported(harness)


def test_a_jaw_effort_is_no_excuse_for_the_arms_nor_the_other_way_round() -> None:
    jaw, arm = ("jaw/servo_jf", (0.05,)), ("servo_jf", PUSH)
    for stream, once in ((jaw, arm), (arm, jaw)):
        harness = deep()
        harness.send(*once)
        for _ in range(8):
            harness.send(*stream)
            harness.run(0.02)
        assert len(reported(harness)) == 1


def test_an_effort_after_the_end_begins_anew() -> None:
    harness = deep()
    harness.send("jaw/servo_jf", (0.05,))
    harness.run(0.2)
    harness.send("servo_jf", PUSH)
    harness.run(0.05)
    assert harness.state["control_mode"] == EFFORT
    efforts = np.linalg.solve(harness.arm.joints.to_joint.T, harness.setpoint["effort"][:7])
    assert efforts == pytest.approx((0, 0, 0.5, 0, 0, 0, 0)), "that of the jaw is over"


def test_the_time_can_be_set_and_0_is_for_ever() -> None:
    harness = deep(effort_timeout_s=0.5)
    harness.send("servo_jf", PUSH)
    harness.run(0.45)
    assert harness.state["control_mode"] == EFFORT
    harness.run(0.1)
    assert harness.state["control_mode"] == POSITION
    harness = deep(effort_timeout_s=0.0)
    harness.send("servo_jf", PUSH)
    harness.run(5.0)
    assert harness.state["control_mode"] == EFFORT


def test_a_wrench_does_not_last_longer_because_it_says_so() -> None:
    harness = deep()
    harness.send("body/servo_cf", (0, 0, 1, 0, 0, 0, 2.0))
    harness.run(0.12)
    assert harness.state["control_mode"] == POSITION and len(reported(harness)) == 1


def test_a_wrench_beside_a_pose_ends_and_the_pose_is_held() -> None:
    harness = deep()
    pose = tuple(harness.state["setpoint_cp"])
    harness.send("servo_cs", (*pose, *(0.0,) * 6, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 1.0))
    harness.run(0.09)
    assert harness.setpoint["feed_forward"][2] == pytest.approx(1.0)
    before = harness.io.setpoint.copy()
    harness.run(0.02)
    assert not harness.setpoint["feed_forward"].any() and harness.io.setpoint == pytest.approx(before)
    assert reported(harness) == ["PSM1: no new wrench for 0.1 s; the wrench has ended"]


# masters

@pytest.mark.parametrize("command", ("servo_jf", "body/servo_cf", "servo_ci"))
def test_a_master_is_let_go_of_but_for_its_weight(command: str) -> None:
    harness = bent(master(platform_gain=0.0, master_gravity=parameters("jhu-dVRK/gc-MTML-22723.json")))
    harness.send("use_gravity_compensation", (0,))
    values = impedance(harness, -50.0) if command == "servo_ci" else (0.02,) * (7 if command == "servo_jf" else 6)
    harness.send(command, values)
    harness.run(0.08)
    if command != "servo_ci":
        assert joint_effort(harness).any()
    harness.run(0.03)
    assert harness.state["control_mode"] == EFFORT and harness.state["control_space"] == 2
    assert not joint_effort(harness).any() and borne(harness).any(), "its weight is borne, whatever was said before"
    harness.run(3.0)
    assert reported(harness) == ["MTML: no effort command for 0.1 s; released"]


def test_a_locked_orientation_stays_locked(harness: MasterHarness) -> None:
    harness.send("body/servo_cf", (0, 0, 1, 0, 0, 0))
    harness.send("lock_orientation")
    harness.run(0.5)
    assert len(reported(harness)) == 1
    assert harness.setpoint["in_effort"][:7].tolist() == [True, False, False, False, False, False, False] or (
        not harness.setpoint["in_effort"][4:7].any())
    assert not [e for e in harness.reports.of("orientation_locked") if not e[2]]


@pytest.fixture
def harness() -> MasterHarness:
    return bent(master(platform_gain=0.0))


def test_a_master_that_a_teleoperation_lets_go_is_borne_at_once_though_its_weight_was_switched_off() -> None:
    harness = bent(master(platform_gain=0.0, master_gravity=parameters("jhu-dVRK/gc-MTML-22723.json")))
    borne = harness.state["gravity_effort"][:7].copy()
    harness.send("hold")
    harness.send("use_gravity_compensation", (0,))
    harness.run(2.0)
    assert not harness.state["gravity_effort"].any() and borne.any()
    harness.step(FakeRequest("use_gravity_compensation", (1.0,)), FakeRequest("body/servo_cf", (0.0,) * 6))
    assert harness.state["control_mode"] == 3
    assert harness.state["gravity_effort"][:7] == pytest.approx(borne, abs=1e-3)
