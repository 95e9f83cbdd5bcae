"""An ECM on a fake io: brakes, its clutch, endoscopes, gravity, the tip."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from tests.arm.arm_configs import link
from tests.arm.fake_io import ArmHarness
from trocar.procs.arm.ecm import EcmLogic
from trocar.procs.document.arms import ArmConfig, ArmInputs, Chain, DhLink

CHAIN = Chain(
    "modified",
    (
        link("yaw", "revolute", 1.5708, 0.0, 0.0, 1.5708, -1.5708, 1.5708),
        link("pitch", "revolute", -1.5708, 0.0, 0.0, -1.5708, -0.76794, 1.1344),
        DhLink("insertion", "prismatic", 1.5708, 0.0, 0.0, 0.0, -0.3822, 0.0, 0.255, 80.66, com=(0.0, 0.0, -0.1)),
        link("roll", "revolute", 0.0, 0.0, 0.3829, 0.0, -1.552, 1.552),
    ),
    source="ECM.json",
)
BENT = (0.2, -0.3, 0.15, 0.4)


def ecm(**changes: Any) -> ArmConfig:
    values: dict[str, Any] = {"links": CHAIN, "endoscope": "Classic_SD_STRAIGHT", "mounting_pitch": 0.0,
                              "inputs": ArmInputs(clutch="ECM-ManipClutch"), **changes}
    return ArmConfig("ECM", "ECM", "Classic", "1234", "IO1", "ECM", "NONE", 1 / 1500, CHAIN, **values)


def rig_of(arm: ArmConfig) -> ArmHarness:
    return ArmHarness(arm, kind=EcmLogic, inputs={"ECM-ManipClutch": 1}, has_brakes=True)


@pytest.fixture
def harness() -> ArmHarness:
    """Homed, then bent and inserted."""
    made = rig_of(ecm()).homed()
    with made.hurried():
        move(made, BENT)
    made.reports.events.clear()
    return made


def move(harness: ArmHarness, goal: Any) -> None:
    request = harness.send("move_jp", goal)
    harness.until(lambda: request.outcomes[-1] in ("done", "failed"))
    harness.run(0.05)
    assert request.outcomes[-1] == "done"


def test_brakes_are_let_go_once_the_joint_controller_holds_and_engage_with_power_off() -> None:
    harness = rig_of(ecm()).homed()
    orders = [name for name,
              values in harness.io.sent if name == "brake_release" or (name == "pid_enable" and values[0])]
    assert orders == ["pid_enable", "brake_release"] and harness.io.flag("brakes_released")
    harness.state_command("unhome")
    harness.run(0.3)
    assert harness.arm.state == "ENABLED" and not harness.io.flag("brakes_released")
    assert not harness.io.flag("pid_enabled")


def test_a_brake_that_does_not_let_go_is_a_fault_with_the_reason() -> None:
    harness = rig_of(ecm())
    harness.io.refuses["brake_release"] = "the amplifier of brake 2 is off"
    harness.run(0.1)
    harness.state_command("enable")
    harness.until(lambda: harness.arm.state == "ENABLED")
    harness.state_command("home")
    harness.until(lambda: harness.arm.state == "FAULT")
    assert "the amplifier of brake 2 is off" in harness.reports.of("error")[-1][2]


def test_holding_efforts_are_those_of_the_reference(harness: ArmHarness) -> None:
    assert harness.state["gravity_effort"][:4] == pytest.approx((-0.9278, 1.41582, -13.77753, 0.0), abs=1e-4)
    assert harness.setpoint["feed_forward"][:4] == pytest.approx(harness.state["gravity_effort"][:4])
    assert harness.send("use_gravity_compensation", (0.0,)).outcomes == ["done"]
    harness.run(1.1)
    assert not harness.setpoint["feed_forward"].any()


def test_mounting_pitch_turns_gravity() -> None:
    harness = rig_of(ecm(mounting_pitch=math.radians(-45.0))).homed()
    move(harness, BENT)
    assert harness.state["gravity_effort"][:4] == pytest.approx((-0.65605, -2.30105, -12.81713, 0.0), abs=1e-4)


def test_without_a_model_compensation_is_refused_and_warned_of_once() -> None:
    harness = rig_of(ecm(links=None)).homed()
    for _ in range(2):
        assert harness.send("use_gravity_compensation", (1.0,)).outcomes == ["refused"]
    (warning,) = harness.reports.of("warning")
    assert "no gravity model" in warning[2]


def test_the_tip_is_where_the_reference_has_it(harness: ArmHarness) -> None:
    expected = np.array((0.028603, 0.044535, -0.141099, -0.967184, 0.180835, -0.067206, 0.165341))
    assert harness.state["measured_cp"] == pytest.approx(expected, abs=2e-5)


def test_a_hand_moves_it_while_its_clutch_is_pressed_and_it_holds_there(harness: ArmHarness) -> None:
    harness.press("ECM-ManipClutch")
    harness.run(0.05)
    assert harness.arm.state == "MANUAL" and harness.state["is_busy"] and harness.state["is_homed"]
    assert ("arm_clutch", "pressed", 1.0) in harness.reports.events
    assert harness.setpoint["in_effort"][:4].all() and not harness.setpoint["effort"].any()
    assert harness.setpoint["feed_forward"][2] == pytest.approx(-13.77753, abs=1e-3)
    assert harness.send("move_jp", BENT).outcomes == ["refused"]
    harness.io.position[...] += (0.05, 0.02, -0.01, 0.1)
    harness.run(0.05)
    there = harness.io.position.copy()
    harness.press("ECM-ManipClutch", False)
    harness.run(0.1)
    assert harness.arm.state == "HOMED" and ("arm_clutch", "released", 0.0) in harness.reports.events
    assert not harness.setpoint["in_effort"].any() and harness.io.position == pytest.approx(there)


def test_its_clutch_is_ignored_with_a_warning_unless_homed() -> None:
    harness = rig_of(ecm())
    harness.reach("ENABLED")
    harness.press("ECM-ManipClutch")
    harness.run(0.05)
    assert harness.arm.state == "ENABLED" and "clutch ignored" in harness.reports.of("warning")[-1][2]


def test_cartesian_control_needs_an_inserted_endoscope() -> None:
    harness = rig_of(ecm()).homed()
    move(harness, (0.0, 0.0, 0.04, 0.0))
    harness.reports.events.clear()
    pose = harness.state["measured_cp"].copy()
    request = harness.send("move_cp", pose)
    assert request.outcomes == ["refused"] and "past the cannula" in request.replies[0][1]
    assert [event[4] for event in harness.reports.of("operating_state")] == [True, False]
    assert harness.reports.of("goal_reached") == [("goal_reached", False)]
    move(harness, (0.0, 0.0, 0.06, 0.0))
    assert harness.send("servo_cp", harness.state["measured_cp"].copy()).outcomes == ["done"]


def test_the_tip_follows_a_pose_but_not_out_of_the_cannula(harness: ArmHarness) -> None:
    pose = harness.state["measured_cp"].copy()
    pose[:3] += (0.004, -0.002, 0.0)
    assert harness.send("servo_cp", pose).outcomes == ["done"]
    harness.run(0.05)
    assert harness.state["measured_cp"][:3] == pytest.approx(pose[:3], abs=1e-6) and harness.state["control_space"] == 2
    for depth in np.arange(np.linalg.norm(pose[:3]), 0.02, -0.005):
        pose[:3] *= depth / np.linalg.norm(pose[:3])
        harness.send("servo_cp", pose)
        harness.run(0.05)
    assert harness.state["position"][2] == pytest.approx(0.04, abs=1e-9)


def test_another_endoscope_changes_tip_and_weight_and_moves_nothing(harness: ArmHarness) -> None:
    before = harness.io.setpoint.copy()
    assert harness.send("set_endoscope_type", (), "Classic_HD_UP").outcomes == ["done"]
    assert harness.state["cartesian_valid"] and harness.state["reference_valid"], "the tip is never unknown"
    assert harness.state["gravity_effort"][2] == pytest.approx(-13.77753 * 2.5 / 1.5, abs=1e-4)
    harness.run(0.05)
    assert ("endoscope_type", "Classic_HD_UP", 0.0) in harness.reports.events
    assert harness.state.text("tool") == "Classic_HD_UP" and harness.io.setpoint == pytest.approx(before, abs=1e-12)
    assert harness.state["gravity_effort"][2] == pytest.approx(-13.77753 * 2.5 / 1.5, abs=1e-4)
    harness.start_arm()
    harness.run(0.05)
    assert harness.state.text("tool") == "Classic_HD_UP" and harness.arm.state == "HOMED"


def test_an_unknown_endoscope_is_told_and_changes_nothing(harness: ArmHarness) -> None:
    request = harness.send("set_endoscope_type", (), "Classic_4K")
    assert request.outcomes == ["refused"] and "Classic_SD_UP" in request.replies[0][1]
    assert ("endoscope_type", "ERROR", 0.0) in harness.reports.events
    assert harness.state.text("tool") == "Classic_SD_STRAIGHT"


def test_a_move_of_the_last_joint_is_no_faster_than_its_trajectory(harness: ArmHarness) -> None:
    harness.send("servo_jp", BENT)
    harness.run(0.1)
    request = harness.send("move_jp", (*BENT[:3], -BENT[3]))
    speeds = []
    while request.outcomes[-1] == "accepted":
        before = harness.state["setpoint_position"][3]
        harness.step()
        speeds.append(abs(harness.state["setpoint_position"][3] - before) * 1e9 / harness.period_ns)
    most = harness.arm.control.joints.v_max[3]
    assert request.outcomes[-1] == "done" and 0.5 * most < max(speeds) <= most * (1.0 + 1e-9)
