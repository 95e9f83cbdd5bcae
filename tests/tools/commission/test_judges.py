"""What stages make of what they see, on samples with something wrong in them."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from tests.tools.commission.harness import RigBench
from trocar.tools.commission import axis, home, move, power, read, scan, stop
from trocar.tools.commission.bench import CommandOutcome
from trocar.tools.commission.subject import Subject
from trocar.tools.commission.window import Window
from trocar.tools.inspect.bus_client import FoundBoard


@pytest.fixture(scope="module")
def bench() -> RigBench:
    return RigBench("demo.yaml", sets=["io.period_s=0.004"])


@pytest.fixture
def psm(bench: RigBench) -> Subject:
    return bench.subjects[0]


@pytest.fixture
def window(bench: RigBench) -> Window:
    """Half a second, which a test may change."""
    return bench.sample("IO1", 0.5)


# -- scan --------------------------------------------------------------------------------------------------------------


def _board(number: int, **changes) -> FoundBoard:
    values = {"board": number, "node": number, "hardware": "QLA1", "firmware": 8, "fpga": 2, "description": 0,
              "is_hub": False}
    return FoundBoard(**(values | changes))


@pytest.mark.parametrize(("boards", "says"), [
    ([_board(6)], "PSM1, board 7 on IO1 (udp:127.0.0.16): it is missing; found are 6; allowed: board 7"),
    ([_board(6), _board(7), _board(7, node=3)], "2 boards have this number; allowed: one; set every rotary switch"),
    ([_board(6), _board(7, hardware="DQLA")], "board 7 on IO1 (udp:127.0.0.16): it is a DQLA; allowed: QLA1"),
    ([_board(6), _board(7, firmware=5)], "firmware Rev 5; allowed: Rev 7, 8, 9, 10; update its firmware"),
])
def test_boards_that_are_missing_double_or_others_are_named(bench: RigBench, boards, says: str) -> None:
    io = dataclasses.replace(bench.document.io("IO1"), port="udp:127.0.0.16")
    assert scan.judge(io, [_board(6), _board(7)]) == []
    (found,) = scan.judge(io, boards)
    assert says in str(found)


def test_boards_that_only_have_buttons_are_looked_for_too(bench: RigBench) -> None:
    io = bench.document.io("IO1")
    pedal = dataclasses.replace(io.digital_inputs[0], name="coag", board_id=3)
    with_pedal = dataclasses.replace(io, digital_inputs=(*io.digital_inputs, pedal))
    assert scan.boards_of(with_pedal) == {3: "coag", 6: "PSM1", 7: "PSM1"}


# -- read, power, axis -------------------------------------------------------------------------------------------------


def test_bad_samples_and_slow_loops_are_told(window: Window) -> None:
    assert read.judge_samples("IO1", window, 0.004) == []
    window.fields["valid"][:25] = False
    assert "80.0 % of its samples are good; allowed: 99 %" in str(read.judge_samples("IO1", window, 0.004)[0])
    assert "250 samples a second; allowed: 500" in str(read.judge_samples("IO1", window, 0.002)[-1])


def test_an_amplifier_that_nobody_asked_for_stops(window: Window, psm: Subject) -> None:
    window.fields["amp_on"][-1, 3] = True
    assert "PSM1 axis 3 (disc_1), board 6: its amplifier is on" in str(read.judge_rest(window, psm)[0])
    assert "PSM1 axis 3 (disc_1), board 6: its amplifier is on" in str(power.judge(window, window, psm)[0])


def test_a_supply_that_stays_on_stops(window: Window, psm: Subject) -> None:
    window.fields["powered"][:] = True
    assert "stays on after power_off" in str(power.judge(window, window, psm)[0])


def test_an_encoder_that_another_axis_moves_has_its_plug(window: Window, psm: Subject) -> None:
    window.fields["position"][:, 1] = np.linspace(0.0, 0.2, len(window))
    assert "stands still, and PSM1 axis 1 (pitch) moved by 0.200" in str(read.judge_hand(window, psm, 0, 0.15)[0])
    window.fields["pot_position"][:, 2] = np.linspace(0.0, 0.05, len(window))
    window.fields["position"][:, 1] = 0.0
    assert "its encoder stands still, its potentiometer moved" in str(read.judge_hand(window, psm, 2, 0.02)[0])


def _drive(moved: float = 0.035, pot: float | None = None, **changes) -> axis.Drive:
    moves, pots = np.zeros(7), np.zeros(7)
    moves[0], pots[0] = moved, moved if pot is None else pot
    return dataclasses.replace(axis.Drive(CommandOutcome("done", ""), moves, pots, 0.5, 1.0), **changes)


@pytest.mark.parametrize(("up", "down", "says"), [
    (_drive(), _drive(0.0), "moves in the positive direction only"),
    (_drive(), _drive(0.03), "for currents both ways; allowed: there and back; something else moves it"),
    (_drive(measured=0.02), _drive(-0.035), "0.02 A measured for each A requested"),
    (_drive(), _drive(0.02, measured=math.nan), "moved by +0.0200 rad and needed no current for it; allowed: at rest"),
    (_drive(pot=-0.035), _drive(-0.035, 0.035), "the sign of voltage_to_position is wrong"),
    (_drive(answer=CommandOutcome("failed", "power went off")), _drive(-0.035),
     "driving it failed: power went off"),
])
def test_an_axis_that_does_not_do_as_told_is_told(up: axis.Drive, down: axis.Drive, says: str, psm: Subject) -> None:
    assert axis.judge(_drive(), _drive(-0.035), psm, 0) == []
    (found,) = axis.judge(up, down, psm, 0)
    assert "PSM1 axis 0 (yaw), board 6" in str(found)
    assert says in str(found)
    assert "nan" not in str(found)


def test_a_brake_that_slips_stops(psm: Subject) -> None:
    assert axis.judge_brake(_drive(0.002), psm, 0) == []
    assert "its brake slips: +0.0200 rad with 0.50 A; allowed: 0.0070 rad" in str(
        axis.judge_brake(_drive(0.02), psm, 0)[0])


# -- stop --------------------------------------------------------------------------------------------------------------


def _stopped(window: Window, chain: int, amps: int) -> Window:
    """The safety chain opens at sample `chain`, the last amplifier goes off at `amps`."""
    window.fields["powered"][:], window.fields["relay"][:] = True, True
    window.fields["powered"][chain:], window.fields["relay"][chain:] = False, False
    window.fields["amp_on"][:], window.fields["amp_on"][amps:] = True, False
    return window


def test_the_time_of_an_emergency_stop_is_measured(window: Window, psm: Subject) -> None:
    assert stop.stop_s(_stopped(window, 50, 55), psm) == pytest.approx(0.020, abs=1e-6)
    assert stop.judge_stop(window, psm) == []
    assert "its amplifiers went off 0.160 s after the safety chain; allowed: 0.1 s" in str(
        stop.judge_stop(_stopped(window, 50, 90), psm)[0])


@pytest.mark.parametrize(("chain", "amps", "says"), [
    (999, 999, "PSM1 axis 0 (yaw), board 6: its amplifier is still on after the emergency stop"),
    (999, 50, "the motor supply is still good after the emergency stop; allowed: gone; is the stop wired"),
])
def test_an_emergency_stop_that_does_nothing_is_told(window: Window, psm: Subject, chain: int, amps: int,
                                                     says: str) -> None:
    assert says in str(stop.judge_stop(_stopped(window, chain, amps), psm)[0])


def test_amplifiers_that_come_back_by_themselves_are_told(window: Window, psm: Subject) -> None:
    assert stop.judge_stays_off(window, psm) == []
    window.fields["amp_on"][10, 5] = True
    assert "PSM1 axis 5 (disc_3), board 7: its amplifier came on by itself" in str(stop.judge_stays_off(window, psm)[0])


def test_boards_that_do_not_cut_by_themselves_are_named(bench: RigBench) -> None:
    io = bench.document.io("IO1")
    assert stop.judge_silence(io, (6, 7), stop.Silence({6: 0.031, 7: 0.032}, ())) == []
    reported = [str(each) for each in stop.judge_silence(io, (6, 7), stop.Silence({6: 0.031}, ((7, 2),)))]
    assert "IO1, board 7: its watchdog did not act within 0.08 s; allowed: 0.03 s" in reported[0]
    assert "IO1, board 7 axis 2: its amplifier stayed on without a host" in reported[1]
    (late,) = stop.judge_silence(io, (6, 7), stop.Silence({6: 0.031, 7: 3.0}, ()))
    assert "IO1, board 7: its watchdog was not confirmed to act within 3.00 s; allowed: 0.03 s" in str(late)
    off = dataclasses.replace(io, watchdog_s=0.0)
    assert "its watchdog is switched off" in str(stop.judge_silence(off, (6, 7), stop.Silence({}, ()))[0])


# -- home, move --------------------------------------------------------------------------------------------------------


def test_sensors_that_disagree_at_home_are_told(window: Window, psm: Subject) -> None:
    for field in ("limits_enforced", "tracking_check"):
        window.fields[field][:] = True
    window.fields["position"][:] = window.fields["pot_position"]
    assert home.judge(window, psm) == []
    window.fields["pot_position"][:, 1] += 0.2
    assert "PSM1 axis 1 (pitch), board 6: its potentiometer is +0.2000 rad off its encoder at home" in str(
        home.judge(window, psm)[0])
    window.fields["limits_enforced"][:] = False
    assert "position limits: off" in str(home.judge(window, psm)[-1])


def test_a_master_has_no_check_of_tracking_errors_at_home(window: Window, psm: Subject) -> None:
    window.fields["limits_enforced"][:] = True
    window.fields["position"][:] = window.fields["pot_position"]
    assert "the check of tracking errors: off" in str(home.judge(window, psm)[0])
    assert home.judge(window, dataclasses.replace(psm, kind="MTM")) == []


def test_a_joint_that_does_not_follow_or_arrive_is_told(window: Window, psm: Subject) -> None:
    assert move.judge_tracking(window, psm) == []
    window.fields["position_error"][20, 0] = 0.3
    assert "PSM1 axis 0 (yaw), board 6: tracking error 0.3000 rad in a slow move; allowed: 0.1500 rad" in str(
        move.judge_tracking(window, psm)[0])
    goal = np.zeros(6)
    assert move.judge_arrival(psm, goal, goal, ["yaw", "pitch", "insertion"]) == []
    soft = dataclasses.replace(psm, deadband=(0.0, 0.0, 0.004, 0.0, 0.0, 0.0, 0.0))  # a gap that its gains leave
    assert move.judge_arrival(soft, goal, goal + (0, 0, 0.005, 0, 0, 0), ["yaw", "pitch", "insertion"]) == []
    assert "PSM1 insertion: 0.0050 m instead of 0.0000" in str(
        move.judge_arrival(psm, goal, goal + (0, 0, 0.005, 0, 0, 0), ["yaw", "pitch", "insertion"])[0])


def test_a_joint_beyond_its_limit_is_told() -> None:
    assert move.judge_limit("PSM1 yaw", 0.01, 1.5, False) == []
    assert "PSM1 yaw: 0.0500 rad beyond its limit; allowed: 1.5000 rad" in str(
        move.judge_limit("PSM1 yaw", 0.05, 1.5, False)[0])
