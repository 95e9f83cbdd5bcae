"""Cartesian values an arm publishes, against the numbers of the specification."""

from __future__ import annotations

import numpy as np
import pytest

from tests.arm.fake_io import ArmHarness

BENT = (0.2, -0.3, 0.15, 0.4, -0.5, 0.6)
TIP = (0.028454, 0.045917, -0.131813, 0.773064, 0.391849, 0.498211, 0.024760)
QUARTER = (0.1, 0.2, 0.3, 0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5))


@pytest.fixture
def harness() -> ArmHarness:
    made = ArmHarness().homed()
    made.go(BENT)
    return made


def turned(pose) -> np.ndarray:
    """A position after the base frame QUARTER."""
    return np.array((0.1 - pose[1], 0.2 + pose[0], 0.3 + pose[2]))


def test_tip_and_jacobian_are_those_of_the_specification(harness: ArmHarness) -> None:
    for name in ("measured_cp", "setpoint_cp", "local_measured_cp", "local_setpoint_cp"):
        assert harness.state[name] == pytest.approx(TIP, abs=1e-5), name
    assert harness.state["jacobian"][0][:6] == pytest.approx((0.047265, -0.117018, -0.479429, 0, -0.0091, 0), abs=1e-5)
    assert harness.state["jacobian"][5][:6] == pytest.approx((-0.352165, -0.674157, 0, 0.724301, -0.564639, 0),
                                                             abs=1e-5)
    assert not harness.state["jacobian"][:, 6:].any()


def test_a_base_frame_turns_measured_cp_and_leaves_local(harness: ArmHarness) -> None:
    harness.send("set_base_frame", QUARTER, "world")
    for _ in range(2):  # in the very cycle of the command and in later ones
        assert harness.state.text("reference_frame") == "world" and harness.state["reference_valid"]
        assert harness.state["measured_cp"][:3] == pytest.approx(turned(TIP), abs=1e-5)
        harness.step()
    assert harness.state["measured_cp"][:3] == pytest.approx(turned(TIP), abs=1e-5)
    assert harness.state["setpoint_cp"][:3] == pytest.approx(turned(TIP), abs=1e-5)
    assert harness.state["local_measured_cp"] == pytest.approx(TIP, abs=1e-5)


@pytest.mark.parametrize("base", ((), QUARTER))
def test_twist_is_in_the_reference_frame(harness: ArmHarness, base) -> None:
    if base:
        harness.send("set_base_frame", base, "world")
    harness.io.record["velocity"][2:5] = (0.0, 0.0,
                                          0.1)  # insertion only: along the shaft, which the wrist does not turn
    harness.step()
    before = np.array(harness.state["measured_cp"][:3])
    harness.send("servo_jp", np.add(BENT, (0, 0, 0.001, 0, 0, 0)))
    harness.run(0.02)
    moved = np.array(harness.state["measured_cp"][:3]) - before
    assert harness.state["measured_cv"][:3] == pytest.approx(moved * 100, abs=1e-4)


def test_an_unknown_base_leaves_only_local_poses_valid(harness: ArmHarness) -> None:
    assert harness.send("set_base_frame").outcomes == ["done"]
    harness.step()
    assert harness.state["cartesian_valid"] and not harness.state["reference_valid"]


@pytest.mark.parametrize("pose", ((0.0,) * 7, (0.0,) * 6, (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 2.0)))
def test_a_base_frame_that_is_no_pose_is_refused(harness: ArmHarness, pose) -> None:
    request = harness.send("set_base_frame", pose)
    assert request.outcomes == ["refused"]
    harness.step()
    assert harness.state["measured_cp"] == pytest.approx(TIP, abs=1e-5)


def test_joints_that_were_not_known_for_a_cycle_are_shown_again_though_none_has_moved(harness: ArmHarness) -> None:
    harness.run(0.1)
    names = ("position", "setpoint_position", "jaw_position", "gravity_effort")
    before = {name: harness.state[name].tolist() for name in names}
    control, io = harness.arm.control, harness.arm.io
    io.valid = False
    control.record.show_motion(control.gravity.effort)
    assert not harness.state["valid"] and not harness.state["has_jaw"] and not harness.state["position"].any()
    io.valid, io.changed = True, False
    control.record.show_motion(control.gravity.effort)
    assert harness.state["valid"] and harness.state["has_jaw"]
    assert {name: harness.state[name].tolist() for name in names} == before
