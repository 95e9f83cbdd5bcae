"""What an arm wants of io goes out with its set-points: when it counts anew, and what the arm does when it is void."""

from __future__ import annotations

import pytest

from procs.codes import BAD_READS
from procs.wishes import NONE, OFF, ON, WISHES
from tests.arm.fake_io import PERSON, FakeRequest, Rig
from tests.arm.test_kinematic_arm import Order, Pair


def wanted(rig: Rig) -> dict[str, int]:
    return {wish.name: code for wish in WISHES if (code := int(rig.setpoint[wish.field])) != NONE}


def generation(rig: Rig) -> int:
    return int(rig.setpoint["wish_generation"])


def test_a_new_arm_wants_nothing() -> None:
    rig = Rig()
    rig.run(0.1)
    assert not wanted(rig) and generation(rig) == 0


def test_only_power_that_is_asked_for_is_wanted() -> None:
    rig = Rig()
    rig.io.power_cycles = 100
    rig.reach("POWERING")
    assert wanted(rig)["power"] == ON and wanted(rig)["pid"] == OFF
    assert int(rig.setpoint["wish_origin"]) == PERSON.id
    rig.reach("ENABLED")
    rig.step()
    assert "power" not in wanted(rig), "that power goes is a fault from here on"
    rig.homed()
    assert not {"power", "pid", "fault"} & set(wanted(rig))
    rig.state_command("disable")
    assert wanted(rig)["power"] == OFF and wanted(rig)["pid"] == OFF


def test_generations_count_changes_and_not_cycles() -> None:
    rig = Rig().homed()
    before = generation(rig)
    rig.run(0.5)
    assert generation(rig) == before and int(rig.io.flag("wish_generation")) == before
    rig.state_command("pause")
    assert generation(rig) == before + 1, "a person's command makes all count anew"


def test_a_restarted_arm_begins_with_generation_0_and_goes_on_above_its_predecessor() -> None:
    rig = Rig().homed()
    before = generation(rig)
    rig.io.void()
    rig.start_arm()
    assert generation(rig) == 0 and not wanted(rig) and not rig.setpoint["wish_origin"]
    rig.run(0.1)
    assert rig.arm.state == "HOMED" and generation(rig) > before
    assert not {"power", "pid"} & set(wanted(rig)) and not rig.setpoint["wish_origin"], "nobody has asked for these"


def test_power_that_a_person_takes_back_is_not_asked_for_again() -> None:
    rig = Rig()
    rig.io.never_powers = True
    rig.reach("POWERING")
    rig.run(0.1)
    rig.io.void("trocar send asked for power_off meanwhile")
    rig.io.flag("power_wanted", False)
    before = rig.io.sent.count(("power_on", ()))
    rig.run(10.0)
    assert rig.arm.state == "FAULT" and rig.io.sent.count(("power_on", ())) == before == 1
    assert "trocar send asked for power_off meanwhile" in rig.reports.of("error")[0][2]


def test_a_fault_of_an_arm_without_power_does_not_keep_it_from_a_new_command() -> None:
    rig = Rig().homed()
    rig.state_command("disable")
    rig.run(0.1)
    rig.io.flag("fault", BAD_READS.number)
    rig.run(1.0)
    assert rig.io.flag("fault") == BAD_READS.number and rig.io.flag("wish_void")
    rig.state_command("enable")
    rig.until(lambda: rig.arm.state == "ENABLED", 1.0)
    assert rig.io.flag("fault") == 0


@pytest.mark.parametrize("state", ["POWERING", "ENABLED", "HOMING", "HOMED"])
@pytest.mark.parametrize("name", ["power_off", "pid_enable", "servo_zero"])
def test_what_a_person_takes_from_a_played_robot_is_not_given_back(state: str, name: str) -> None:
    pair = Pair()
    pair.run(0.02)
    way = (("enable", "ENABLED"), ("home", state)) if state in ("HOMING", "HOMED") else (("enable", state),)
    for word, until in way:
        pair.ask("state_command", text=word)
        pair.until(until)
    pair.run(0.02)
    pair.orders.append(Order(1, name, (0.0,), "PSM1", []))
    pair.step()
    assert pair.record.wish_void[0] and not pair.record.pid_enabled[0]
    powered = bool(pair.record.power_wanted[0])
    assert powered is (name != "power_off")
    pair.run(5.0)
    assert not pair.record.pid_enabled[0] and (powered or not pair.record.power_wanted[0])
    assert pair.arm.state in ("FAULT", "ENABLED")
    pair.step(FakeRequest("state_command", (), "disable"))
    pair.run(0.1)
    pair.homed()
