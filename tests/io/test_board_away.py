"""A board that has left the bus: its robots alone are switched off, the others do not notice."""

from __future__ import annotations

import numpy as np
import pytest

from tests.io.harness import PERIOD_NS, IoHarness


@pytest.fixture
def harness() -> IoHarness:
    """PSM1 on boards 0 and 1, PSM2 on boards 2 and 3; both are controlled."""
    harness = IoHarness(2)
    for place, robot in enumerate(("PSM1", "PSM2")):
        harness.control(robot)
        harness.send(1, place, position=0.1)
    harness.run(5)
    assert harness.record.pid_enabled.all() and harness.codes == []
    return harness


def leave(harness: IoHarness, board: int, cycles: int = 1) -> None:
    harness.port.away[board] = True
    harness.run(cycles)


def test_a_board_that_is_away_is_blamed_alone_and_only_its_robot_is_switched_off(harness: IoHarness) -> None:
    leave(harness, 3)
    (error,) = (e for e in harness.core.reports.events if e.kind == "error")
    assert (error.code, error.component, error.board) == ("board-away", "PSM2", 3)
    assert error.text.startswith("PSM2, board 3: the controller has left the bus")
    assert harness.record.pid_enabled.tolist() == [True, False] and harness.record.power_requested.tolist() == [True,
                                                                                                                False]
    harness.run_s(2.0)
    assert harness.codes == ["board-away"] and harness.record.pid_enabled.tolist() == [True, False]


def test_the_others_lose_no_sample(harness: IoHarness) -> None:
    leave(harness, 3, 200)
    record = harness.record
    assert record.robot_valid.tolist() == [True, False] and not record.valid and record.bad_reads == 0
    assert record.sample_age_ns[0] < 2 * PERIOD_NS and record.sample_age_ns[1] >= 199 * PERIOD_NS
    assert record.age_ns >= 199 * PERIOD_NS  # of every board: who needs all of them sees it
    harness.port.place(0, 0.05)
    harness.run(2)
    assert record.position[0] == pytest.approx(0.05, abs=1e-3)


def test_the_others_are_homed_and_controlled_meanwhile(harness: IoHarness) -> None:
    leave(harness, 3, 10)
    assert harness.ask("pid_enable", 0.0).outcome == "done"
    bias = harness.ask("bias_encoders", 10.0)
    harness.run_s(1.0)
    assert bias.outcome == "done" and harness.ask("pid_enable", 1.0).outcome == "done"
    assert harness.ask("pid_enable", 1.0, robot="PSM2").outcome == "refused"
    assert harness.ask("bias_encoders", 10.0, robot="PSM2").outcome == "refused"


def test_a_robot_without_its_board_gets_no_power(harness: IoHarness) -> None:
    leave(harness, 3, 10)
    command = harness.ask("power_on", robot="PSM2")
    harness.run(3)
    assert harness.codes == ["board-away", "board-away"] and not harness.record.power_requested[1]
    assert command.outcome in ("failed", "refused", "accepted")
    assert harness.record.pid_enabled[0]


def test_a_board_that_is_back_has_to_be_biased_anew(harness: IoHarness) -> None:
    leave(harness, 3, 10)
    harness.port.power_cycle(3)
    harness.port.away[3] = False
    harness.run(2)
    record = harness.record
    assert record.valid and record.robot_valid.all() and record.age_ns < 2 * PERIOD_NS
    assert record.biased.tolist() == [True, False]
    assert record.encoder_set[:7].all()
    assert not record.encoder_set[7 + 4 :].any() and record.encoder_set[7 : 7 + 4].all()
    assert any(e.text == "board 3 is back" for e in harness.core.reports.events)
    harness.power("PSM2")
    assert record.amps_on.all() and np.isfinite(record.position).all()
