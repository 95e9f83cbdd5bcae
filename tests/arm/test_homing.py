"""From nothing to homed, on a fake io: order, flags, events, time-outs."""

from __future__ import annotations

import numpy as np
import pytest

from procs.arm.contiguous import stacked
from procs.codes import AMPLIFIER, POWER_TIMEOUT, Code
from tests.arm.fake_io import Rig, bare_arm, fixed_arm


def sub_states(rig: Rig) -> list[str]:
    seen = [e[2] for e in rig.reports.of("operating_state")]
    return [s for i, s in enumerate(seen) if i == 0 or s != seen[i - 1]]


@pytest.mark.parametrize("arm", (bare_arm(), fixed_arm()), ids=("bare", "with instrument"))
def test_arm_powers_biases_and_homes_in_order(arm) -> None:
    rig = Rig(arm)
    rig.reach("DISABLED")
    power = rig.state_command("enable")
    rig.until(lambda: "done" in power.outcomes)
    assert (rig.arm.state, rig.state.text("state")) == ("ENABLED", "ENABLED")
    home = rig.state_command("home")
    rig.until(lambda: "done" in home.outcomes)
    rig.run(0.3)
    assert sub_states(rig) == [
        "DISABLED", "POWERING", "ENABLED", "CALIBRATING_ENCODERS_FROM_POTS", "ENCODERS_BIASED", "HOMING", "HOMED",
    ]
    assert rig.state["is_homed"] and not rig.state["is_busy"]
    for flag in ("pid_enabled", "limits_enforced", "tracking_check", "pot_check", "velocity_used"):
        assert rig.io.flag(flag), flag
    assert not rig.reports.of("error", "warning")


def test_no_command_is_sent_twice_on_the_way() -> None:
    rig = Rig().homed()
    rig.run(1.0)
    assert len(rig.io.sent) == len(set(rig.io.sent))
    assert ("bias_encoders", (1970.0,)) in rig.io.sent


@pytest.mark.parametrize("re_home", (True, False))
def test_calibration_mode_biases_anew_and_leaves_potentiometers_alone(re_home: bool) -> None:
    rig = Rig(bare_arm(calibration_mode=True, re_home=re_home))
    rig.io.record.field("biased")[1] = True
    rig.homed()
    assert ("bias_encoders", (1970.0,)) in rig.io.sent and ("pot_check", (1.0,)) not in rig.io.sent
    assert not rig.io.flag("pot_check") and rig.state["is_homed"]


def test_bare_arm_homes_with_seven_joints_and_without_tip() -> None:
    rig = Rig(bare_arm()).homed()
    assert rig.state["count"] == 7
    names = [n.decode() for n in rig.state["names"][:7]]
    assert names == ["yaw", "pitch", "insertion", "disc_1", "disc_2", "disc_3", "disc_4"]
    assert rig.state["valid"] and not rig.state["cartesian_valid"] and not rig.state["has_jaw"]
    assert np.allclose(rig.state["position"][:7], rig.io.position)


def test_arm_with_instrument_has_six_joints_a_jaw_and_a_tip() -> None:
    rig = Rig().homed()
    assert rig.state["count"] == 6 and rig.state["has_jaw"] and rig.state["cartesian_valid"]
    assert rig.state.text("tool") == "LARGE_NEEDLE_DRIVER_400006"
    roll, pitch, yaw, jaw = np.array(rig.document.tool.actuator_to_joint) @ rig.io.position[3:]
    assert np.allclose(rig.state["position"][:6], (*rig.io.position[:3], roll, pitch, yaw))
    assert rig.state["jaw_position"] == pytest.approx(jaw)


def test_homing_stays_where_it_is() -> None:
    rig = Rig(bare_arm())
    before = rig.io.position.copy()
    rig.homed()
    assert np.array_equal(rig.io.position, before)


def test_homing_goes_to_zero_when_the_file_asks() -> None:
    rig = Rig(bare_arm(homing_zero_position=True)).homed()
    assert np.allclose(rig.io.position, 0.0)


def test_homing_moves_smoothly_into_the_limits() -> None:
    rig = Rig(bare_arm())
    rig.io.position[2] = -0.01
    rig.homed()
    assert rig.io.position[2] == pytest.approx(0.0)
    assert rig.io.largest_step < 0.001


def test_homing_to_zero_with_an_instrument_stays() -> None:
    rig = Rig(fixed_arm(homing_zero_position=True))
    before = rig.io.position.copy()
    rig.homed()
    assert np.allclose(rig.io.position, before)


def test_preset_encoders_will_do_without_re_home() -> None:
    rig = Rig(bare_arm(re_home=False)).homed()
    assert ("bias_encoders", (-1970.0,)) in rig.io.sent


