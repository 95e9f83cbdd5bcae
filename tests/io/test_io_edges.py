"""Checks of io that begin again, several faults of one kind, and what events have of them."""

from __future__ import annotations

import numpy as np
import pytest

from tests.io.fault_rows import NOWHERE, braked, digital, heal, read_pots, working
from tests.io.harness import IoHarness, actuator, robot
from trocar.procs.fpga import blocks, registers
from trocar.procs.io.safety import WARM_REPEAT_NS

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
        harness = braked().power()
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
    harness = braked().power()
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
    harness = IoHarness(arm_lost_s=1.0, arm_lost_power_off_s=2.0).control()
    harness.arms_alive = False
    harness.run_s(2.2)
    assert not harness.record.power_requested[0]
    told = [(event.code, event.value, event.limit) for event in harness.core.reports.events if event.kind == "error"]
    assert [row[0] for row in told] == ["arm-lost", "arm-lost-power-off"]
    assert [row[1] for row in told] == pytest.approx([1.0, 2.0], abs=0.002) and [row[2] for row in told] == [1.0, 2.0]


def test_a_setpoint_counts_to_the_end_of_its_time_and_no_further_into_the_future() -> None:
    for lag_ns, fresh in ((30 * MS, True), (30 * MS + 1, False), (-30 * MS, True), (-30 * MS - 1, False)):
        harness = IoHarness().control()
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


def test_efforts_are_taken_up_anew_after_each_enable() -> None:
    harness = IoHarness().control()
    harness.send(1, in_effort=True, effort=0.4)
    harness.run(2)
    assert harness.record.effort_mode.all()
    harness.ask("pid_enable", 0)
    assert not harness.record.effort_mode.any()
    harness.ask("pid_enable", 1)
    harness.run(1)
    assert harness.record.effort_mode.all()
    np.testing.assert_allclose(harness.record.setpoint_effort, 0.4)


def test_who_goes_over_to_efforts_beyond_its_limits_is_not_clipped() -> None:
    harness = IoHarness().control()
    harness.ask("enforce_limits", 1)
    harness.send(1, position=0.1)
    harness.run(2)
    for axis in range(7):
        harness.port.place(axis, 1.7)
    harness.send(1, in_effort=True, effort=0.1)
    harness.run(2)
    assert not harness.record.at_limit.any()
    np.testing.assert_allclose(harness.record.setpoint_position, 1.7, atol=1e-5)
    harness.send(1, in_effort=False, position=1.7)
    harness.run(1)
    assert harness.record.at_limit.all() and (harness.record.setpoint_position == 1.5).all()


def test_a_watchdog_that_stays_is_a_fault_after_a_fifth_of_a_second() -> None:
    harness = IoHarness(close_all_relays=False)
    obey = harness.port._obey

    def stuck(row: int) -> None:
        obey(row)
        harness.port.set_status(registers.STATUS_WATCHDOG)

    harness.port._obey = stuck
    harness.run(2)
    harness.ask("power_on")
    begun = harness.clock.ns
    while not harness.codes:
        harness.run(1)
        assert harness.clock.ns - begun < 210 * MS
    assert harness.codes == ["watchdog"] and harness.clock.ns - begun > 200 * MS


def test_an_event_names_the_first_of_several_boards() -> None:
    harness = IoHarness().power()
    harness.pass_s(3.1)
    harness.port.has_supply = False
    harness.run(3)
    (event,) = [event for event in harness.core.reports.events if event.code == "power-lost"]
    assert event.board == 0 and "boards 0, 1" in event.text, event
    harness = working(braked())
    harness.port.current(5, 1.3)
    harness.run(101)
    (event,) = [event for event in harness.core.reports.events if event.code == "current"]
    assert (event.board, event.axis) == (1, 5)


def test_a_supply_alone_ends_to_the_cycle_and_is_asked_for_again_until_it_comes() -> None:
    harness = IoHarness(close_all_relays=False)
    harness.run(2)
    harness.port.has_supply = True
    harness.port.lose_power_on(3)
    assert harness.ask("supply_on", 1.0).outcome == "done"
    begun = harness.clock.ns
    harness.run_s(0.2)
    assert not harness.port.live[0, blocks.STATUS] & registers.STATUS_POWER, "two were lost, 0.1 s apart"
    harness.run_s(0.2)
    assert harness.port.live[:, blocks.STATUS].all() and not harness.record.power_requested[0]
    assert all(int(word) & registers.STATUS_POWER for word in harness.port.live[:, blocks.STATUS])
    assert harness.ask("supply_on", 0.5).outcome == "done", "asked again, it lasts from then on"
    begun = harness.clock.ns
    while int(harness.port.live[0, blocks.STATUS]) & registers.STATUS_POWER:
        harness.run(1)
        assert harness.clock.ns - begun < 505 * MS
    assert harness.clock.ns - begun >= 500 * MS


def test_a_robot_without_a_joint_controller_has_no_setpoints() -> None:
    harness = IoHarness(2, pids=(IoHarness(2).io.pids[1],))
    harness.control("PSM2")
    harness.send(1, position=0.1)
    harness.run(2)
    follow = harness.core.follow
    assert (follow.newest_ns(0), follow.newest_ns(1)) == (0, harness.clock.ns - 100_000)
    assert (follow.controlled(0), follow.controlled(1)) == (False, True)


def test_an_axis_without_encoder_or_potentiometer_has_nothing_to_compare() -> None:
    rows = [actuator(axis // 4, axis % 4) for axis in range(7)]
    rows[1], rows[2] = actuator(0, 1, encoder=None), actuator(0, 2, potentiometer=None)
    harness = IoHarness(robots=(robot("PSM1", 0, actuators=tuple(rows)),), pids=()).power()
    harness.ask("pot_check", 1)
    for axis in (1, 2):
        harness.port.pot(axis, 0.5)
    harness.run(30)
    assert errors(harness) == []
    harness.port.pot(3, 0.5)
    harness.run(30)
    assert errors(harness) == [("potentiometer", 3)]


def test_each_enable_holds_where_the_robot_is_beyond_its_limits_too() -> None:
    harness = IoHarness().control()
    harness.ask("enforce_limits", 1)
    harness.send(1, position=0.1)
    harness.run(2)
    harness.ask("pid_enable", 0)
    harness.send(0)
    for axis in range(7):
        harness.port.place(axis, 1.7)
    harness.run(2)
    harness.ask("pid_enable", 1)
    harness.run(2)
    np.testing.assert_allclose(harness.record.setpoint_position, 1.7, atol=1e-5)
    assert not harness.record.at_limit.any()
