"""The fault matrix: every fault by what it does to joint controller, brakes, power, latch and events, in which order.

One healthy robot on a stepped clock: powered, held, brakes let go, all checks on. Each row breaks one thing, says after
how many cycles io acts, and what a person sees. Every two of them are also brought about in one cycle: both are told.
"""

from __future__ import annotations

import itertools

import pytest

from tests.cases import cases
from tests.io.fault_rows import (
    BUTTON,
    EFFORT,
    ENGAGED_A,
    NUMBERS,
    RELEASED_A,
    ROWS,
    FaultRow,
    brake_a,
    braked,
    digital,
    heal,
    hot,
    is_off,
    lose_packets,
    lose_supply,
    relays_open,
    reported,
    working,
    zero_current,
)
from tests.io.harness import IoHarness, actuator, robot
from trocar.procs.fpga import blocks, registers
from trocar.procs.io.bias import ATTEMPTS
from trocar.procs.tables.codes import FAULTS


@cases("row", ROWS)
def test_in_its_cycle_outputs_go_off_before_anything_is_written(row: FaultRow) -> None:
    """And not before; a button that is pressed in that cycle is reported all the same."""
    harness = working(row.made())
    row.breaks(harness)
    harness.run(row.cycle - 1)
    assert harness.codes == [] and harness.record.pid_enabled[0] and harness.record.power_requested[0]
    assert brake_a(harness) == RELEASED_A and harness.record.fault[0] == 0
    is_read = row.code != "bad-reads"
    assert zero_current(harness) != is_read  # what was worked out from an old sample has faded out
    harness.port.live[0, blocks.DIGITAL_INPUT] |= BUTTON
    harness.run(1)
    assert not harness.record.pid_enabled[0] and zero_current(harness)
    assert brake_a(harness) == ENGAGED_A and not harness.record.brakes_released[0]
    assert harness.record.power_requested[0] == harness.record.amp_enabled.all() == row.powered
    assert is_off(harness) != row.powered
    assert relays_open(harness) != row.relay
    assert harness.record.fault[0] == NUMBERS[row.code]
    assert reported(harness) == [*row.before, row.code, *row.after, *["pressed"] * is_read]
    assert harness.record.input[0] == harness.record.valid == is_read


@pytest.mark.parametrize("row", ROWS, ids=str)
def test_it_is_told_once_with_its_axis_and_in_order(row: FaultRow) -> None:
    """Until an operator powers the robot again after the cause was removed."""
    harness = working(row.made())
    row.breaks(harness)
    harness.run(row.cycle)
    assert reported(harness) == [*row.before, row.code, *row.after]
    event = next(e for e in harness.core.reports.events if e.code == row.code)
    assert (event.component, event.axis, event.kind) == ("PSM1", row.axis, "error")
    harness.run(200)
    assert harness.codes == [row.code]
    assert harness.ask("pid_enable", 1).outcome == "refused", "the fault is latched"
    heal(harness)
    harness.run(2)
    assert harness.ask("pid_enable", 1).outcome == "refused", "and stays so by itself"
    harness.core.reports.events.clear()
    harness.ask("power_off")
    harness.power()
    if row.needs_bias:
        assert not harness.record.biased[0]
        command = harness.ask("bias_encoders", 10)
        harness.run(10 + 4 * ATTEMPTS)
        assert command.outcome == "done"
    working(harness)
    assert harness.record.fault[0] == 0


@pytest.mark.parametrize("row", ROWS, ids=str)
def test_it_is_told_again_after_power_was_asked_for_in_vain(row: FaultRow) -> None:
    """Except where io or the boards have put it right by then, and where only the joint controller makes it."""
    harness = working(row.made())
    row.breaks(harness)
    harness.run(row.cycle + 50)
    harness.core.reports.events.clear()
    harness.ask("power_off")
    command = harness.ask("power_on")
    harness.run_s(0.15)
    harness.pass_s(3.0)
    harness.run_s(0.1)
    if row.code in ("not-finite", "encoder-overflow", "watchdog"):
        assert command.outcome == "done" and harness.codes == []
        return
    late = {"power-lost": "power-timeout"}
    assert harness.codes == [late.get(row.code, row.code)]
    assert not harness.record.power_requested[0] and is_off(harness)


@cases("row", ROWS)
def test_power_asked_for_in_its_cycle_is_undone_with_the_reason(row: FaultRow) -> None:
    harness = working(row.made())
    row.breaks(harness)
    harness.run(row.cycle - 1)
    command = harness.ask("power_on")
    assert harness.record.power_requested[0] == row.powered and not harness.record.pid_enabled[0]
    assert harness.record.fault[0] == NUMBERS[row.code]
    assert row.powered or command.outcome == "failed"
    cause = next(fault.cause for fault in FAULTS if fault.code == row.code)
    assert row.powered or command.answers[-1][1].startswith(cause)


PAIRS = [(a, b) for a, b in itertools.combinations(ROWS, 2) if "bad-reads" not in (a.code, b.code)
         and not (a.code == "potentiometer" and b.code == "pot-missing")]


