"""A teleoperation acts for the person who enabled it, and no longer than until the next fault of its arms."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

from shm.origins import Origin
from tests.arm.fake_requests import FakeRequest
from tests.teleop.harness import TeleopHarness

PERSON = Origin(77, 3, "trocar send")


def followed() -> tuple[TeleopHarness, Any]:
    harness = TeleopHarness()
    harness.faults = faults = SimpleNamespace(void=3, spared=0)  # type: ignore[assignment]
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
    faults.void = 4
    harness.run(0.5)
    assert not harness.following and "there was a fault since it was asked for" in harness.text("reason")
    assert not [sent for arm in harness.arms.values() for sent in arm.sent if sent[0] == "state_command"]
