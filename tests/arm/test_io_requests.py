"""What an arm wants of io goes out with its setpoints: when it counts anew, and what the arm does when it is void."""

from __future__ import annotations

import pytest

from tests.arm.fake_io import ArmHarness
from tests.arm.fake_requests import PERSON, FakeRequest
from tests.arm.test_kinematic_arm import KinematicPair, Order
from trocar.procs.tables.codes import BAD_READS
from trocar.procs.tables.desired_state import DESIRED_STATES, NONE, OFF, ON


def wanted(harness: ArmHarness) -> dict[str, int]:
    return {desired.name: code for desired in DESIRED_STATES if (code := int(harness.setpoint[desired.field])) != NONE}


def generation(harness: ArmHarness) -> int:
    return int(harness.setpoint["desired_generation"])


def test_a_new_arm_wants_nothing() -> None:
    harness = ArmHarness()
    harness.run(0.1)
    assert not wanted(harness) and generation(harness) == 0


def test_only_power_that_is_asked_for_is_wanted() -> None:
    harness = ArmHarness()
    harness.io.power_cycles = 100
    harness.reach("POWERING")
    assert wanted(harness)["power"] == ON and wanted(harness)["pid"] == OFF
    assert int(harness.setpoint["desired_origin"]) == PERSON.id
    harness.reach("ENABLED")
    harness.step()
    assert "power" not in wanted(harness), "that power goes is a fault from here on"
    harness.homed()
    assert not {"power", "pid", "fault"} & set(wanted(harness))
    harness.state_command("disable")
    assert wanted(harness)["power"] == OFF and wanted(harness)["pid"] == OFF


def test_after_a_fault_an_arm_asks_for_nothing_on_the_authority_of_an_earlier_command() -> None:
    harness = ArmHarness().homed()
    assert int(harness.setpoint["desired_origin"]) == PERSON.id
    harness.io.drop_power()
    harness.until(lambda: harness.arm.state == "FAULT")
    harness.step()
    assert int(harness.setpoint["desired_origin"]) == 0


def test_generations_count_changes_and_not_cycles() -> None:
    harness = ArmHarness().homed()
    before = generation(harness)
    harness.run(0.5)
    assert generation(harness) == before and int(harness.io.flag("desired_generation")) == before
    harness.state_command("pause")
    assert generation(harness) == before + 1, "a person's command makes all count anew"


def test_generations_go_on_from_1_after_the_largest() -> None:
    harness = ArmHarness().homed()
    requests = harness.arm.control.io_requests
    requests._generation = 2**32 - 2
    requests._generation_out[...] = 2**32 - 2
    harness.step()
    seen = []
    for word in ("pause", "resume", "pause"):
        harness.state_command(word)
        harness.step()
        seen.append((generation(harness), int(harness.io.flag("desired_generation"))))
    assert seen == [(2**32 - 1, 2**32 - 1), (1, 1), (2, 2)]


def test_a_restarted_arm_begins_with_generation_0_and_goes_on_above_its_predecessor() -> None:
    harness = ArmHarness().homed()
    before = generation(harness)
    harness.io.void()
    harness.start_arm()
    assert generation(harness) == 0 and not wanted(harness) and not harness.setpoint["desired_origin"]
    harness.run(0.1)
    assert harness.arm.state == "HOMED" and generation(harness) > before
    assert not {"power",
                "pid"} & set(wanted(harness)) and not harness.setpoint["desired_origin"], "nobody has asked for these"


def test_power_that_a_person_takes_back_is_not_asked_for_again() -> None:
    harness = ArmHarness()
    harness.io.never_powers = True
    harness.reach("POWERING")
    harness.run(0.1)
    harness.io.void("trocar send requested power_off meanwhile")
    harness.io.flag("power_requested", False)
    before = harness.io.sent.count(("power_on", ()))
    harness.run(10.0)
    assert harness.arm.state == "FAULT" and harness.io.sent.count(("power_on", ())) == before == 1
    assert "trocar send requested power_off meanwhile" in harness.reports.of("error")[0][2]


def test_a_fault_of_an_arm_without_power_does_not_keep_it_from_a_new_command() -> None:
    harness = ArmHarness().homed()
    harness.state_command("disable")
    harness.run(0.1)
    harness.io.flag("fault", BAD_READS.number)
    harness.run(1.0)
    assert harness.io.flag("fault") == BAD_READS.number and harness.io.flag("desired_void")
    harness.state_command("enable")
    harness.until(lambda: harness.arm.state == "ENABLED", 1.0)
    assert harness.io.flag("fault") == 0


@pytest.mark.parametrize(("state", "name"), [
    ("POWERING", "power_off"), ("ENABLED", "pid_enable"), ("HOMING", "servo_zero"),
    *(("HOMED", name) for name in ("power_off", "pid_enable", "servo_zero"))])
def test_what_a_person_takes_from_a_played_robot_is_not_given_back(state: str, name: str) -> None:
    pair = KinematicPair(period_ns=10_000_000)
    pair.run(0.02)
    way = (("enable", "ENABLED"), ("home", state)) if state in ("HOMING", "HOMED") else (("enable", state),)
    for word, until in way:
        pair.ask("state_command", text=word)
        pair.until(until)
    pair.run(0.02)
    pair.orders.append(Order(1, name, () if name == "servo_zero" else (0.0,), "PSM1", []))
    pair.step()
    assert pair.record.desired_void[0] and not pair.record.pid_enabled[0]
    powered = bool(pair.record.power_requested[0])
    assert powered is (name != "power_off")
    pair.run(5.0)
    assert not pair.record.pid_enabled[0] and (powered or not pair.record.power_requested[0])
    assert pair.arm.state in ("FAULT", "ENABLED")
    pair.step(FakeRequest("state_command", (), "disable"))
    pair.run(0.1)
    pair.homed()
