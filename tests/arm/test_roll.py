"""A master's way from power to home: its roll is driven to the stop, set there, and only then homed."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.arm.fake_io import PERIOD_NS
from tests.arm.fake_master import ROLL, STOP, MasterRig, master
from tests.arm.test_homing import sub_states
from tests.arm.test_recovery import restart

WAY = ["DISABLED", "POWERING", "ENABLED", "CALIBRATING_ENCODERS_FROM_POTS", "ENCODERS_BIASED", "CALIBRATING_ROLL",
       "RESETTING_ROLL_ENCODER", "HOMING", "HOMED"]


def finding(rig: MasterRig) -> MasterRig:
    rig.reach("CALIBRATING_ROLL")
    rig.run(0.1)
    return rig


def test_roll_is_found_at_its_stop_and_homed() -> None:
    rig = MasterRig()
    rig.reach("HOMING")
    assert rig.io.turned < 1e-9 and rig.io.position[ROLL] == pytest.approx(STOP)
    took = rig.until(lambda: rig.arm.state == "HOMED")
    assert took == pytest.approx(480 / 360 + 1, abs=0.05), "the roll's way at its own speed"
    rig.run(0.2)
    assert sub_states(rig) == WAY
    assert np.allclose(rig.state["position"][:7], 0.0, atol=1e-9) and rig.state["is_homed"]
    assert ("bias_encoders", (1970.0, 6.0)) in rig.io.sent
    assert [command for command in rig.io.sent if command[0] == "set_encoder"] == [("set_encoder", (6.0, STOP))]
    assert "found roll lower limit" in str(rig.reports.of("status"))
    assert not rig.reports.of("error", "warning") and not rig.io.flag("tracking_check")


def test_the_other_joints_hold_while_the_roll_is_found() -> None:
    rig = finding(MasterRig())
    held = rig.io.position[:ROLL].copy()
    rig.until(lambda: rig.arm.state == "HOMING")
    assert np.allclose(rig.io.position[:ROLL], held, atol=1e-12)


def test_cartesian_values_wait_for_the_roll() -> None:
    rig = finding(MasterRig())
    assert rig.state["valid"] and not rig.state["cartesian_valid"]
    rig.until(lambda: rig.arm.state == "HOMED")
    rig.run(0.01)
    assert rig.state["cartesian_valid"]


def test_a_preset_roll_is_not_driven_anywhere() -> None:
    rig = MasterRig(master(re_home=False))
    rig.io.record["encoder_set"][2:] = True
    rig.homed()
    assert ("bias_encoders", (-1970.0, 6.0)) in rig.io.sent
    assert not [command for command in rig.io.sent if command[0] == "set_encoder"]
    assert rig.io.turned == pytest.approx(4.0), "from 1 rad to zero, straight"


def test_each_homing_finds_the_roll_anew_unless_told_otherwise() -> None:
    rig = MasterRig().homed()
    rig.state_command("unhome")
    rig.run(0.1)
    assert rig.arm.state == "ENABLED"
    rig.state_command("home")
    rig.until(lambda: rig.arm.state == "HOMED")
    assert [command[0] for command in rig.io.sent].count("set_encoder") == 2


def test_a_roll_without_a_stop_is_a_fault() -> None:
    rig = MasterRig()
    rig.io.has_stop = False
    took = finding(rig).until(lambda: rig.arm.state == "FAULT")
    assert took == pytest.approx(6.5 / 2 + 1, abs=0.2)
    assert "went past roll lower limit" in rig.reports.of("error")[0][2]


def test_a_roll_that_never_stands_still_is_a_fault() -> None:
    rig = finding(MasterRig())
    rig.io.stuck = True
    rig.io.record["velocity"][2 + ROLL] = -1.0
    took = rig.until(lambda: rig.arm.state == "FAULT")
    assert took == pytest.approx(6.5 / 2 + 1 + 2, abs=0.2)
    assert "unable to hit roll lower limit in time" in rig.reports.of("error")[0][2]


@pytest.mark.parametrize(("degrees", "state"), ((4.0, "HOMED"), (6.0, "FAULT")))
def test_the_encoder_must_read_the_stop_within_five_degrees(degrees: float, state: str) -> None:
    rig = MasterRig()
    rig.io.spring = math.radians(degrees)
    rig.reach(state) if state == "HOMED" else finding(rig).until(lambda: rig.arm.state == "FAULT")
    said = [] if state == "HOMED" else [f"reads {-480 + degrees:.1f}°"]
    assert all(part in str(rig.reports.of("error")) for part in said)


def test_an_encoder_that_io_will_not_set_is_a_fault_that_says_why() -> None:
    rig = finding(MasterRig())
    rig.io.refuses["set_encoder"] = "there is no good sample"
    rig.until(lambda: rig.arm.state == "FAULT")
    assert "io says: there is no good sample" in rig.reports.of("error")[-1][2]


def test_a_lost_order_to_set_the_encoder_is_no_end() -> None:
    rig = MasterRig()
    rig.io.refuses["set_encoder"] = "not now"
    finding(rig).until(lambda: rig.arm.state == "RESETTING_ROLL_ENCODER")
    rig.run(0.3)
    del rig.io.refuses["set_encoder"]
    rig.until(lambda: rig.arm.state == "HOMED")


def test_homing_that_stays_takes_the_roll_off_its_stop() -> None:
    rig = MasterRig(master(homing_zero_position=False)).homed()
    assert rig.io.position[ROLL] == pytest.approx(STOP + math.radians(10.0), abs=1e-4)
    assert rig.io.position[0] == pytest.approx(0.05)


@pytest.mark.parametrize(("off", "fails"), ((3.5, False), (4.5, True)))
def test_homing_is_there_within_four_degrees(off: float, fails: bool) -> None:
    rig = MasterRig()
    rig.reach("HOMING")
    rig.until(lambda: rig.arm.control.motion.moving)
    rig.until(lambda: not rig.arm.control.motion.moving)
    rig.io.stuck = True
    rig.io.position[0] += math.radians(off)
    rig.until(lambda: rig.arm.state != "HOMING")
    assert rig.arm.state == ("FAULT" if fails else "HOMED")


@pytest.mark.parametrize("state", ("CALIBRATING_ROLL", "RESETTING_ROLL_ENCODER", "HOMING"))
def test_a_process_that_dies_on_the_way_leaves_the_arm_held(state: str) -> None:
    rig = MasterRig()
    rig.reach(state)
    rig.run(0.0 if state == "RESETTING_ROLL_ENCODER" else 0.2)
    restart(rig)
    sent, held = len(rig.io.sent), rig.io.position.copy()
    rig.run(0.5)
    assert rig.arm.state == "ENABLED" and not rig.state["is_homed"]
    assert len(rig.io.sent) == sent and np.allclose(rig.io.position, held, atol=1e-12)
    rig.state_command("home")
    rig.until(lambda: rig.arm.state == "HOMED")
    assert np.allclose(rig.io.position, 0.0, atol=1e-9)


def test_pause_and_resume_begin_the_search_anew() -> None:
    rig = finding(MasterRig())
    rig.state_command("pause")
    rig.run(0.2)
    stands = float(rig.io.position[ROLL])
    rig.run(PERIOD_NS * 1e-7)
    assert rig.arm.state == "PAUSED" and rig.io.position[ROLL] == stands
    rig.state_command("resume")
    rig.until(lambda: rig.arm.state == "HOMED")
