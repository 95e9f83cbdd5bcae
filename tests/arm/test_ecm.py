"""An ECM on a fake io: brakes, its clutch, endoscopes, gravity, the tip."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from procs.arm.ecm import EcmLogic
from procs.document.arms import ArmConfig, ArmInputs, Chain, DhLink
from tests.arm.fake_io import Rig, link

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


def rig_of(arm: ArmConfig) -> Rig:
    return Rig(arm, kind=EcmLogic, inputs={"ECM-ManipClutch": 1}, has_brakes=True)


@pytest.fixture
def rig() -> Rig:
    """Homed, then bent and inserted."""
    made = rig_of(ecm()).homed()
    with made.hurried():
        move(made, BENT)
    made.reports.events.clear()
    return made


def move(rig: Rig, goal: Any) -> None:
    request = rig.send("move_jp", goal)
    rig.until(lambda: request.outcomes[-1] in ("done", "failed"))
    rig.run(0.05)
    assert request.outcomes[-1] == "done"


def test_brakes_are_let_go_once_the_joint_controller_holds_and_engage_with_power_off() -> None:
    rig = rig_of(ecm()).homed()
    orders = [name for name, values in rig.io.sent if name == "brake_release" or (name == "pid_enable" and values[0])]
    assert orders == ["pid_enable", "brake_release"] and rig.io.flag("brakes_released")
    rig.state_command("unhome")
    rig.run(0.3)
    assert rig.arm.state == "ENABLED" and not rig.io.flag("brakes_released") and not rig.io.flag("pid_enabled")


def test_a_brake_that_does_not_let_go_is_a_fault_with_the_reason() -> None:
    rig = rig_of(ecm())
    rig.io.refuses["brake_release"] = "the amplifier of brake 2 is off"
    rig.run(0.1)
    rig.state_command("enable")
    rig.until(lambda: rig.arm.state == "ENABLED")
    rig.state_command("home")
    rig.until(lambda: rig.arm.state == "FAULT")
    assert "the amplifier of brake 2 is off" in rig.reports.of("error")[-1][2]


def test_holding_efforts_are_those_of_the_reference(rig: Rig) -> None:
    assert rig.state["gravity_effort"][:4] == pytest.approx((-0.9278, 1.41582, -13.77753, 0.0), abs=1e-4)
    assert rig.setpoint["feed_forward"][:4] == pytest.approx(rig.state["gravity_effort"][:4])
    assert rig.send("use_gravity_compensation", (0.0,)).outcomes == ["done"]
    assert not rig.setpoint["feed_forward"].any()


def test_mounting_pitch_turns_gravity() -> None:
    rig = rig_of(ecm(mounting_pitch=math.radians(-45.0))).homed()
    move(rig, BENT)
    assert rig.state["gravity_effort"][:4] == pytest.approx((-0.65605, -2.30105, -12.81713, 0.0), abs=1e-4)


def test_without_a_model_compensation_is_refused_with_a_warning() -> None:
    rig = rig_of(ecm(links=None)).homed()
    assert rig.send("use_gravity_compensation", (1.0,)).outcomes == ["refused"]
    assert "no gravity model" in rig.reports.of("warning")[-1][2]


def test_the_tip_is_where_the_reference_has_it(rig: Rig) -> None:
    expected = np.array((0.028603, 0.044535, -0.141099, -0.967184, 0.180835, -0.067206, 0.165341))
    assert rig.state["measured_cp"] == pytest.approx(expected, abs=2e-5)


def test_a_hand_moves_it_while_its_clutch_is_pressed_and_it_holds_there(rig: Rig) -> None:
    rig.press("ECM-ManipClutch")
    rig.run(0.05)
    assert rig.arm.state == "MANUAL" and rig.state["is_busy"] and rig.state["is_homed"]
    assert ("arm_clutch", "pressed", 1.0) in rig.reports.events
    assert rig.setpoint["in_effort"][:4].all() and not rig.setpoint["effort"].any()
    assert rig.setpoint["feed_forward"][2] == pytest.approx(-13.77753, abs=1e-3)
    assert rig.send("move_jp", BENT).outcomes == ["refused"]
    rig.io.position[...] += (0.05, 0.02, -0.01, 0.1)
    rig.run(0.05)
    there = rig.io.position.copy()
    rig.press("ECM-ManipClutch", False)
    rig.run(0.1)
    assert rig.arm.state == "HOMED" and ("arm_clutch", "released", 0.0) in rig.reports.events
    assert not rig.setpoint["in_effort"].any() and rig.io.position == pytest.approx(there)


def test_its_clutch_is_ignored_with_a_warning_unless_homed() -> None:
    rig = rig_of(ecm())
    rig.reach("ENABLED")
    rig.press("ECM-ManipClutch")
    rig.run(0.05)
    assert rig.arm.state == "ENABLED" and "clutch ignored" in rig.reports.of("warning")[-1][2]


def test_cartesian_control_needs_an_inserted_endoscope() -> None:
    rig = rig_of(ecm()).homed()
    move(rig, (0.0, 0.0, 0.04, 0.0))
    rig.reports.events.clear()
    pose = rig.state["measured_cp"].copy()
    request = rig.send("move_cp", pose)
    assert request.outcomes == ["refused"] and "past the cannula" in request.replies[0][1]
    assert [event[4] for event in rig.reports.of("operating_state")] == [True, False]
    assert rig.reports.of("goal_reached") == [("goal_reached", False)]
    move(rig, (0.0, 0.0, 0.06, 0.0))
    assert rig.send("servo_cp", rig.state["measured_cp"].copy()).outcomes == ["done"]


def test_the_tip_follows_a_pose_but_not_out_of_the_cannula(rig: Rig) -> None:
    pose = rig.state["measured_cp"].copy()
    pose[:3] += (0.004, -0.002, 0.0)
    assert rig.send("servo_cp", pose).outcomes == ["done"]
    rig.run(0.05)
    assert rig.state["measured_cp"][:3] == pytest.approx(pose[:3], abs=1e-6) and rig.state["control_space"] == 2
    for depth in np.arange(np.linalg.norm(pose[:3]), 0.02, -0.005):
        pose[:3] *= depth / np.linalg.norm(pose[:3])
        rig.send("servo_cp", pose)
        rig.run(0.05)
    assert rig.state["position"][2] == pytest.approx(0.04, abs=1e-9)


def test_another_endoscope_changes_tip_and_weight_and_moves_nothing(rig: Rig) -> None:
    before = rig.io.setpoint.copy()
    assert rig.send("set_endoscope_type", (), "Classic_HD_UP").outcomes == ["done"]
    assert rig.state["cartesian_valid"] and rig.state["reference_valid"], "not for a single cycle is the tip unknown"
    assert rig.state["gravity_effort"][2] == pytest.approx(-13.77753 * 2.5 / 1.5, abs=1e-4)
    rig.run(0.05)
    assert ("endoscope_type", "Classic_HD_UP", 0.0) in rig.reports.events
    assert rig.state.text("tool") == "Classic_HD_UP" and rig.io.setpoint == pytest.approx(before, abs=1e-12)
    assert rig.state["gravity_effort"][2] == pytest.approx(-13.77753 * 2.5 / 1.5, abs=1e-4)
    rig.start_arm()
    rig.run(0.05)
    assert rig.state.text("tool") == "Classic_HD_UP" and rig.arm.state == "HOMED"


def test_an_unknown_endoscope_is_told_and_changes_nothing(rig: Rig) -> None:
    request = rig.send("set_endoscope_type", (), "Classic_4K")
    assert request.outcomes == ["refused"] and "Classic_SD_UP" in request.replies[0][1]
    assert ("endoscope_type", "ERROR", 0.0) in rig.reports.events
    assert rig.state.text("tool") == "Classic_SD_STRAIGHT"