def test_power_that_never_comes_is_a_fault_after_two_tries() -> None:
    rig = Rig()
    rig.io.never_powers = True
    rig.run(0.1)
    request = rig.state_command("enable")
    seconds = rig.until(lambda: rig.arm.state == "FAULT")
    assert seconds == pytest.approx(6.2, abs=0.02)
    assert rig.io.sent.count(("power_on", ())) == 2
    assert rig.reports.of("error")[0][1] == "power-timeout"
    rig.step()
    assert request.outcomes == ["accepted", "failed"] and "failed to enable power" in request.replies[-1][1]
    rig.run(0.1)
    assert not rig.io.flag("power_wanted")


@pytest.mark.parametrize("works", (False, True))
@pytest.mark.parametrize("fault", (POWER_TIMEOUT, AMPLIFIER))
def test_power_that_io_gives_up_is_tried_once_more(works: bool, fault: Code) -> None:
    rig = Rig()
    rig.io.never_powers = True
    rig.run(0.1)
    rig.state_command("enable")
    rig.run(3.0)
    rig.io.flag("fault", fault.number)
    rig.io.flag("power_wanted", False)
    rig.io.never_powers = not works
    rig.run(1.0)
    assert rig.io.sent.count(("power_on", ())) == 2
    assert rig.arm.state == ("ENABLED" if works else "POWERING")
    if not works:
        rig.io.flag("fault", fault.number)
        rig.step()
        assert rig.arm.state == "FAULT"
        assert f"fault number {fault.number}" in rig.reports.of("error")[0][2]


def test_bias_that_never_ends_is_a_fault_after_30_seconds() -> None:
    rig = Rig()
    rig.reach("ENABLED")
    rig.io.never_biases = True
    rig.state_command("home")
    seconds = rig.until(lambda: rig.arm.state == "FAULT")
    assert seconds == pytest.approx(30.0, abs=0.05)
    assert "timeout" in rig.reports.of("error")[0][2]


def test_refused_bias_is_told_and_asked_at_most_once_a_second() -> None:
    rig = Rig()
    rig.reach("ENABLED")
    rig.io.refuses["bias_encoders"] = "there are no potentiometers"
    request = rig.state_command("home")
    rig.until(lambda: rig.arm.state == "FAULT")
    rig.step()
    assert rig.io.sent.count(("bias_encoders", (1970.0,))) <= 31
    assert "there are no potentiometers" in request.replies[-1][1]
    assert len(rig.reports.of("warning")) == 1


def test_home_that_is_not_reached_is_a_fault_two_seconds_later() -> None:
    rig = Rig(bare_arm(homing_zero_position=True))
    rig.io.stuck = True
    rig.io.position[0] = 0.5
    rig.reach("HOMING")
    moving = rig.until(lambda: rig.io.flag("pid_enabled"))
    seconds = rig.until(lambda: rig.arm.state == "FAULT")
    planned = 2 * (0.5 / np.radians(90)) ** 0.5
    assert moving < 0.1 and seconds == pytest.approx(planned + 2.0, abs=0.05)
    assert "unable to reach home position" in rig.reports.of("error")[0][2]


@pytest.mark.parametrize("name", ("power_on", "pid_enable", "bias_encoders", "enforce_limits", "tracking_check"))
def test_a_lost_command_is_asked_again(name: str) -> None:
    rig = Rig()
    rig.run(0.1)
    rig.io.loses[name] = 1
    rig.homed()
    assert rig.arm.state == "HOMED"


def test_a_joint_controller_that_stays_off_is_a_fault() -> None:
    rig = Rig()
    rig.io.refuses["pid_enable"] = "the robot has no power"
    rig.reach("HOMING")
    rig.until(lambda: rig.arm.state == "FAULT", 2.0)
    assert "the robot has no power" in rig.reports.of("error")[0][2]


def test_joint_values_are_zero_and_invalid_before_the_bias() -> None:
    rig = Rig()
    rig.reach("ENABLED")
    assert not rig.state["valid"] and not rig.state["position"].any()


def test_fields_that_do_not_lie_evenly_are_refused() -> None:
    buffer = np.zeros(40)
    assert stacked([buffer[0:7], buffer[9:16], buffer[18:25]]).shape == (3, 7)
    with pytest.raises(ValueError, match="side by side"):
        stacked([buffer[0:7], buffer[9:16], buffer[20:27]])


def test_one_refusal_of_the_joint_controller_is_asked_again() -> None:
    rig = Rig()
    rig.reach("ENABLED")
    rig.io.refuses["pid_enable"] = "there is no good sample of its controllers"
    home = rig.state_command("home")
    rig.until(lambda: ("pid_enable", (1.0,)) in rig.io.sent)
    rig.run(0.01)
    del rig.io.refuses["pid_enable"]
    rig.until(lambda: "done" in home.outcomes)
    assert rig.arm.state == "HOMED"
