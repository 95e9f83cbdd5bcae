"""A teleoperation acts for the person who enabled it, and no longer than until the next fault of its arms."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import pytest

from tests.arm.fake_requests import FakeRequest
from tests.cases import cases
from tests.teleop.harness import EcmHarness, TeleopHarness
from trocar.shm.commands import COMMANDS
from trocar.shm.mailbox.origins import Origin

PERSON = Origin(77, 3, "trocar send")


def followed() -> tuple[TeleopHarness, Any]:
    harness = TeleopHarness()
    harness.faults = faults = SimpleNamespace(valid_from=3, exempt_origin=0)  # type: ignore[assignment]
    harness.start()
    harness.step(FakeRequest("state_command", (), "enable", origin=PERSON))
    for _ in range(20):
        harness.step()
    assert harness.following
    return harness, faults


def test_arms_are_asked_on_behalf_of_who_enabled_it() -> None:
    harness, _ = followed()
    assert all(arm.origins[-1] == PERSON for arm in harness.arms.values())


def test_a_fault_of_an_arm_ends_it_and_it_asks_for_nothing_that_powers() -> None:
    harness, faults = followed()
    harness.forget()
    faults.valid_from = 4
    harness.run(0.5)
    assert not harness.following and "there has been a fault since it was requested" in harness.text("reason")
    assert not [sent for arm in harness.arms.values() for sent in arm.sent if sent[0] == "state_command"]


@cases("made", [TeleopHarness, EcmHarness])
@cases("scale", [20.0, 1.0001, 0.0, -0.2, math.nan])
def test_a_slave_is_never_made_faster_than_its_master(made: type[TeleopHarness], scale: float) -> None:
    harness = made().follow()
    assert harness.send("set_scale", scale).outcomes == ["refused"]
    assert harness.record.field("scale") == 0.2 and harness.following


@pytest.mark.parametrize("made", [TeleopHarness, EcmHarness])
def test_a_process_that_is_started_again_keeps_the_scale_that_a_person_gave_it(made: type[TeleopHarness]) -> None:
    harness = made().follow()
    assert harness.send("set_scale", 0.05).outcomes == ["done"]
    left = harness.record
    harness.start(left)
    harness.follow()
    assert harness.record.field("scale") == 0.05
    before = harness.slave.pose
    harness.lead(0.0, 0.0, 0.01)
    if made is TeleopHarness:
        assert harness.slave.pose[2] - before[2] == pytest.approx(0.0005)


@pytest.mark.parametrize("kind", ["teleop", "console"])
def test_another_scale_needs_a_persons_command(kind: str) -> None:
    (row,) = [row for row in COMMANDS[kind] if row.name == "set_scale"]
    assert row.needs_operator("", (0.4,))
