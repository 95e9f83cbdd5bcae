"""Brakes: the sequence of their currents, on a clock with a period that floats add up exactly."""

from __future__ import annotations

import numpy as np
import pytest

from procs.document.system import Brake, Linear
from tests.io.harness import Stand, robot

TIMES = (0.5, 0.25)


def brake(axis: int, release_s: float) -> Brake:
    return Brake(1, axis, Linear(5242.88, 32768.0), Linear(12.5 / 65536, -6.25), 0.5, 0.4, release_s, 0.1, 0.02)


@pytest.fixture
def stand() -> Stand:
    """Seven actuators on boards 0 and 1; the last channel of board 1 and board 2 hold brakes."""
    first, second = brake(3, TIMES[0]), Brake(2, 0, Linear(5242.88, 32768.0), Linear(12.5 / 65536, -6.25), 0.3, 0.4,
                                              TIMES[1], 0.1, 0.02)
    made = Stand(robots=(robot("PSM1", 0, brakes=(first, second)),), period_s=1 / 1024)
    made.control()
    return made


def currents(stand: Stand) -> list[float]:
    """Of the two brakes, as they were sent."""
    out = stand.port.sent[-1]
    return [round((int(out[row, axis] & 0xFFFF) - 32768.0) / 5242.88, 3) for row, axis in ((1, 3), (2, 0))]


def test_brakes_hold_until_they_are_released_and_their_amplifiers_are_the_robots(stand: Stand) -> None:
    assert currents(stand) == [0.02, 0.02]
    assert stand.record.amps_on[0] and stand.record.amp_on.tolist() == [True] * 9
    assert not stand.record.brakes_released[0]


def test_brakes_are_let_go_only_while_the_joint_controller_holds(stand: Stand) -> None:
    stand.ask("brake_release")
    stand.run(600)
    assert stand.record.brakes_released[0]
    for name, *values in (("pid_enable", 0), ("servo_zero",)):
        stand.ask("pid_enable", 1)
        stand.ask("brake_release")
        stand.run(600)
        assert stand.record.brakes_released[0]
        stand.ask(name, *values)
        assert currents(stand) == [0.02, 0.02] and not stand.record.brakes_released[0]
    refusal = stand.ask("brake_release")
    assert refusal.outcome == "refused" and "joint controller is off" in refusal.answers[0][1]


def test_release_current_lasts_its_time_for_each_brake_then_the_smaller_one_keeps_them_off(stand: Stand) -> None:
    stand.ask("brake_release")
    seen = []
    for _ in range(600):
        stand.run()
        seen.append((*currents(stand), bool(stand.record.brakes_released[0])))
    first, second = [row[0] for row in seen], [row[1] for row in seen]
    assert set(first[:512]) == {0.4} and set(first[512:]) == {0.1}  # the 513th sample after the request is too late
    assert set(second[:256]) == {0.3} and set(second[256:]) == {0.1}  # 0.4 A were asked for, 0.3 A are its limit
    assert [row[2] for row in seen].index(True) == 512


def test_engaging_takes_effect_at_once_and_a_release_begins_anew(stand: Stand) -> None:
    stand.ask("brake_release")
    stand.run(300)
    assert stand.ask("brake_engage").outcome == "done"
    assert currents(stand) == [0.02, 0.02]
    stand.ask("brake_release")
    stand.run(512)
    assert currents(stand)[0] == 0.4
    stand.run()
    assert currents(stand)[0] == 0.1 and stand.record.brakes_released[0]
    stand.ask("brake_engage")
    assert not stand.record.brakes_released[0]


def test_a_fault_engages_the_brakes_and_power_does_not_release_them_again(stand: Stand) -> None:
    stand.ask("brake_release")
    stand.run(600)
    stand.ask("tracking_check", 1)
    stand.port.place(0, 1.0)  # far from where it holds
    stand.run()
    assert stand.codes == ["tracking"] and currents(stand) == [0.02, 0.02]
    stand.ask("clear_fault")
    assert stand.ask("pid_enable", 1).outcome == "done"
    stand.ask("brake_release")
    stand.run(600)
    assert stand.record.brakes_released[0]
    stand.ask("power_off")
    stand.power()
    stand.run(10)
    assert currents(stand) == [0.02, 0.02] and not stand.record.brakes_released[0]


def test_too_much_current_in_a_brake_cuts_power(stand: Stand) -> None:
    word = int(stand.port.live[2, 4]) & 0xFFFF0000
    stand.port.live[2, 4] = word | round((1.2 * 0.3 + 0.05 + 6.25) / (12.5 / 65536)) + 1
    stand.run(100)
    assert stand.codes == []
    stand.run()
    assert stand.codes == ["current"] and not stand.record.power_wanted[0]
    (event,) = [e for e in stand.core.reports.events if e.code == "current"]
    assert event.axis == 8 and event.limit == pytest.approx(1.2 * 0.3 + 0.05)


def test_brakes_are_refused_without_power_and_where_there_are_none() -> None:
    plain = Stand()
    plain.power()
    assert plain.ask("brake_release").answers[-1] == ("refused", "it has no brakes")
    braked = Stand(robots=(robot("PSM1", 0, brakes=(brake(3, 0.5),)),))
    assert braked.ask("brake_release").answers[-1] == ("refused", "its amplifiers are not on")
    assert not np.any(braked.record.brakes_released)
