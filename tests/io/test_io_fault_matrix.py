"""The fault matrix: every fault by what it does to joint controller, brakes, power, latch and events, in which order.

One healthy robot on a stepped clock: powered, held, brakes let go, all checks on. Each row breaks one thing, says after
how many cycles io acts, and what a person sees. Every two of them are also brought about in one cycle: both are told.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest

from procs.codes import FAULTS
from procs.document.system import Brake, Linear
from procs.fpga import blocks, lookup, registers
from procs.io.bias import ATTEMPTS
from tests.io.harness import Stand, actuator, robot

RELEASED_A, ENGAGED_A = 0.1, 0.0
EFFORT = 0.4  # what the robot is asked for, 0.2 A on every actuator
NOWHERE = 4095  # the reading of a digital potentiometer that has no position
BUTTON = np.uint32(1)


def braked(**changes) -> Stand:
    brake = Brake(1, 3, Linear(5242.88, 32768.0), Linear(12.5 / 65536, -6.25), 0.5, 0.4, 0.05, RELEASED_A, ENGAGED_A)
    return Stand(robots=(robot("PSM1", 0, brakes=(brake,), **changes),), period_s=1 / 1024)


def working(stand: Stand, grace_over: bool = True) -> Stand:
    """Power, joint controller, brakes, all checks; then nothing more is told. Power has been on for long, or not."""
    stand.control()
    stand.ask("brake_release")
    stand.ask("tracking_check", 1)
    stand.ask("pot_check", 1)
    stand.send(1, in_effort=True, effort=EFFORT)
    stand.run_s(0.1)
    stand.clock.ns += 4_000_000_000 * grace_over
    stand.run_s(0.05)
    assert stand.codes == [] and stand.record.pid_enabled[0] and stand.record.brakes_released[0]
    assert (stand.record.current_request[:7] == EFFORT / 2).all()
    stand.core.reports.events.clear()
    return stand


def digital() -> Stand:
    """An arm whose potentiometers are a table, as on an Si: reading 2048 is 0, the last reading is nowhere."""
    table = [[(reading - 2048) / 1000 for reading in range(NOWHERE)] + [31.4159]] * 7
    stand = braked(lookup=lookup.pack(table))
    read_pots(stand, 2048)
    return stand


def read_pots(stand: Stand, reading: int, axis: int | None = None) -> None:
    for row, channel in [(a // 4, a % 4) for a in (range(7) if axis is None else [axis])]:
        word = int(stand.port.live[row, blocks.ADC.start + channel]) & 0xFFFF
        stand.port.live[row, blocks.ADC.start + channel] = reading << 16 | word


def status(bits: int) -> Callable[[Stand], None]:
    return lambda stand: stand.port.set_status(bits)


def nan_effort(stand: Stand) -> None:
    stand.arms[0].effort[3] = np.nan


def hot(stand: Stand) -> None:
    stand.port.live[0, blocks.TEMPERATURE] = 60 << 8 | 66 * 2


def overflow(stand: Stand) -> None:
    stand.port.live[0, blocks.POSITION.start + 2] |= np.uint32(registers.ENCODER_OVERFLOW)


def lose_supply(stand: Stand) -> None:
    stand.port.has_supply = False
    stand.port.set_status(registers.STATUS_MV_GOOD, on=False)


def lose_packets(stand: Stand) -> None:
    stand.port.good = False


def cut_amplifier(stand: Stand) -> None:
    stand.port.live[1, blocks.STATUS] |= np.uint32(1 << registers.STATUS_SAFETY_SHIFT + 1)


def kill_amplifier(stand: Stand) -> None:
    stand.port.dead_amps.add((0, 1))
    stand.port.live[0, blocks.STATUS] &= np.uint32(0xFFFFFFFF ^ (1 << registers.STATUS_AMP_ON_SHIFT + 1))


def heal(stand: Stand) -> None:
    """What a person does: the cause is removed."""
    port = stand.port
    port.good = port.has_supply = True
    port.dead_amps.clear()
    port.set_status(registers.STATUS_WATCHDOG | registers.STATUS_MV_FAULT | 0xF << registers.STATUS_SAFETY_SHIFT,
                    on=False)
    port.live[:, blocks.TEMPERATURE] = 60 << 8 | 60
    port.live[:, blocks.POSITION] = 0x800000
    for axis in range(7):
        port.current(axis, 0.0)
        port.pot(axis, 0.0)
    if stand.io.robots[0].lookup:
        read_pots(stand, 2048)
    stand.arms[0].effort[...] = EFFORT


@dataclass(frozen=True)
class Row:
    """One fault: what breaks, the cycle in which io acts, and what is told of it."""

    name: str
    breaks: Callable[[Stand], None]
    cycle: int
    code: str
    axis: int = -1
    powered: bool = False  # still, afterwards
    relay: bool = True  # still closed
    before: tuple[str, ...] = ()  # events ahead of the error
    after: tuple[str, ...] = ("power off",)
    needs_bias: bool = False
    made: Callable[[], Stand] = braked

    def __str__(self) -> str:
        return self.name


ROWS = (
    Row("bad-packets", lose_packets, 31, "bad-reads", before=("read-missed",)),
    Row("nan-effort", nan_effort, 1, "not-finite", 3, powered=True, after=()),
    Row("over-current", lambda stand: stand.port.current(4, 1.3), 101, "current", 4),
    Row("board-cut-off", cut_amplifier, 1, "safety-amp-disable", 5),
    Row("over-65-degrees", hot, 1, "temperature", 2),
    Row("pot-off", lambda stand: stand.port.pot(6, 0.06), 11, "potentiometer", 6),
    Row("encoder-overflow", overflow, 1, "encoder-overflow", 2, needs_bias=True),
    Row("watchdog", status(registers.STATUS_WATCHDOG), 1, "watchdog", before=("power lost",)),
    Row("supply-fault", status(registers.STATUS_MV_FAULT), 1, "power-fault", before=("power lost",)),
    Row("power-loss-after-3-s", lose_supply, 1, "power-lost", before=("power lost",)),
    Row("dead-amplifier", kill_amplifier, 53, "amplifier", 1),
    Row("si-missing-pot", lambda stand: read_pots(stand, NOWHERE, 5), 1, "pot-missing", 5, relay=False, made=digital),
)
NUMBERS = {row.code: row.number for row in FAULTS}


def told(stand: Stand) -> list[str]:
    """Events in their order: codes of warnings and errors, texts of the others."""
    return [event.code or event.text for event in stand.core.reports.events]


def brake_a(stand: Stand) -> float:
    return round((int(stand.port.sent[-1][1, 3] & 0xFFFF) - 32768.0) / 5242.88, 3)


def is_off(stand: Stand) -> bool:
    """Whether the last write asks for motor power off, amplifiers disabled and no current on every board."""
    sent = stand.port.sent[-1]
    power = (sent[:, 4] & 0x000C0000 == registers.CONTROL_POWER_OFF).all()
    return bool(power and (sent[:, :4] & 0x3000FFFF == 0x20008000).all())


def zero_current(stand: Stand) -> bool:
    return bool((stand.currents[:7] == 0x8000).all())


@pytest.mark.parametrize("row", ROWS, ids=str)
def test_nothing_happens_before_its_cycle(row: Row) -> None:
    stand = working(row.made())
    row.breaks(stand)
    stand.run(row.cycle - 1)
    assert stand.codes == [] and stand.record.pid_enabled[0] and stand.record.power_wanted[0]
    assert brake_a(stand) == RELEASED_A and stand.record.fault[0] == 0
    assert zero_current(stand) == (row.code == "bad-reads")  # what was worked out from an old sample has faded out


@pytest.mark.parametrize("row", ROWS, ids=str)
def test_in_its_cycle_outputs_go_off_before_anything_is_written(row: Row) -> None:
    stand = working(row.made())
    row.breaks(stand)
    stand.run(row.cycle)
    assert not stand.record.pid_enabled[0] and zero_current(stand)
    assert brake_a(stand) == ENGAGED_A and not stand.record.brakes_released[0]
    assert stand.record.power_wanted[0] == stand.record.amp_enabled.all() == row.powered
    assert is_off(stand) != row.powered
    opened = stand.port.sent[-1][:, 4] & registers.CONTROL_RELAY_MASK == registers.CONTROL_RELAY_OFF
    assert opened.all() != row.relay
    assert stand.record.fault[0] == NUMBERS[row.code]


@pytest.mark.parametrize("row", ROWS, ids=str)
def test_it_is_told_once_with_its_axis_and_in_order(row: Row) -> None:
    stand = working(row.made())
    row.breaks(stand)
    stand.run(row.cycle)
    assert told(stand) == [*row.before, row.code, *row.after]
    event = next(e for e in stand.core.reports.events if e.code == row.code)
    assert (event.component, event.axis, event.kind) == ("PSM1", row.axis, "error")
    stand.run(1000)
    assert stand.codes == [row.code]


@pytest.mark.parametrize("row", ROWS, ids=str)
def test_a_person_brings_it_back(row: Row) -> None:
    stand = working(row.made())
    row.breaks(stand)
    stand.run(row.cycle + 500)
    assert stand.ask("pid_enable", 1).outcome == "refused", "the fault is latched"
    heal(stand)
    stand.run(2)
    assert stand.ask("pid_enable", 1).outcome == "refused", "and stays so by itself"
    stand.core.reports.events.clear()
    stand.ask("power_off")
    stand.power()
    if row.needs_bias:
        assert not stand.record.biased[0]
        command = stand.ask("bias_encoders", 10)
        stand.run(10 + 4 * ATTEMPTS)
        assert command.outcome == "done"
    working(stand)
    assert stand.record.fault[0] == 0


@pytest.mark.slow
@pytest.mark.parametrize("row", ROWS, ids=str)
def test_it_is_told_again_after_power_was_asked_for_in_vain(row: Row) -> None:
    """Except where io or the boards have put it right by then, and where only the joint controller makes it."""
    stand = working(row.made())
    row.breaks(stand)
    stand.run(row.cycle + 500)
    stand.core.reports.events.clear()
    stand.ask("power_off")
    command = stand.ask("power_on")
    stand.run_s(3.1)
    if row.code in ("not-finite", "encoder-overflow", "watchdog"):
        assert command.outcome == "done" and stand.codes == []
        return
    late = {"power-lost": "power-timeout"}
    assert stand.codes == [late.get(row.code, row.code)]
    assert not stand.record.power_wanted[0] and is_off(stand)


@pytest.mark.parametrize("row", ROWS, ids=str)
def test_power_and_controller_asked_for_in_its_cycle_are_refused_or_undone(row: Row) -> None:
    stand = working(row.made())
    row.breaks(stand)
    stand.run(row.cycle - 1)
    stand.ask("power_on")
    assert stand.record.power_wanted[0] == row.powered and not stand.record.pid_enabled[0]
    assert stand.record.fault[0] == NUMBERS[row.code]


@pytest.mark.parametrize("row", [row for row in ROWS if not row.powered], ids=str)
def test_a_command_that_its_cycle_undoes_fails_with_the_reason(row: Row) -> None:
    stand = working(row.made())
    row.breaks(stand)
    stand.run(row.cycle - 1)
    command = stand.ask("power_on")
    assert command.outcome == "failed"
    assert command.answers[-1][1].startswith(next(f.cause for f in FAULTS if f.code == row.code))


@pytest.mark.parametrize("row", [row for row in ROWS if row.code != "bad-reads"], ids=str)
def test_a_button_in_its_cycle_is_told(row: Row) -> None:
    stand = working(row.made())
    row.breaks(stand)
    stand.run(row.cycle - 1)
    stand.port.live[0, blocks.DIGITAL_INPUT] |= BUTTON
    stand.run(1)
    assert told(stand) == [*row.before, row.code, *row.after, "pressed"]
    assert stand.record.input[0] and stand.record.valid


PAIRS = [(a, b) for a, b in itertools.combinations(ROWS, 2) if "bad-reads" not in (a.code, b.code)
         and not (a.code == "potentiometer" and b.code == "pot-missing")]


@pytest.mark.slow
@pytest.mark.parametrize(("one", "other"), PAIRS, ids=str)
def test_two_faults_of_one_cycle_are_both_told_and_the_stronger_acts(one: Row, other: Row) -> None:
    made = digital if digital in (one.made, other.made) else braked
    if made is digital and "potentiometer" in (one.code, other.code):
        pytest.skip("another kind of potentiometer")
    stand = working(made())
    first, second = sorted((one, other), key=lambda row: -row.cycle)
    first.breaks(stand)
    stand.run(first.cycle - second.cycle)
    second.breaks(stand)
    stand.run(second.cycle - 1)
    assert stand.codes == []
    stand.run(1)
    hidden = {frozenset(("amplifier", other)) for other in ("watchdog", "power-fault", "power-lost")}
    codes = {one.code, other.code}
    if frozenset(codes) in hidden:  # amplifiers go off with what cut them; the cause is told
        codes.discard("amplifier")
    assert sorted(stand.codes) == sorted(codes)
    assert stand.record.fault[0] == NUMBERS[stand.codes[0]]
    assert not stand.record.pid_enabled[0] and zero_current(stand) and brake_a(stand) == ENGAGED_A
    assert stand.record.power_wanted[0] == (one.powered and other.powered)
    opened = stand.port.sent[-1][:, 4] & registers.CONTROL_RELAY_MASK == registers.CONTROL_RELAY_OFF
    assert opened.all() == (not (one.relay and other.relay))
    told_before = told(stand)
    stand.run(500)
    assert told(stand)[: len(told_before)] == told_before and sorted(stand.codes) == sorted(codes)


@pytest.mark.parametrize("row", [row for row in ROWS if row.cycle == 1 and row.code != "not-finite"], ids=str)
def test_a_fault_in_the_cycle_of_the_last_bad_packet_is_told_with_the_next_good_one(row: Row) -> None:
    stand = working(row.made())
    lose_packets(stand)
    row.breaks(stand)
    stand.run(20)
    assert stand.codes == [] and stand.record.pid_enabled[0]
    stand.port.good = True
    stand.run(1)
    assert stand.codes == [row.code]


def test_one_bad_packet_changes_nothing_but_a_warning() -> None:
    stand = working(braked())
    before = stand.port.sent[-1].copy()
    lose_packets(stand)
    stand.run(1)
    assert told(stand) == ["read-missed"] and not stand.record.valid
    assert stand.record.pid_enabled[0] and stand.record.power_wanted[0] and brake_a(stand) == RELEASED_A
    np.testing.assert_array_equal(stand.port.sent[-1], before)
    stand.port.good = True
    stand.run(100)
    assert told(stand) == ["read-missed"] and stand.record.valid and stand.record.pid_enabled[0]


def test_ten_thousand_bad_packets_are_one_warning_one_fault_and_one_recovery() -> None:
    stand = working(braked())
    lose_packets(stand)
    sent = len(stand.port.sent)
    stand.run(10_000)
    assert told(stand) == ["read-missed", "bad-reads", "power off"] and not stand.record.valid
    assert len(stand.port.sent) == sent + 10_000 and is_off(stand)
    assert stand.record.bad_reads == 10_000 and stand.record.age_ns == pytest.approx(10_000 * 976_562, rel=1e-3)
    stand.port.good = True
    stand.run(10)
    assert told(stand) == ["read-missed", "bad-reads", "power off", "the controllers answer again"]
    assert stand.record.valid and not stand.record.pid_enabled[0] and not stand.record.power_wanted[0]


def test_power_asked_for_without_packets_fails_at_once() -> None:
    stand = working(braked())
    lose_packets(stand)
    stand.run(2000)
    stand.core.reports.events.clear()
    command = stand.ask("power_on")
    stand.run(1)
    assert command.outcome == "failed" and stand.codes == ["bad-reads"] and is_off(stand)


def test_a_button_pressed_while_packets_are_lost_is_told_with_the_next_good_one() -> None:
    stand = working(braked())
    lose_packets(stand)
    stand.port.live[0, blocks.DIGITAL_INPUT] |= BUTTON
    stand.run(10)
    assert told(stand) == ["read-missed"]
    stand.port.good = True
    stand.run(1)
    assert told(stand) == ["read-missed", "pressed"]


def test_power_loss_before_3_s_waits_for_them_where_nothing_is_held() -> None:
    stand = braked()
    stand.power()
    stand.core.reports.events.clear()
    lose_supply(stand)
    stand.run_s(2.9)
    assert told(stand) == ["power lost"] and stand.record.power_wanted[0]
    stand.run_s(0.2)
    assert told(stand) == ["power lost", "power-lost", "power off"] and is_off(stand)


def test_power_loss_before_3_s_that_ends_in_time_is_told_and_nothing_else() -> None:
    stand = braked()
    stand.power()
    stand.core.reports.events.clear()
    lose_supply(stand)
    stand.run_s(1.0)
    stand.port.has_supply = True
    stand.run_s(2.5)
    assert told(stand)[:2] == ["power lost", "powered"] and stand.codes in ([], ["amplifier"])


def test_power_loss_before_3_s_acts_at_once_where_an_arm_is_held() -> None:
    stand = working(braked(), grace_over=False)
    lose_supply(stand)
    stand.run(1)
    assert told(stand) == ["power lost", "power-lost", "power off"]
    assert not stand.record.pid_enabled[0] and is_off(stand) and brake_a(stand) == ENGAGED_A


@pytest.mark.parametrize("row", [row for row in ROWS if row.code in ("temperature", "potentiometer", "current")],
                         ids=str)
def test_power_lost_in_the_grace_time_and_in_the_cycle_of_a_fault_is_told(row: Row) -> None:
    stand = braked()
    stand.power()
    stand.ask("pot_check", 1)
    stand.core.reports.events.clear()
    row.breaks(stand)
    stand.run(row.cycle - 1)
    lose_supply(stand)
    stand.run(1)
    assert told(stand) == ["power lost", row.code, "power off"]


def test_the_watchdogs_end_is_told_too() -> None:
    stand = working(braked())
    stand.port.set_status(registers.STATUS_WATCHDOG)
    stand.run(2)
    stand.core.reports.events.clear()
    stand.power()
    assert "the watchdog is cleared" in told(stand) and stand.codes == []


def test_faults_of_several_axes_are_all_named() -> None:
    stand = working(braked())
    for axis in (1, 4):
        stand.port.pot(axis, 0.1)
        stand.port.current(axis + 1, 1.3)
    stand.run(101)
    events = [(e.code, e.axis) for e in stand.core.reports.events if e.kind == "error"]
    assert events == [("potentiometer", 1), ("potentiometer", 4), ("current", 2)]
    assert "also axis 5" in next(e.text for e in stand.core.reports.events if e.code == "current")


def test_another_robot_goes_on() -> None:
    stand = Stand(2)
    for name in ("PSM1", "PSM2"):
        stand.control(name)
    stand.send(1, in_effort=True, arm=1, effort=EFFORT)
    stand.run(2)
    hot(stand)
    stand.run(10)
    assert stand.codes == ["temperature"] and stand.record.pid_enabled.tolist() == [False, True]
    assert stand.record.power_wanted.tolist() == [False, True]
    assert (stand.record.current_request[7:] == EFFORT / 2).all()


BAD_NUMBERS = (np.nan, np.inf, -np.inf)


@pytest.mark.parametrize("value", BAD_NUMBERS)
@pytest.mark.parametrize(("in_effort", "name"), [(False, "position"), (False, "velocity"), (False, "feed_forward"),
                                                 (True, "effort"), (True, "feed_forward")])
def test_a_set_point_that_is_no_number_never_becomes_bits(in_effort: bool, name: str, value: float) -> None:
    stand = working(braked())
    stand.send(1, in_effort=in_effort, position=0.0, effort=0.0)
    stand.run(2)
    stand.arms[0].has_velocity[...] = True
    stand.ask("use_setpoint_v", 1)
    getattr(stand.arms[0], name)[4] = value
    sent = len(stand.port.sent)
    stand.run(20)
    assert stand.codes == ["not-finite"] and not stand.record.pid_enabled[0]
    for out in stand.port.sent[sent:]:
        assert (out.reshape(-1)[[0, 1, 2, 3, 5, 6, 7]] & 0xFFFF == 0x8000).all()
    assert np.isfinite(stand.record.current_request).all()


def test_a_set_point_that_is_no_number_is_found_without_packets_too() -> None:
    stand = working(braked())
    lose_packets(stand)
    nan_effort(stand)
    stand.run(1)
    assert sorted(told(stand)) == ["not-finite", "read-missed"] and not stand.record.pid_enabled[0]
    assert zero_current(stand) and stand.record.power_wanted[0] and brake_a(stand) == ENGAGED_A
    stand.run(30)
    assert stand.codes == ["not-finite", "bad-reads"] and is_off(stand)
    assert stand.record.fault[0] == NUMBERS["not-finite"], "the first stays latched"


def test_robots_on_the_same_board_go_down_together_and_the_cause_is_told_first() -> None:
    gripper = robot("gripper", 1, 1, actuators=(actuator(1, 3),))
    stand = Stand(robots=(robot("PSM1", 0), gripper))
    for name in ("PSM1", "gripper"):
        stand.power(name)
    stand.core.reports.events.clear()
    hot(stand)
    stand.run(1)
    events = [(e.code or e.text, e.component) for e in stand.core.reports.events]
    assert events == [("temperature", "PSM1"), ("power off", "PSM1"), ("shared-board", "gripper"),
                      ("power off", "gripper")]
    assert (stand.port.sent[-1][:, 4] & 0x000C0000 == registers.CONTROL_POWER_OFF).all()


def test_a_controller_that_computes_no_number_sends_0_a_and_goes_off() -> None:
    stand = working(braked())
    stand.send(1, position=0.01)
    stand.run(2)
    step = stand.core.pid.step

    def broken(*given):
        found = step(*given)
        if stand.record.pid_enabled[0]:
            stand.core.pid.effort[2] = np.nan
        return found

    stand.core.pid.step = broken  # type: ignore[method-assign]
    stand.run(1)
    assert stand.port.sent[-1][0, 2] & 0xFFFF == 0x8000 and stand.codes == ["not-finite"]
    stand.run(1)
    assert zero_current(stand) and stand.record.power_wanted[0] and brake_a(stand) == ENGAGED_A


def test_numbers_too_large_to_compute_with_stay_within_the_motors_current() -> None:
    stand = working(braked())
    for in_effort, arrays in ((False, {"position": 1e308}), (True, {"effort": -1e308, "feed_forward": -1e308})):
        stand.ask("tracking_check", 0)
        stand.send(1, in_effort=in_effort, **arrays)
        stand.run(5)
        assert (np.abs(stand.record.current_request[:7]) <= 1.0).all()
        assert (np.abs(stand.currents[:7] - 0x8000) <= 5243).all()
