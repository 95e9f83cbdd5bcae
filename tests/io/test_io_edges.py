"""Checks of io that begin again, several faults of one kind, and what events have of them."""

from __future__ import annotations

import numpy as np
import pytest

from procs.fpga import blocks, registers
from procs.io.safety import WARM_REPEAT_NS
from tests.io.fault_rows import NOWHERE, braked, digital, heal, read_pots, working
from tests.io.harness import IoHarness, robot

MS = 1_000_000


def errors(harness: IoHarness) -> list[tuple[str, int]]:
    return [(event.code, event.axis) for event in harness.core.reports.events if event.kind == "error"]


def test_every_potentiometer_that_is_nowhere_is_told() -> None:
    harness = working(digital())
    for axis in (1, 4, 5):
        read_pots(harness, NOWHERE, axis)
    harness.run(1)
    assert errors(harness) == [("pot-missing", axis) for axis in (1, 4, 5)]


def test_what_was_told_is_told_again_when_it_comes_back() -> None:
    for code, breaks, cycles in (
            ("potentiometer", lambda h: h.port.pot(3, 0.1), 11),
            ("encoder-overflow", lambda h: h.port.live.__setitem__(
                (0, blocks.POSITION.start + 2), 0x800000 | registers.ENCODER_OVERFLOW), 1)):
        harness = braked()
        harness.power()
        harness.ask("pot_check", 1)
        for _ in range(2):
            breaks(harness)
            harness.run(cycles + 3)
            assert [found for found, _ in errors(harness)] == [code]
            heal(harness)
            harness.run(2)
            harness.ask("clear_fault")
            harness.power()
            harness.ask("pot_check", 1)
            harness.core.reports.events.clear()


@pytest.mark.parametrize(("celsius", "codes"), [(60.0, []), (60.5, ["temperature-high"]), (65.0, ["temperature-high"]),
                                                (65.5, ["temperature"])])
def test_a_warm_amplifier_is_a_warning_every_two_minutes(celsius: float, codes: list[str]) -> None:
    harness = braked()
    harness.power()
    harness.core.reports.events.clear()
    harness.port.live[1, blocks.TEMPERATURE] = 60 << 8 | round(celsius * 2)
    harness.run(1)
    found = [event for event in harness.core.reports.events if event.code.startswith("temp")]
    assert [event.code for event in found] == codes
    if not codes or codes == ["temperature"]:
        assert not found or (found[0].value, found[0].limit, found[0].axis) == (65.5, 65.0, 6)
        return
    assert (found[0].value, found[0].limit) == (celsius, 60.0) and found[0].axis == 6
    harness.core.reports.events.clear()
    begun = harness.clock.ns
    harness.clock.ns = begun + WARM_REPEAT_NS - 2 * MS
    harness.run(1)
    assert not any(event.code == "temperature-high" for event in harness.core.reports.events)
    harness.run(3)
    assert [event.code for event in harness.core.reports.events if event.code.startswith("temp")] == codes


def test_limits_that_are_enforced_later_do_not_move_what_is_held() -> None:
    harness = IoHarness()
    for axis in range(7):
        harness.port.place(axis, 1.6)
    harness.control()
    harness.run(3)
    assert harness.ask("enforce_limits", 1).outcome == "done"
    harness.run(3)
    np.testing.assert_allclose(harness.record.setpoint_position, 1.6, atol=1e-5)
    harness.send(1, position=1.6)
    harness.run(1)
    np.testing.assert_allclose(harness.record.setpoint_position, 1.5)
    assert harness.record.at_limit.all()


def test_how_long_an_arm_was_away_is_told() -> None:
    harness = IoHarness(arm_lost_s=1.0, arm_lost_power_off_s=2.0)
    harness.control()
    harness.arms_alive = False
    harness.run_s(2.2)
    told = [(event.code, event.value, event.limit) for event in harness.core.reports.events if event.kind == "error"]
    assert [row[0] for row in told] == ["arm-lost", "arm-lost-power-off"]
    assert [row[1] for row in told] == pytest.approx([1.0, 2.0], abs=0.002) and [row[2] for row in told] == [1.0, 2.0]


def test_a_setpoint_counts_to_the_end_of_its_time_and_no_further_into_the_future() -> None:
    for lag_ns, fresh in ((30 * MS, True), (30 * MS + 1, False), (-30 * MS, True), (-30 * MS - 1, False)):
        harness = IoHarness()
        harness.control()
        harness.arms_alive = False
        harness.send(1, position=0.1)
        arm = harness.arms[0]
        arm.bias_generation[...] = harness.record.bias_generation[0]
        arm.pid_generation[...] = harness.record.pid_generation[0]
        arm.stamp_ns = harness.clock.ns + 976_562 - lag_ns
        harness.run(1)
        assert (harness.record.setpoint_position == (0.1 if fresh else 0.0)).all()
        assert harness.record.setpoint_age_ns[0] == max(0, lag_ns)


def test_an_axis_that_only_io_has_may_overflow() -> None:
    for only_io in (False, True):
        harness = IoHarness(robots=(robot("PSM1", 0, only_io=only_io),), pids=())
        harness.port.live[0, blocks.POSITION.start + 2] |= np.uint32(registers.ENCODER_OVERFLOW)
        harness.run(2)
        assert ("encoder-overflow", 2) in errors(harness) or only_io
        assert bool(errors(harness)) is not only_io
