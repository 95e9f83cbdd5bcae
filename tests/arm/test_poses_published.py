"""Cartesian values an arm publishes, against the numbers of the specification."""

from __future__ import annotations

import numpy as np
import pytest

from tests.arm.fake_io import Rig

BENT = (0.2, -0.3, 0.15, 0.4, -0.5, 0.6)
TIP = (0.028454, 0.045917, -0.131813, 0.773064, 0.391849, 0.498211, 0.024760)
QUARTER = (0.1, 0.2, 0.3, 0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5))


@pytest.fixture
def rig() -> Rig:
    made = Rig().homed()
    made.go(BENT)
    return made


def turned(pose) -> np.ndarray:
    """A position after the base frame QUARTER."""
    return np.array((0.1 - pose[1], 0.2 + pose[0], 0.3 + pose[2]))


def test_tip_and_jacobian_are_those_of_the_specification(rig: Rig) -> None:
    for name in ("measured_cp", "setpoint_cp", "local_measured_cp", "local_setpoint_cp"):
        assert rig.state[name] == pytest.approx(TIP, abs=1e-5), name
    assert rig.state["jacobian"][0][:6] == pytest.approx((0.047265, -0.117018, -0.479429, 0, -0.0091, 0), abs=1e-5)
    assert rig.state["jacobian"][5][:6] == pytest.approx((-0.352165, -0.674157, 0, 0.724301, -0.564639, 0), abs=1e-5)
    assert not rig.state["jacobian"][:, 6:].any()


def test_a_base_frame_turns_measured_cp_and_leaves_local(rig: Rig) -> None:
    rig.send("set_base_frame", QUARTER, "world")
    for _ in range(2):  # in the very cycle of the command and in later ones
        assert rig.state.text("reference_frame") == "world" and rig.state["reference_valid"]
        assert rig.state["measured_cp"][:3] == pytest.approx(turned(TIP), abs=1e-5)
        rig.step()
    assert rig.state["measured_cp"][:3] == pytest.approx(turned(TIP), abs=1e-5)
    assert rig.state["setpoint_cp"][:3] == pytest.approx(turned(TIP), abs=1e-5)
    assert rig.state["local_measured_cp"] == pytest.approx(TIP, abs=1e-5)


@pytest.mark.parametrize("base", ((), QUARTER))
def test_twist_is_in_the_reference_frame(rig: Rig, base) -> None:
    if base:
        rig.send("set_base_frame", base, "world")
    rig.io.record["velocity"][2:5] = (0.0, 0.0, 0.1)  # insertion only: along the shaft, which the wrist does not turn
    rig.step()
    before = np.array(rig.state["measured_cp"][:3])
    rig.send("servo_jp", np.add(BENT, (0, 0, 0.001, 0, 0, 0)))
    rig.step()
    moved = np.array(rig.state["measured_cp"][:3]) - before
    assert rig.state["measured_cv"][:3] == pytest.approx(moved * 100, abs=1e-4)


def test_an_unknown_base_leaves_only_local_poses_valid(rig: Rig) -> None:
    assert rig.send("set_base_frame").outcomes == ["done"]
    rig.step()
    assert rig.state["cartesian_valid"] and not rig.state["reference_valid"]


@pytest.mark.parametrize("pose", ((0.0,) * 7, (0.0,) * 6, (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 2.0)))
def test_a_base_frame_that_is_no_pose_is_refused(rig: Rig, pose) -> None:
    request = rig.send("set_base_frame", pose)
    assert request.outcomes == ["refused"]
    rig.step()
    assert rig.state["measured_cp"] == pytest.approx(TIP, abs=1e-5)
