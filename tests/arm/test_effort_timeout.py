"""Efforts that nobody asks for again: a PSM or ECM holds, a master is let go of; none at all last for ever."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.arm.fake_io import Rig, fixed_arm
from tests.arm.fake_master import MasterRig, master
from tests.arm.test_master_efforts import bent, borne, gains, joint_effort
from tests.lib.test_gravity import parameters

DEEP = (0.0, 0.0, 0.12, 0.0, 0.0, 0.0)
PUSH = (0.0, 0.0, 0.5, 0.0, 0.0, 0.0)
POSITION, EFFORT = 1, 3


def deep(**changes: Any) -> Rig:
    rig = Rig(fixed_arm(**changes)).homed()
    rig.go(DEEP)
    rig.reports.events.clear()
    return rig


def told(rig: Rig) -> list[str]:
    return [event[2] for event in rig.reports.of("warning") if event[1] == "effort-timeout"]


def impedance(rig: Rig, stiffness: float) -> list[float]:
    tip = np.array(rig.state["measured_cp"])
    return [*tip[:3], 0, 0, 0, 1, *tip[3:], *gains((stiffness,) * 3, (0.0,) * 3)]


@pytest.mark.parametrize("command", ("servo_jf", "body/servo_cf", "spatial/servo_cf", "jaw/servo_jf", "servo_ci"))
def test_an_arm_whose_client_has_died_holds_and_says_so_once(command: str) -> None:
    rig = deep()
    values = {"jaw/servo_jf": (0.05,), "servo_ci": impedance(rig, -100.0)}.get(command, PUSH)
    rig.send(command, values)
    rig.run(0.09)
    assert rig.state["control_mode"] == EFFORT and rig.setpoint["in_effort"][:7].all()
    rig.run(0.02)
    assert rig.state["control_mode"] == POSITION and not rig.setpoint["in_effort"].any()
    assert rig.setpoint["position"][:3] == pytest.approx(rig.io.position[:3])
    rig.run(3.0)
    assert told(rig) == ["PSM1: no effort command for 0.1 s; holding"]


def test_efforts_that_are_asked_for_again_go_on() -> None:
    rig = deep()
    for _ in range(20):
        rig.send("servo_jf", PUSH)
        rig.run(0.05)
    assert rig.state["control_mode"] == EFFORT and not told(rig)
    rig.run(0.1)
    assert rig.state["control_mode"] == POSITION


def test_a_stream_that_is_too_slow_is_told_once_another_client_anew() -> None:
    rig = deep()
    for _ in range(10):
        rig.send("servo_jf", PUSH)
        rig.run(0.3)
    assert len(told(rig)) == 1
    rig.run(0.5)
    rig.send("servo_jf", PUSH)
    rig.run(0.2)
    assert len(told(rig)) == 2


@pytest.mark.parametrize("command", ("servo_jf", "body/servo_cf", "spatial/servo_cf", "servo_ci", "free"))
def test_no_efforts_last_for_ever(command: str) -> None:
    rig = deep()
    rig.send(command, {"servo_ci": impedance(rig, 0.0), "free": ()}.get(command, (0.0,) * 6))
    rig.run(3.0)
    assert rig.state["control_mode"] == EFFORT and not told(rig)


def test_efforts_that_were_taken_back_end_nothing() -> None:
    rig = deep()
    rig.send("servo_jf", PUSH)
    rig.send("servo_jf", (0.0,) * 6)
    rig.send("jaw/servo_jf", (0.05,))
    rig.send("jaw/servo_jf", (0.0,))
    rig.run(1.0)
    assert rig.state["control_mode"] == EFFORT and not told(rig)


def test_a_jaw_effort_is_no_excuse_for_the_arms_nor_the_other_way_round() -> None:
    jaw, arm = ("jaw/servo_jf", (0.05,)), ("servo_jf", PUSH)
    for stream, once in ((jaw, arm), (arm, jaw)):
        rig = deep()
        rig.send(*once)
        for _ in range(8):
            rig.send(*stream)
            rig.run(0.02)
        assert len(told(rig)) == 1


def test_an_effort_after_the_end_begins_anew() -> None:
    rig = deep()
    rig.send("jaw/servo_jf", (0.05,))
    rig.run(0.2)
    rig.send("servo_jf", PUSH)
    rig.run(0.05)
    assert rig.state["control_mode"] == EFFORT
    efforts = np.linalg.solve(rig.arm.joints.to_joint.T, rig.setpoint["effort"][:7])
    assert efforts == pytest.approx((0, 0, 0.5, 0, 0, 0, 0)), "that of the jaw is over"


def test_the_time_can_be_set_and_0_is_for_ever() -> None:
    rig = deep(effort_timeout_s=0.5)
    rig.send("servo_jf", PUSH)
    rig.run(0.45)
    assert rig.state["control_mode"] == EFFORT
    rig.run(0.1)
    assert rig.state["control_mode"] == POSITION
    rig = deep(effort_timeout_s=0.0)
    rig.send("servo_jf", PUSH)
    rig.run(5.0)
    assert rig.state["control_mode"] == EFFORT


def test_a_wrench_does_not_last_longer_because_it_says_so() -> None:
    rig = deep()
    rig.send("body/servo_cf", (0, 0, 1, 0, 0, 0, 2.0))
    rig.run(0.12)
    assert rig.state["control_mode"] == POSITION and len(told(rig)) == 1


def test_a_wrench_beside_a_pose_ends_and_the_pose_is_held() -> None:
    rig = deep()
    pose = tuple(rig.state["setpoint_cp"])
    rig.send("servo_cs", (*pose, *(0.0,) * 6, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 1.0))
    rig.run(0.09)
    assert rig.setpoint["feed_forward"][2] == pytest.approx(1.0)
    before = rig.io.setpoint.copy()
    rig.run(0.02)
    assert not rig.setpoint["feed_forward"].any() and rig.io.setpoint == pytest.approx(before)
    assert told(rig) == ["PSM1: no new wrench for 0.1 s; none any more"]


# masters

@pytest.mark.parametrize("command", ("servo_jf", "body/servo_cf", "servo_ci"))
def test_a_master_is_let_go_of_but_for_its_weight(command: str) -> None:
    rig = bent(master(platform_gain=0.0, master_gravity=parameters("jhu-dVRK/gc-MTML-22723.json")))
    rig.send("use_gravity_compensation", (0,))
    values = impedance(rig, -50.0) if command == "servo_ci" else (0.02,) * (7 if command == "servo_jf" else 6)
    rig.send(command, values)
    rig.run(0.08)
    if command != "servo_ci":
        assert joint_effort(rig).any()
    rig.run(0.03)
    assert rig.state["control_mode"] == EFFORT and rig.state["control_space"] == 2
    assert not joint_effort(rig).any() and borne(rig).any(), "its weight is borne, whatever was said before"
    rig.run(3.0)
    assert told(rig) == ["MTML: no effort command for 0.1 s; let go"]


def test_a_locked_orientation_stays_locked(rig: MasterRig) -> None:
    rig.send("body/servo_cf", (0, 0, 1, 0, 0, 0))
    rig.send("lock_orientation")
    rig.run(0.5)
    assert len(told(rig)) == 1
    assert rig.setpoint["in_effort"][:7].tolist() == [True, False, False, False, False, False, False] or (
        not rig.setpoint["in_effort"][4:7].any())
    assert not [e for e in rig.reports.of("orientation_locked") if not e[2]]


@pytest.fixture
def rig() -> MasterRig:
    return bent(master(platform_gain=0.0))
