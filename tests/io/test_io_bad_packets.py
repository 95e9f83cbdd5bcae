"""Packets that are lost: warned of once, a fault when there are too many, and what is asked for meanwhile."""

from __future__ import annotations

import numpy as np
import pytest

from tests.io.fault_rows import BUTTON, RELEASED_A, brake_a, braked, is_off, lose_packets, reported, working
from trocar.procs.fpga import blocks


def test_one_bad_packet_changes_nothing_but_a_warning() -> None:
    harness = working(braked())
    before = harness.port.sent[-1].copy()
    lose_packets(harness)
    harness.run(1)
    assert reported(harness) == ["read-missed"] and not harness.record.valid
    assert harness.record.pid_enabled[0] and harness.record.power_requested[0] and brake_a(harness) == RELEASED_A
    np.testing.assert_array_equal(harness.port.sent[-1], before)
    harness.port.good = True
    harness.run(100)
    assert reported(harness) == ["read-missed"] and harness.record.valid and harness.record.pid_enabled[0]


def test_hundreds_of_bad_packets_are_one_warning_one_fault_and_one_recovery() -> None:
    harness = working(braked())
    lose_packets(harness)
    sent = len(harness.port.sent)
    harness.run(500)
    assert reported(harness) == ["read-missed", "bad-reads", "power off"] and not harness.record.valid
    assert any("boards 0, 1: " in event.text for event in harness.core.reports.events if event.code == "bad-reads")
    assert len(harness.port.sent) == sent + 500 and is_off(harness)
    assert harness.record.bad_reads == 500 and harness.record.age_ns == pytest.approx(500 * 976_562, rel=1e-3)
    harness.port.good = True
    harness.run(10)
    assert reported(harness) == ["read-missed", "bad-reads", "power off", "communication with the controllers restored"]
    assert harness.record.valid and not harness.record.pid_enabled[0] and not harness.record.power_requested[0]


def test_power_asked_for_without_packets_fails_at_once() -> None:
    harness = working(braked())
    lose_packets(harness)
    harness.run(100)
    harness.core.reports.events.clear()
    command = harness.ask("power_on")
    harness.run(1)
    assert command.outcome == "failed" and harness.codes == ["bad-reads"] and is_off(harness)


def test_a_button_pressed_while_packets_are_lost_is_told_with_the_next_good_one() -> None:
    harness = working(braked())
    lose_packets(harness)
    harness.port.live[0, blocks.DIGITAL_INPUT] |= BUTTON
    harness.run(10)
    assert reported(harness) == ["read-missed"]
    harness.port.good = True
    harness.run(1)
    assert reported(harness) == ["read-missed", "pressed"]
