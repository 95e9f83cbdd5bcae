"""Following error and latency from records: of made-up stamps and poses."""

from __future__ import annotations

import math

import numpy as np
import pytest

from trocar.tools.bench.teleop import EVERY_S, MAX_NS, NUDGE_RAD, PART, STEP_NS, edges, fault_handler
from trocar.tools.examples.hand import figure_eight
from trocar.tools.inspect.tracing import STEP_NS as OUT_NS
from trocar.tools.inspect.tracing import IoTrace, errors, in_force, latencies
from trocar.tools.verbs.demo import MOST, too_much

PERIOD = 666_667


def io_cycles(count: int) -> IoTrace:
    begin = np.arange(1, count + 1) * PERIOD
    return IoTrace(begin, begin + 200_000, begin + 300_000)


def test_latency_is_from_read_request_to_the_write_with_its_set_point() -> None:
    io = io_cycles(20)
    arms = io.written + 20_000  # cycles of master and slave
    sent = arms[3] + 200_000  # the slave's next cycle has it, io's cycle after that writes it
    late = latencies(np.array([arms[3]]), np.array([sent]), arms, io)
    assert late.tolist() == [io.written[5] - io.read[3]]


def test_goal_sent_while_the_slave_begins_counts_for_its_next_cycle() -> None:
    io = io_cycles(20)
    arms = io.written + 20_000
    late = latencies(np.array([arms[3]]), np.array([arms[4] - OUT_NS // 2]), arms, io)
    assert late.tolist() == [io.written[6] - io.read[3]]


def test_goals_whose_way_is_not_recorded_are_left_out() -> None:
    io = io_cycles(5)
    arms = io.written + 20_000
    assert latencies(np.array([0, arms[3]]), np.array([arms[0], arms[4]]), arms, io).size == 0


def test_error_is_against_the_last_goal_sent() -> None:
    goals = np.array([[0, 0, 0, 0, 0, 0, 1.0], [0.01, 0, 0, 0, 0, math.sin(0.05), math.cos(0.05)]])
    measured = np.array([[9.0, 0, 0, 0, 0, 0, 1], [0.001, 0, 0, 0, 0, 0, 1], [0.01, 0, 0, 0, 0, 0, 1]])
    distance, angle = errors(np.array([5, 15, 25]), measured, np.array([10, 20]), goals)
    assert distance == pytest.approx([0.001, 0.0]) and angle == pytest.approx([0.0, 0.1])


def test_what_a_slave_does_while_it_does_not_follow_is_no_following_error() -> None:
    follows = np.array([True, False, True])
    assert in_force(np.array([5, 10, 15, 20, 25, 30]), np.array([10, 20, 30]), follows).tolist() == [
        False, True, True, False, False, True]
    assert not in_force(np.array([5]), np.array([], dtype=np.int64), np.array([], dtype=bool)).any()


def test_reaction_is_found_behind_each_nudge() -> None:
    boards = np.arange(300) * STEP_NS
    place = np.zeros(300)
    place[50:] += NUDGE_RAD
    place[110:] -= NUDGE_RAD
    nudges = edges(boards, place)
    assert nudges.tolist() == [round((at + PART) * STEP_NS) for at in (50, 110)]
    stamps = np.arange(1, 440) * PERIOD
    setpoints = np.zeros((439, 3))
    for sign, nudge, late in ((1.0, nudges[0], 2_000_000), (-1.0, nudges[1], 4_000_000)):
        setpoints[stamps >= nudge + late, 1] += sign * 1e-4
    found = fault_handler(nudges, stamps, setpoints)
    assert found == pytest.approx([2_000_000, 4_000_000], abs=PERIOD)


def test_slave_that_moves_anyway_tells_nothing() -> None:
    stamps = np.arange(1, 440) * PERIOD
    setpoints = np.outer(np.arange(439) * 1e-4, np.ones(3))
    assert fault_handler(np.array([50 * STEP_NS]), stamps, setpoints).size == 0


def test_nudges_do_not_run_into_each_other() -> None:
    assert min(EVERY_S) * 1e9 > MAX_NS


def test_figure_eight_closes_and_stays_within_its_size() -> None:
    points = np.array([figure_eight(angle, 0.04) for angle in np.linspace(0.0, 2 * math.pi, 200)])
    assert np.allclose(points[0], points[-1]) and np.abs(points[:, 0]).max() == pytest.approx(0.04, rel=1e-3)
    assert np.abs(points[:, 1]).max() == pytest.approx(0.02, rel=1e-3) and not points[:, 2].any()


def test_figures_that_are_not_good_are_told() -> None:
    good = {name: most / 2 for name, most in MOST.items()}
    assert too_much(good) == []
    assert too_much({**good, "error_mm_rms": 3.0}) == ["following error (rms) 3.00 mm, allowed 2"]
    assert too_much({**good, "latency_ms_p99": math.nan}) == ["latency (p99) – ms, allowed 20"]
