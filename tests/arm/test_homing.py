"""From nothing to homed, on a fake io: order, flags, events, timeouts."""

from __future__ import annotations

import numpy as np
import pytest

from tests.arm.arm_configs import bare_arm, fixed_arm
from tests.arm.fake_io import ArmHarness
from trocar.procs.arm.readings import contiguous_view
from trocar.procs.tables.code_row import Code
from trocar.procs.tables.codes import AMPLIFIER, POWER_TIMEOUT


def sub_states(harness: ArmHarness) -> list[str]:
    seen = [e[2] for e in harness.reports.of("operating_state")]
    return [s for i, s in enumerate(seen) if i == 0 or s != seen[i - 1]]


@pytest.mark.parametrize("arm", (bare_arm(), fixed_arm()), ids=("bare", "with instrument"))
def test_arm_powers_biases_and_homes_in_order(arm) -> None:
    harness = ArmHarness(arm)
    harness.reach("DISABLED")
    power = harness.state_command("enable")
    harness.until(lambda: "done" in power.outcomes)
    assert (harness.arm.state, harness.state.text("state")) == ("ENABLED", "ENABLED")
    home = harness.state_command("home")
    harness.until(lambda: "done" in home.outcomes)
    harness.run(0.3)
    assert sub_states(harness) == [
        "DISABLED", "POWERING", "ENABLED", "CALIBRATING_ENCODERS_FROM_POTS", "ENCODERS_BIASED", "HOMING", "HOMED",
    ]
    assert harness.state["is_homed"] and not harness.state["is_busy"]
    for flag in ("pid_enabled", "limits_enforced", "tracking_check", "pot_check", "use_setpoint_velocity"):
        assert harness.io.flag(flag), flag
    assert not harness.reports.of("error", "warning")


def test_no_command_is_sent_twice_on_the_way() -> None:
    harness = ArmHarness().homed()
    harness.run(1.0)
    assert len(harness.io.sent) == len(set(harness.io.sent))
    assert ("bias_encoders", (1970.0,)) in harness.io.sent


@pytest.mark.parametrize("re_home", (True, False))
def test_calibration_mode_biases_anew_and_leaves_potentiometers_alone(re_home: bool) -> None:
    harness = ArmHarness(bare_arm(calibration_mode=True, re_home=re_home))
    harness.io.record.field("biased")[1] = True
    harness.homed()
    assert ("bias_encoders", (1970.0,)) in harness.io.sent and ("pot_check", (1.0,)) not in harness.io.sent
    assert not harness.io.flag("pot_check") and harness.state["is_homed"]


def test_bare_arm_homes_with_seven_joints_and_without_tip() -> None:
    harness = ArmHarness(bare_arm()).homed()
    assert harness.state["count"] == 7
    names = [n.decode() for n in harness.state["names"][:7]]
    assert names == ["yaw", "pitch", "insertion", "disc_1", "disc_2", "disc_3", "disc_4"]
    assert harness.state["valid"] and not harness.state["cartesian_valid"] and not harness.state["has_jaw"]
    assert np.allclose(harness.state["position"][:7], harness.io.position)


def test_arm_with_instrument_has_six_joints_a_jaw_and_a_tip() -> None:
    harness = ArmHarness().homed()
    assert harness.state["count"] == 6 and harness.state["has_jaw"] and harness.state["cartesian_valid"]
    assert harness.state.text("tool") == "LARGE_NEEDLE_DRIVER_400006"
    roll, pitch, yaw, jaw = np.array(harness.document.tool.actuator_to_joint) @ harness.io.position[3:]
    assert np.allclose(harness.state["position"][:6], (*harness.io.position[:3], roll, pitch, yaw))
    assert harness.state["jaw_position"] == pytest.approx(jaw)


def test_homing_stays_where_it_is() -> None:
    harness = ArmHarness(bare_arm())
    before = harness.io.position.copy()
    harness.homed()
    assert np.array_equal(harness.io.position, before)


def test_homing_goes_to_zero_when_the_file_asks() -> None:
    harness = ArmHarness(bare_arm(homing_zero_position=True)).homed()
    assert np.allclose(harness.io.position, 0.0)


def test_homing_moves_smoothly_into_the_limits() -> None:
    harness = ArmHarness(bare_arm())
    harness.io.position[2] = -0.01
    harness.homed()
    assert harness.io.position[2] == pytest.approx(0.0)
    assert harness.io.largest_step < 0.001


def test_homing_to_zero_with_an_instrument_stays() -> None:
    harness = ArmHarness(fixed_arm(homing_zero_position=True))
    before = harness.io.position.copy()
    harness.homed()
    assert np.allclose(harness.io.position, before)


def test_preset_encoders_will_do_without_re_home() -> None:
    harness = ArmHarness(bare_arm(re_home=False)).homed()
    assert ("bias_encoders", (-1970.0,)) in harness.io.sent