@pytest.mark.slow
@pytest.mark.parametrize(("one", "other"), PAIRS, ids=str)
def test_two_faults_of_one_cycle_are_both_told_and_the_stronger_acts(one: FaultRow, other: FaultRow) -> None:
    made = digital if digital in (one.made, other.made) else braked
    if made is digital and "potentiometer" in (one.code, other.code):
        pytest.skip("another kind of potentiometer")
    harness = working(made())
    first, second = sorted((one, other), key=lambda row: -row.cycle)
    first.breaks(harness)
    harness.run(first.cycle - second.cycle)
    second.breaks(harness)
    harness.run(second.cycle - 1)
    assert harness.codes == []
    harness.run(1)
    hidden = {frozenset(("amplifier", other)) for other in ("watchdog", "power-fault", "power-lost")}
    codes = {one.code, other.code}
    if frozenset(codes) in hidden:  # amplifiers go off with what cut them; the cause is told
        codes.discard("amplifier")
    assert sorted(harness.codes) == sorted(codes)
    assert harness.record.fault[0] == NUMBERS[harness.codes[0]]
    assert not harness.record.pid_enabled[0] and zero_current(harness) and brake_a(harness) == ENGAGED_A
    assert harness.record.power_requested[0] == (one.powered and other.powered)
    assert relays_open(harness) != (one.relay and other.relay)
    reported_before = reported(harness)
    harness.run(100)
    assert reported(harness)[: len(reported_before)] == reported_before and sorted(harness.codes) == sorted(codes)


@cases("row", [row for row in ROWS if row.cycle == 1 and row.code != "not-finite"])
def test_a_fault_in_the_cycle_of_the_last_bad_packet_is_told_with_the_next_good_one(row: FaultRow) -> None:
    harness = working(row.made())
    lose_packets(harness)
    row.breaks(harness)
    harness.run(20)
    assert harness.codes == [] and harness.record.pid_enabled[0]
    harness.port.good = True
    harness.run(1)
    assert harness.codes == [row.code]


def test_power_loss_before_3_s_waits_for_them_where_nothing_is_held() -> None:
    harness = braked().power()
    harness.core.reports.events.clear()
    lose_supply(harness)
    harness.run_s(0.1)
    harness.pass_s(2.8)
    harness.run(2)
    assert reported(harness) == ["power lost"] and harness.record.power_requested[0]
    harness.run_s(0.1)
    assert reported(harness) == ["power lost", "power-lost", "power off"] and is_off(harness)


def test_power_loss_before_3_s_that_ends_in_time_is_told_and_nothing_else() -> None:
    harness = braked().power()
    harness.core.reports.events.clear()
    lose_supply(harness)
    harness.run_s(0.1)
    harness.port.has_supply = True
    harness.run_s(0.1)
    harness.pass_s(3.0)
    harness.run_s(0.1)
    assert reported(harness)[:2] == ["power lost", "powered"] and harness.codes in ([], ["amplifier"])


def test_power_loss_before_3_s_acts_at_once_where_an_arm_is_held() -> None:
    harness = working(braked(), grace_over=False)
    lose_supply(harness)
    harness.run(1)
    assert reported(harness) == ["power lost", "power-lost", "power off"]
    assert not harness.record.pid_enabled[0] and is_off(harness) and brake_a(harness) == ENGAGED_A


@pytest.mark.parametrize("row", [row for row in ROWS if row.code in ("temperature", "potentiometer", "current")],
                         ids=str)
def test_power_lost_in_the_grace_time_and_in_the_cycle_of_a_fault_is_told(row: FaultRow) -> None:
    harness = braked().power()
    harness.ask("pot_check", 1)
    harness.core.reports.events.clear()
    row.breaks(harness)
    harness.run(row.cycle - 1)
    lose_supply(harness)
    harness.run(1)
    assert reported(harness) == ["power lost", row.code, "power off"]


def test_the_watchdogs_end_is_told_too() -> None:
    harness = working(braked())
    harness.port.set_status(registers.STATUS_WATCHDOG)
    harness.run(2)
    harness.core.reports.events.clear()
    harness.power()
    assert "the watchdog is cleared" in reported(harness) and harness.codes == []


def test_faults_of_several_axes_are_all_named() -> None:
    harness = working(braked())
    for axis in (1, 4):
        harness.port.pot(axis, 0.1)
        harness.port.current(axis + 1, 1.3)
    harness.run(101)
    events = [(e.code, e.axis) for e in harness.core.reports.events if e.kind == "error"]
    assert events == [("potentiometer", 1), ("potentiometer", 4), ("current", 2)]
    assert "also axis 5" in next(e.text for e in harness.core.reports.events if e.code == "current")


def test_another_robot_keeps_running() -> None:
    harness = IoHarness(2)
    for name in ("PSM1", "PSM2"):
        harness.control(name)
    harness.send(1, in_effort=True, arm=1, effort=EFFORT)
    harness.run(2)
    hot(harness)
    harness.run(10)
    assert harness.codes == ["temperature"] and harness.record.pid_enabled.tolist() == [False, True]
    assert harness.record.power_requested.tolist() == [False, True]
    assert (harness.record.current_request[7:] == EFFORT / 2).all()


def test_robots_on_the_same_board_go_down_together_and_the_cause_is_told_first() -> None:
    gripper = robot("gripper", 1, 1, actuators=(actuator(1, 3),))
    harness = IoHarness(robots=(robot("PSM1", 0), gripper))
    for name in ("PSM1", "gripper"):
        harness.power(name)
    harness.core.reports.events.clear()
    hot(harness)
    harness.run(1)
    events = [(e.code or e.text, e.component) for e in harness.core.reports.events]
    assert events == [("temperature", "PSM1"), ("power off", "PSM1"), ("shared-board", "gripper"),
                      ("power off", "gripper")]
    assert (harness.port.sent[-1][:, 4] & 0x000C0000 == registers.CONTROL_POWER_OFF).all()
