"""Arms whose process is killed, or stalled for 31 ms, in every state: what the new one orders of io is accepted."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from tests.arm.fake_io import SECOND, ArmHarness
from tests.arm.fake_master import MasterHarness
from tests.arm.fake_psm import DRIVER, SwitchedPsm, with_adapter
from tests.arm.fake_requests import FakeRequest
from trocar.shm.mailbox.origins import NO_ORIGIN

AWAY_NS = {"stalled for 31 ms": 31_000_000, "killed": SECOND // 2}
EFFORTS = (0.0, 0.0, 0.1, 0.0, 0.0, 0.0)


def simple(state: str) -> ArmHarness:
    harness = ArmHarness()
    harness.reach(state)
    return harness


def power_that_does_not_come(_: str) -> ArmHarness:
    harness = ArmHarness()
    harness.io.never_powers = True
    harness.run(0.1)
    harness.state_command("enable")
    harness.run(0.2)
    return harness


def half_enabled(_: str) -> ArmHarness:
    """Asked for, and io has not yet heard."""
    harness = ArmHarness()
    harness.run(0.1)
    harness.io.loses["power_on"] = 1_000_000
    harness.state_command("enable")
    harness.run(0.1)
    harness.io.loses.clear()
    return harness


def by_hand(_: str) -> ArmHarness:
    psm = with_adapter()
    psm.press("PSM1_arm_clutch")
    psm.run(0.1)
    return psm


def engaging(what: str) -> ArmHarness:
    psm = SwitchedPsm().homed() if what == "adapter" else with_adapter().retracted()
    psm.put_on(what)
    if what == "tool":
        psm.send("set_tool_type", (), DRIVER)
    psm.run(1.0)
    assert psm.arm.state == f"ENGAGING_{what.upper()}"
    return psm


def pushing(_: str) -> ArmHarness:
    harness = ArmHarness().homed()
    harness.send("servo_jf", EFFORTS)
    harness.run(0.05)
    assert not harness.io.flag("tracking_check")
    return harness


def moving(_: str) -> ArmHarness:
    harness = ArmHarness().homed()
    harness.send("move_jp", (0.4, 0.2, 0.1, 0.0, 0.0, 0.0))
    harness.run(0.1)
    return harness


def of_master(state: str) -> ArmHarness:
    harness = MasterHarness()
    harness.reach(state)
    return harness


STATES: list[tuple[Callable[[str], ArmHarness], str]] = [
    *((simple, state) for state in ("DISABLED", "POWERING", "ENABLED", "CALIBRATING_ENCODERS_FROM_POTS",
                                    "ENCODERS_BIASED", "HOMING", "HOMED", "PAUSED", "FAULT")),
    (power_that_does_not_come, ""), (half_enabled, ""), (by_hand, ""), (engaging, "adapter"), (engaging, "tool"),
    (pushing, ""), (moving, ""), *((of_master, state) for state in ("CALIBRATING_ROLL", "HOMING", "HOMED"))]


@pytest.mark.parametrize("away", AWAY_NS)
@pytest.mark.parametrize(("reach", "state"), STATES, ids=[f"{way.__name__} {state}".strip() for way, state in STATES])
def test_all_that_a_new_process_orders_of_io_is_accepted(reach: Callable[[str], ArmHarness], state: str,
                                                         away: str) -> None:
    harness = reach(state)
    assert harness.io.refused == []
    for _ in range(AWAY_NS[away] // harness.period_ns):
        harness.now_ns += harness.period_ns
        harness.setpoint.set("mode", 0)
        harness.setpoint["in_effort"][...] = False
        harness.io.cycle(harness.now_ns, harness.setpoint)
    harness.io.origin = NO_ORIGIN  # a new place in io's mailbox
    harness.start_arm()
    harness.run(0.3)
    with harness.hurried():
        harness.run(0.7)
        for button in harness.inputs:  # a hand at the arm: as it is, the other way, and back
            before = bool(harness.io.record["input"][harness.inputs[button]])
            for pressed in (not before, before):
                harness.press(button, pressed)
                harness.run(0.3)
        harness.run(4.0)
    assert harness.io.refused == []
    request = FakeRequest("state_command", (), "disable", origin=NO_ORIGIN)
    harness.step(request)
    harness.run(0.5)
    assert harness.io.refused == [] and not harness.io.flag("power_requested")