def test_power_that_never_comes_is_a_fault_and_is_not_requested_again() -> None:
    harness = ArmHarness()
    harness.io.never_powers = True
    harness.run(0.1)
    request = harness.state_command("enable")
    seconds = harness.until(lambda: harness.arm.state == "FAULT")
    assert seconds == pytest.approx(3.1, abs=0.02)
    assert harness.reports.of("error")[0][1] == "power-timeout"
    harness.step()
    assert request.outcomes == ["accepted", "failed"] and "failed to enable power" in request.replies[-1][1]
    harness.io.never_powers = False
    harness.run(5.0)
    assert harness.io.sent.count(("power_on", ())) == 1
    assert harness.arm.state == "FAULT" and not harness.io.flag("power_requested")


@pytest.mark.parametrize("fault", (POWER_TIMEOUT, AMPLIFIER))
def test_power_that_io_gives_up_is_a_fault_of_the_arm_with_the_same_cause(fault: Code) -> None:
    harness = ArmHarness()
    harness.io.never_powers = True
    harness.run(0.1)
    harness.state_command("enable")
    harness.run(3.0)
    harness.io.flag("fault", fault.number)
    harness.io.flag("power_requested", False)
    harness.io.never_powers = False
    harness.run(1.0)
    assert harness.arm.state == "FAULT" and harness.io.sent.count(("power_on", ())) == 1
    assert f"fault number {fault.number}" in harness.reports.of("error")[0][2]


@pytest.mark.slow
def test_bias_that_never_ends_is_a_fault_after_30_seconds() -> None:
    harness = ArmHarness()
    harness.reach("ENABLED")
    harness.io.never_biases = True
    harness.state_command("home")
    seconds = harness.until(lambda: harness.arm.state == "FAULT")
    assert seconds == pytest.approx(30.0, abs=0.05)
    assert "timeout" in harness.reports.of("error")[0][2]


@pytest.mark.slow
def test_refused_bias_is_told_and_asked_at_most_once_a_second() -> None:
    harness = ArmHarness()
    harness.reach("ENABLED")
    harness.io.refuses["bias_encoders"] = "there are no potentiometers"
    request = harness.state_command("home")
    harness.until(lambda: harness.arm.state == "FAULT")
    harness.step()
    assert harness.io.sent.count(("bias_encoders", (1970.0,))) <= 31
    assert "there are no potentiometers" in request.replies[-1][1]
    assert len(harness.reports.of("warning")) == 1


def test_home_that_is_not_reached_is_a_fault_two_seconds_later() -> None:
    harness = ArmHarness(bare_arm(homing_zero_position=True))
    harness.io.stuck = True
    harness.io.position[0] = 0.5
    harness.reach("HOMING")
    moving = harness.until(lambda: harness.io.flag("pid_enabled"))
    seconds = harness.until(lambda: harness.arm.state == "FAULT")
    planned = 2 * (0.5 / np.radians(90)) ** 0.5
    assert moving < 0.1 and seconds == pytest.approx(planned + 2.0, abs=0.05)
    assert "unable to reach home position" in harness.reports.of("error")[0][2]


@pytest.mark.parametrize("name", ("power_on", "pid_enable", "bias_encoders", "enforce_limits", "tracking_check"))
def test_a_lost_command_is_asked_again(name: str) -> None:
    harness = ArmHarness()
    harness.run(0.1)
    harness.io.loses[name] = 1
    harness.homed()
    assert harness.arm.state == "HOMED"


def test_a_joint_controller_that_stays_off_is_a_fault() -> None:
    harness = ArmHarness()
    harness.io.refuses["pid_enable"] = "the robot has no power"
    harness.reach("HOMING")
    harness.until(lambda: harness.arm.state == "FAULT", 2.0)
    assert "the robot has no power" in harness.reports.of("error")[0][2]


def test_joint_values_are_zero_and_invalid_before_the_bias() -> None:
    harness = ArmHarness()
    harness.reach("ENABLED")
    assert not harness.state["valid"] and not harness.state["position"].any()


def test_fields_that_do_not_lie_evenly_are_refused() -> None:
    buffer = np.zeros(40)
    assert contiguous_view([buffer[0:7], buffer[9:16], buffer[18:25]]).shape == (3, 7)
    with pytest.raises(ValueError, match="side by side"):
        contiguous_view([buffer[0:7], buffer[9:16], buffer[20:27]])


def test_one_refusal_of_the_joint_controller_is_asked_again() -> None:
    harness = ArmHarness()
    harness.reach("ENABLED")
    harness.io.refuses["pid_enable"] = "there is no good sample of its controllers"
    home = harness.state_command("home")
    harness.until(lambda: ("pid_enable", (1.0,)) in harness.io.sent)
    harness.run(0.01)
    del harness.io.refuses["pid_enable"]
    harness.until(lambda: "done" in home.outcomes)
    assert harness.arm.state == "HOMED"
