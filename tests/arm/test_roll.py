"""A master's way from power to home: its roll is driven to the stop, set there, and only then homed."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.arm.fake_io import PERIOD_NS
from tests.arm.fake_master import ROLL, STOP, MasterHarness, master
from tests.arm.test_homing import sub_states
from tests.arm.test_recovery import restart

WAY = ["DISABLED", "POWERING", "ENABLED", "CALIBRATING_ENCODERS_FROM_POTS", "ENCODERS_BIASED", "CALIBRATING_ROLL",
       "RESETTING_ROLL_ENCODER", "HOMING", "HOMED"]


def finding(harness: MasterHarness) -> MasterHarness:
    harness.reach("CALIBRATING_ROLL")
    harness.run(0.1)
    return harness


def test_roll_is_found_at_its_stop_and_homed() -> None:
    harness = MasterHarness()
    harness.reach("HOMING")
    assert harness.io.turned < 1e-9 and harness.io.position[ROLL] == pytest.approx(STOP)
    took = harness.until(lambda: harness.arm.state == "HOMED")
    assert took == pytest.approx(480 / 360 + 1, abs=0.05), "the roll's way at its own speed"
    harness.run(0.2)
    assert sub_states(harness) == WAY
    assert np.allclose(harness.state["position"][:7], 0.0, atol=1e-9) and harness.state["is_homed"]
    assert ("bias_encoders", (1970.0, 6.0)) in harness.io.sent
    assert [command for command in harness.io.sent if command[0] == "set_encoder"] == [("set_encoder", (6.0, STOP))]
    assert "found roll lower limit" in str(harness.reports.of("status"))
    assert not harness.reports.of("error", "warning") and not harness.io.flag("tracking_check")


def test_the_other_joints_hold_while_the_roll_is_found() -> None:
    harness = finding(MasterHarness())
    held = harness.io.position[:ROLL].copy()
    harness.until(lambda: harness.arm.state == "HOMING")
    assert np.allclose(harness.io.position[:ROLL], held, atol=1e-12)


def test_cartesian_values_wait_for_the_roll() -> None:
    harness = finding(MasterHarness())
    assert harness.state["valid"] and not harness.state["cartesian_valid"]
    harness.until(lambda: harness.arm.state == "HOMED")
    harness.run(0.01)
    assert harness.state["cartesian_valid"]


def test_a_preset_roll_is_not_driven_anywhere() -> None:
    harness = MasterHarness(master(re_home=False))
    harness.io.record["encoder_set"][2:] = True
    harness.homed()
    assert ("bias_encoders", (-1970.0, 6.0)) in harness.io.sent
    assert not [command for command in harness.io.sent if command[0] == "set_encoder"]
    assert harness.io.turned == pytest.approx(4.0), "from 1 rad to zero, straight"


def test_each_homing_finds_the_roll_anew_unless_told_otherwise() -> None:
    harness = MasterHarness().homed()
    harness.state_command("unhome")
    harness.run(0.1)
    assert harness.arm.state == "ENABLED"
    harness.state_command("home")
    harness.until(lambda: harness.arm.state == "HOMED")
    assert [command[0] for command in harness.io.sent].count("set_encoder") == 2


def test_a_roll_without_a_stop_is_a_fault() -> None:
    harness = MasterHarness()
    harness.io.has_stop = False
    took = finding(harness).until(lambda: harness.arm.state == "FAULT")
    assert took == pytest.approx(6.5 / 2 + 1, abs=0.2)
    assert "went past roll lower limit" in harness.reports.of("error")[0][2]


def test_a_roll_that_never_stands_still_is_a_fault() -> None:
    harness = finding(MasterHarness())
    harness.io.stuck = True
    harness.io.record["velocity"][2 + ROLL] = -1.0
    took = harness.until(lambda: harness.arm.state == "FAULT")
    assert took == pytest.approx(6.5 / 2 + 1 + 2, abs=0.2)
    assert "unable to hit roll lower limit in time" in harness.reports.of("error")[0][2]


@pytest.mark.parametrize(("degrees", "state"), ((4.0, "HOMED"), (6.0, "FAULT")))
def test_the_encoder_must_read_the_stop_within_five_degrees(degrees: float, state: str) -> None:
    harness = MasterHarness()
    harness.io.spring = math.radians(degrees)
    harness.reach(state) if state == "HOMED" else finding(harness).until(lambda: harness.arm.state == "FAULT")
    reported = [] if state == "HOMED" else [f"reads {-480 + degrees:.1f}°"]
    assert all(part in str(harness.reports.of("error")) for part in reported)


def test_an_encoder_that_io_will_not_set_is_a_fault_that_says_why() -> None:
    harness = finding(MasterHarness())
    harness.io.refuses["set_encoder"] = "there is no good sample"
    harness.until(lambda: harness.arm.state == "FAULT")
    assert "io says: there is no good sample" in harness.reports.of("error")[-1][2]


def test_a_lost_order_to_set_the_encoder_is_no_end() -> None:
    harness = MasterHarness()
    harness.io.refuses["set_encoder"] = "not now"
    finding(harness).until(lambda: harness.arm.state == "RESETTING_ROLL_ENCODER")
    harness.run(0.3)
    del harness.io.refuses["set_encoder"]
    harness.until(lambda: harness.arm.state == "HOMED")


@pytest.mark.parametrize("word", ["hold", "state_command"])
def test_a_pause_while_the_encoder_is_set_costs_no_power_and_moves_nothing(word: str) -> None:
    for cycles in range(3):  # io sets it within these
        harness = finding(MasterHarness())
        harness.until(lambda harness=harness: harness.arm.state == "RESETTING_ROLL_ENCODER")  # type: ignore[misc]
        for _ in range(cycles):
            harness.step()
        assert (harness.arm.state == "RESETTING_ROLL_ENCODER") is (cycles < 2)
        request = harness.send(word, (), "pause" if word == "state_command" else "")
        held = harness.io.position[:ROLL].copy()
        harness.run(1.0)
        assert harness.arm.state == "PAUSED" and request.outcomes == ["accepted", "done"], cycles
        assert harness.io.position[ROLL] == pytest.approx(STOP) and np.allclose(harness.io.position[:ROLL], held)
        assert not harness.reports.of("error")
    harness.state_command("resume")
    harness.until(lambda: harness.arm.state == "HOMED")


def test_homing_that_stays_takes_the_roll_off_its_stop() -> None:
    harness = MasterHarness(master(homing_zero_position=False)).homed()
    assert harness.io.position[ROLL] == pytest.approx(STOP + math.radians(10.0), abs=1e-4)
    assert harness.io.position[0] == pytest.approx(0.05)


@pytest.mark.parametrize(("off", "fails"), ((3.5, False), (4.5, True)))
def test_homing_is_there_within_four_degrees(off: float, fails: bool) -> None:
    harness = MasterHarness()
    harness.reach("HOMING")
    harness.until(lambda: harness.arm.control.motion.moving)
    harness.until(lambda: not harness.arm.control.motion.moving)
    harness.io.stuck = True
    harness.io.position[0] += math.radians(off)
    harness.until(lambda: harness.arm.state != "HOMING")
    assert harness.arm.state == ("FAULT" if fails else "HOMED")


@pytest.mark.parametrize("state", ("CALIBRATING_ROLL", "RESETTING_ROLL_ENCODER", "HOMING"))
def test_a_process_that_dies_on_the_way_leaves_the_arm_held(state: str) -> None:
    harness = MasterHarness()
    harness.reach(state)
    harness.run(0.0 if state == "RESETTING_ROLL_ENCODER" else 0.2)
    restart(harness)
    sent, held = len(harness.io.sent), harness.io.position.copy()
    harness.run(0.5)
    assert harness.arm.state == "ENABLED" and not harness.state["is_homed"]
    assert len(harness.io.sent) == sent and np.allclose(harness.io.position, held, atol=1e-12)
    harness.state_command("home")
    harness.until(lambda: harness.arm.state == "HOMED")
    assert np.allclose(harness.io.position, 0.0, atol=1e-9)


def test_pause_and_resume_begin_the_search_anew() -> None:
    harness = finding(MasterHarness())
    harness.state_command("pause")
    harness.run(0.2)
    stands = float(harness.io.position[ROLL])
    harness.run(PERIOD_NS * 1e-7)
    assert harness.arm.state == "PAUSED" and harness.io.position[ROLL] == stands
    harness.state_command("resume")
    harness.until(lambda: harness.arm.state == "HOMED")
