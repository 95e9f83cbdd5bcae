"""A sterile adapter and an instrument are put on a PSM, engaged, and taken off again."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.arm.arm_configs import TOOL, fixed_arm
from tests.arm.fake_io import ArmHarness
from tests.arm.fake_psm import DRIVER, SwitchedPsm, with_adapter


def test_a_bare_arm_is_homed_in_seven_joints() -> None:
    psm = SwitchedPsm().homed()
    assert psm.state["count"] == 7 and psm.homed_flag
    assert not psm.state["cartesian_valid"] and not psm.state["has_jaw"]
    assert psm.state["adapter"] == psm.state["instrument"] == 1


def test_adapter_put_on_is_engaged_by_four_swings() -> None:
    psm = SwitchedPsm().homed()
    yaw, pitch = psm.io.setpoint[:2].copy()
    psm.put_on("adapter")
    assert psm.arm.state == "ENGAGING_ADAPTER" and psm.state["is_busy"] and not psm.homed_flag
    assert not psm.io.flag("limits_enforced") and psm.io.flag("tracking_check")
    extremes = []
    while psm.arm.state == "ENGAGING_ADAPTER":
        psm.step()
        extremes.append(psm.io.setpoint[2:].copy())
    discs = np.array(extremes)[:, 1:]
    assert np.degrees(discs.min(axis=0)) == pytest.approx([-171] * 4, abs=1e-6)
    assert np.degrees(discs.max(axis=0)) == pytest.approx([171] * 4, abs=1e-6)
    assert np.allclose(psm.io.setpoint, (yaw, pitch, 0, 0, 0, 0, 0), atol=1e-6)
    assert psm.reported == [f"engaging adapter {k} of 4" for k in (1, 2, 3, 4)]
    psm.run(0.1)
    assert psm.arm.state == "HOMED" and psm.homed_flag and not psm.state["is_busy"]
    assert psm.io.flag("limits_enforced") and psm.nothing_jumped()
    assert not psm.reports.of("goal_reached", "error", "warning")
    busy = [e[4] for e in psm.reports.of("operating_state")]
    assert busy == [True, False]


def test_a_full_adapter_swing_takes_as_long_as_in_the_reference() -> None:
    psm = SwitchedPsm().homed()
    psm.put_on("adapter")
    psm.until(lambda: len(psm.reported) == 1)
    assert psm.until(lambda: len(psm.reported) == 2) == pytest.approx(1.378, abs=0.01)


def test_hold_stops_the_swings() -> None:
    psm = SwitchedPsm().homed()
    psm.put_on("adapter")
    psm.run(1.0)
    assert psm.arm.state == "ENGAGING_ADAPTER" and psm.send("hold").outcomes == ["accepted", "done"]
    psm.run(0.02)
    here = psm.io.setpoint.copy()
    psm.run(1.0)
    assert psm.arm.state == "PAUSED" and np.array_equal(psm.io.setpoint, here)


def test_adapter_taken_off_while_engaging_leaves_the_arm_homed() -> None:
    psm = SwitchedPsm().homed()
    psm.put_on("adapter")
    psm.run(1.0)
    assert psm.send("move_jp", (0.0,) * 7).outcomes == ["refused"]
    psm.take_off("adapter")
    here = psm.io.setpoint.copy()
    psm.run(0.2)
    assert psm.arm.state == "HOMED" and psm.homed_flag and psm.state["adapter"] == 1
    assert np.allclose(psm.io.setpoint, here, atol=0.05)


def test_an_instrument_put_on_ends_the_turning_of_the_adapter() -> None:
    psm = SwitchedPsm().homed()
    psm.put_on("adapter")
    psm.run(1.0)
    psm.put_on("tool")
    psm.run(0.1)
    assert psm.arm.state == "HOMED" and psm.state["adapter"] == 4


def test_adapter_and_instrument_found_at_start_are_not_turned() -> None:
    psm = SwitchedPsm(tool_detection="FIXED", tool=TOOL)
    psm.put_on("adapter", "tool")
    psm.reach("HOMED")
    psm.run(0.6)
    assert psm.state["count"] == 6 and psm.state["has_jaw"] and psm.homed_flag and not psm.reported
    assert psm.state["adapter"] == psm.state["instrument"] == 4


def test_nobody_sees_an_arm_homed_without_the_joints_of_what_it_carries() -> None:
    psm = SwitchedPsm(tool_detection="FIXED", tool=TOOL)
    psm.put_on("adapter", "tool")
    psm.run(0.6)
    psm.state_command("enable")
    psm.until(lambda: psm.arm.state == "ENABLED")
    psm.state_command("home")
    psm.until(lambda: psm.homed_flag)
    assert psm.state["count"] == 6 and psm.state["cartesian_valid"]
    states = [e[2:] for e in psm.reports.of("operating_state")]
    assert ("HOMED", False, False) not in states, "homed is reported once, and at once altogether"


def test_instrument_is_engaged_from_its_lower_to_its_upper_ends() -> None:
    psm = with_adapter().retracted()
    psm.put_on("tool")
    psm.reports.events.clear()
    before = psm.io.setpoint[:3].copy()
    psm.send("set_tool_type", (), DRIVER)
    to_joint = np.array(TOOL.actuator_to_joint)
    seen = []
    while psm.arm.state == "ENGAGING_TOOL":
        psm.step()
        if psm.reported:  # not on the way to where it begins
            seen.append(to_joint @ psm.io.setpoint[3:])
    assert np.array(seen).min(axis=0) == pytest.approx(TOOL.engage_lower, abs=1e-6)
    assert np.array(seen).max(axis=0) == pytest.approx(TOOL.engage_upper, abs=1e-6)
    assert np.allclose(psm.io.setpoint, (*before, 0, 0, 0, 0), atol=1e-5)
    assert psm.reported == [f"engaging tool {k} of 3" for k in (1, 2, 3)]
    psm.run(0.1)
    assert psm.state["count"] == 6 and psm.state["cartesian_valid"] and psm.homed_flag
    assert psm.state["jaw_position"] == pytest.approx(0.0, abs=1e-6)
    assert psm.nothing_jumped() and not psm.reports.of("goal_reached", "error")
    assert [e[4] for e in psm.reports.of("operating_state")] == [True, False]


def test_instrument_put_on_beyond_the_cannula_is_not_turned_there() -> None:
    psm = with_adapter()
    before = psm.io.setpoint.copy()
    assert before[2] > 0.04
    psm.put_on("tool")
    psm.send("set_tool_type", (), DRIVER)
    psm.run(0.1)
    assert psm.arm.state == "HOMED" and psm.homed_flag and psm.state["count"] == 6
    assert any("cannula_depth" in e[1] for e in psm.reports.of("status"))
    assert np.allclose(psm.io.setpoint, before, atol=1e-12) and not psm.reported


@pytest.mark.parametrize(("depth", "insertion", "turned"),
                         ((0.0, 0.0305, True), (0.0, 0.0325, False), (0.05, 0.05, True), (0.01, 0.0305, False)))
def test_the_depth_of_the_cannula_decides(depth: float, insertion: float, turned: bool) -> None:
    psm = with_adapter(cannula_depth=depth)
    move = psm.send("move_jp", (0.0, 0.0, insertion, 0.0, 0.0, 0.0, 0.0))
    psm.until(lambda: "done" in move.outcomes)
    psm.put_on("tool")
    psm.send("set_tool_type", (), DRIVER)
    assert (psm.arm.state == "ENGAGING_TOOL") is turned


@pytest.mark.parametrize(("generation", "depth", "is_named"),
                         (("S", 0.0, True), ("S", 0.03, False), ("Classic", 0.0, False), ("", 0.0, False)))
def test_an_instrument_of_another_generation_names_the_key_for_the_cannula_before_it_engages(
        generation: str, depth: float, is_named: bool) -> None:
    psm = with_adapter(tools=(replace(TOOL, generation=generation),), cannula_depth=depth).retracted()
    psm.put_on("tool")
    psm.send("set_tool_type", (), DRIVER)
    named = [e[1] for e in psm.reports.of("status") if "cannula_depth" in e[1]]
    assert psm.arm.state == "ENGAGING_TOOL" and bool(named) is is_named


@pytest.mark.parametrize("when", ("asked", "engaging", "engaged", "moving", "effort"))
def test_instrument_taken_off_leaves_bare_discs_where_they_are(when: str) -> None:
    psm = with_adapter()
    if when == "engaging":
        psm.retracted()
    psm.put_on("tool")
    move = None
    if when != "asked":
        psm.send("set_tool_type", (), DRIVER)
        psm.run(0.5)
    if when == "moving":
        move = psm.send("move_jp", (0.5, 0.3, 0.2, 0.5, 0.5, 0.5))
        psm.run(0.3)
    if when == "effort":
        psm.send("free")
        psm.run(0.1)
    psm.reports.events.clear()
    before = psm.io.setpoint.copy()
    psm.take_off("tool")
    psm.run(0.2)
    assert psm.arm.state == "HOMED" and psm.homed_flag and psm.state["count"] == 7
    assert not psm.state["cartesian_valid"] and not psm.state["has_jaw"] and psm.state.text("tool") == ""
    assert psm.types == [("tool_type", "")] and psm.nothing_jumped()
    assert np.allclose(psm.io.setpoint, before, atol=0.03 if when == "engaging" else 0.002)
    assert move is None or move.outcomes == ["accepted", "failed"]
    assert psm.setpoint["mode"] == 1 and not psm.setpoint["in_effort"].any()


def test_emulated_parts_act_as_their_switches() -> None:
    psm = SwitchedPsm().homed()
    psm.send("emulate_adapter_present", (1.0,))
    psm.run(0.02)
    assert psm.arm.state == "ENGAGING_ADAPTER"
    psm.send("emulate_tool_present", (1.0,))
    psm.run(0.1)
    assert psm.arm.state == "HOMED" and psm.types == [("tool_type_request", "")]
    psm.send("emulate_tool_present", (0.0,))
    psm.run(0.1)
    assert psm.types[-1] == ("tool_type", "") and psm.state["instrument"] == 1
    assert psm.send("emulate_tool_present", (2.0,)).outcomes == ["refused"]


def test_an_instrument_beyond_its_limits_does_not_jump_at_the_next_command() -> None:
    psm = with_adapter()
    jaw_open = np.linalg.inv(np.array(TOOL.actuator_to_joint)) @ (0.0, 0.0, 0.0, -0.9)
    move = psm.send("move_jp", (0.0, 0.0, 0.12, *jaw_open))
    psm.until(lambda: "done" in move.outcomes)
    psm.put_on("tool")
    psm.send("set_tool_type", (), DRIVER)
    psm.run(0.1)
    assert psm.state["jaw_position"] == pytest.approx(-0.9)
    psm.largest[...] = 0.0
    assert psm.send("servo_jp", psm.state["setpoint_position"][:6].copy()).replies == [("done", "")]
    psm.run(0.1)
    assert psm.largest.max() < 1e-9
    assert psm.send("jaw/servo_jp", (-1.5,)).replies == [("done", "clipped: jaw")]
    psm.run(0.1)
    assert psm.largest.max() < 1e-9
    jaw = psm.send("jaw/move_jp", (0.0,))
    psm.until(lambda: "done" in jaw.outcomes)


def test_fixed_instrument_without_a_switch_is_always_on() -> None:
    harness = ArmHarness(fixed_arm()).homed()
    assert harness.state["instrument"] == 4 and harness.state["adapter"] == 1 and harness.state["is_homed"]
    assert "FIXED" in harness.send("set_tool_type", (), DRIVER).replies[0][1]


def test_a_hand_moves_the_arm_and_not_the_instrument() -> None:
    psm = with_adapter()
    psm.put_on("tool")
    psm.send("set_tool_type", (), DRIVER)
    psm.run(0.1)
    psm.press("PSM1_arm_clutch")
    psm.run(0.1)
    assert psm.arm.state == "MANUAL" and psm.setpoint["in_effort"][:7].tolist() == [True] * 3 + [False] * 4
    psm.io.position[:3] += (0.1, 0.0, 0.02)
    psm.run(0.1)
    psm.press("PSM1_tool", False)
    psm.run(0.1)
    assert psm.arm.state == "MANUAL" and psm.setpoint["in_effort"][:3].all() and psm.state["count"] == 7
    here = psm.io.position.copy()
    psm.press("PSM1_arm_clutch", False)
    psm.run(0.1)
    assert psm.arm.state == "HOMED" and np.allclose(psm.io.setpoint, here, atol=1e-9)
    assert [e[1] for e in psm.reports.of("arm_clutch")] == ["pressed", "released"]


def test_a_move_ends_when_something_is_to_be_engaged() -> None:
    psm = SwitchedPsm().homed()
    move = psm.send("move_jp", (1.0, 0.5, 0.2, 0.0, 0.0, 0.0, 0.0))
    psm.run(0.3)
    psm.put_on("adapter")
    assert move.outcomes == ["accepted", "failed"] and "being engaged" in move.replies[-1][1]
    psm.until(lambda: psm.homed_flag)
    assert psm.io.setpoint[2:] == pytest.approx(0.0, abs=1e-6)


def test_an_instrument_without_an_adapter_is_told_and_not_turned() -> None:
    psm = SwitchedPsm(tool_detection="FIXED", tool=TOOL).homed()
    psm.put_on("tool")
    psm.run(1.0)
    assert psm.arm.state == "HOMED" and psm.state["count"] == 7 and not psm.homed_flag
    assert [e[1] for e in psm.reports.of("warning")] == ["adapter-missing"]
