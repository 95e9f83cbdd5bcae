"""A board that has left the bus: its robots alone are switched off, the others do not notice."""

from __future__ import annotations

import numpy as np
import pytest

from tests.io.harness import PERIOD_NS, Stand


@pytest.fixture
def stand() -> Stand:
    """PSM1 on boards 0 and 1, PSM2 on boards 2 and 3; both are controlled."""
    stand = Stand(2)
    for place, robot in enumerate(("PSM1", "PSM2")):
        stand.control(robot)
        stand.send(1, place, position=0.1)
    stand.run(5)
    assert stand.record.pid_enabled.all() and stand.codes == []
    return stand


def leave(stand: Stand, board: int, cycles: int = 1) -> None:
    stand.port.away[board] = True
    stand.run(cycles)


def test_a_board_that_is_away_is_blamed_alone_and_only_its_robot_is_switched_off(stand: Stand) -> None:
    leave(stand, 3)
    (error,) = (e for e in stand.core.reports.events if e.kind == "error")
    assert (error.code, error.component, error.board) == ("board-away", "PSM2", 3)
    assert error.text.startswith("PSM2, board 3: the controller has left the bus")
    assert stand.record.pid_enabled.tolist() == [True, False] and stand.record.power_wanted.tolist() == [True, False]
    stand.run_s(2.0)
    assert stand.codes == ["board-away"] and stand.record.pid_enabled.tolist() == [True, False]


def test_the_others_lose_no_sample(stand: Stand) -> None:
    leave(stand, 3, 200)
    record = stand.record
    assert record.robot_valid.tolist() == [True, False] and not record.valid and record.bad_reads == 0
    assert record.sample_age_ns[0] < 2 * PERIOD_NS and record.sample_age_ns[1] >= 199 * PERIOD_NS
    assert record.age_ns >= 199 * PERIOD_NS  # of every board: who needs all of them sees it
    stand.port.place(0, 0.05)
    stand.run(2)
    assert record.position[0] == pytest.approx(0.05, abs=1e-3)


def test_the_others_are_homed_and_controlled_meanwhile(stand: Stand) -> None:
    leave(stand, 3, 10)
    assert stand.ask("pid_enable", 0.0).outcome == "done"
    bias = stand.ask("bias_encoders", 10.0)
    stand.run_s(1.0)
    assert bias.outcome == "done" and stand.ask("pid_enable", 1.0).outcome == "done"
    assert stand.ask("pid_enable", 1.0, robot="PSM2").outcome == "refused"
    assert stand.ask("bias_encoders", 10.0, robot="PSM2").outcome == "refused"


def test_a_robot_without_its_board_gets_no_power(stand: Stand) -> None:
    leave(stand, 3, 10)
    command = stand.ask("power_on", robot="PSM2")
    stand.run(3)
    assert stand.codes == ["board-away", "board-away"] and not stand.record.power_wanted[1]
    assert command.outcome in ("failed", "refused", "accepted")
    assert stand.record.pid_enabled[0]


def test_a_board_that_is_back_has_to_be_biased_anew(stand: Stand) -> None:
    leave(stand, 3, 10)
    stand.port.away[3] = False
    stand.run(2)
    record = stand.record
    assert record.valid and record.robot_valid.all() and record.age_ns < 2 * PERIOD_NS
    assert record.biased.tolist() == [True, False]
    assert record.encoder_set[:7].all()
    assert not record.encoder_set[7 + 4 :].any() and record.encoder_set[7 : 7 + 4].all()
    assert any(e.text == "board 3 is back" for e in stand.core.reports.events)
    stand.power("PSM2")
    assert record.amps_on.all() and np.isfinite(record.position).all()
