"""Brakes: the sequence of their currents, on a clock with a period that floats add up exactly."""

from __future__ import annotations

import numpy as np
import pytest

from tests.io.harness import IoHarness, robot
from trocar.procs.document.system import Brake, Linear

TIMES = (0.5, 0.25)


def brake(axis: int, release_s: float) -> Brake:
    return Brake(1, axis, Linear(5242.88, 32768.0), Linear(12.5 / 65536, -6.25), 0.5, 0.4, release_s, 0.1, 0.02)


@pytest.fixture
def harness() -> IoHarness:
    """Seven actuators on boards 0 and 1; the last channel of board 1 and board 2 hold brakes."""
    first, second = brake(3, TIMES[0]), Brake(2, 0, Linear(5242.88, 32768.0), Linear(12.5 / 65536, -6.25), 0.3, 0.4,
                                              TIMES[1], 0.1, 0.02)
    return IoHarness(robots=(robot("PSM1", 0, brakes=(first, second)),), period_s=1 / 1024).control()


def currents(harness: IoHarness) -> list[float]:
    """Of the two brakes, as they were sent."""
    out = harness.port.sent[-1]
    return [round((int(out[row, axis] & 0xFFFF) - 32768.0) / 5242.88, 3) for row, axis in ((1, 3), (2, 0))]


def test_brakes_hold_until_they_are_released_and_their_amplifiers_are_the_robots(harness: IoHarness) -> None:
    assert currents(harness) == [0.02, 0.02]
    assert harness.record.amps_on[0] and harness.record.amp_on.tolist() == [True] * 9
    assert not harness.record.brakes_released[0]


def test_brakes_are_let_go_only_while_the_joint_controller_holds(harness: IoHarness) -> None:
    harness.ask("brake_release")
    harness.run(600)
    assert harness.record.brakes_released[0]
    for name, *values in (("pid_enable", 0), ("servo_zero",)):
        harness.ask("pid_enable", 1)
        harness.ask("brake_release")
        harness.run(600)
        assert harness.record.brakes_released[0]
        harness.ask(name, *values)
        assert currents(harness) == [0.02, 0.02] and not harness.record.brakes_released[0]
    refusal = harness.ask("brake_release")
    assert refusal.outcome == "refused" and "joint controller is off" in refusal.answers[0][1]


def test_release_current_lasts_its_time_for_each_brake_then_the_smaller_one_keeps_them_off(harness: IoHarness) -> None:
    harness.ask("brake_release")
    seen = []
    for _ in range(600):
        harness.run()
        seen.append((*currents(harness), bool(harness.record.brakes_released[0])))
    first, second = [row[0] for row in seen], [row[1] for row in seen]
    assert set(first[:512]) == {0.4} and set(first[512:]) == {0.1}  # the 513th sample after the request is too late
    assert set(second[:256]) == {0.3} and set(second[256:]) == {0.1}  # 0.4 A were asked for, 0.3 A are its limit
    assert [row[2] for row in seen].index(True) == 512


def test_engaging_takes_effect_at_once_and_a_release_begins_anew(harness: IoHarness) -> None:
    harness.ask("brake_release")
    harness.run(300)
    assert harness.ask("brake_engage").outcome == "done"
    assert currents(harness) == [0.02, 0.02]
    harness.ask("brake_release")
    harness.run(512)
    assert currents(harness)[0] == 0.4
    harness.run()
    assert currents(harness)[0] == 0.1 and harness.record.brakes_released[0]
    harness.ask("brake_engage")
    assert not harness.record.brakes_released[0]


def test_a_fault_engages_the_brakes_and_power_does_not_release_them_again(harness: IoHarness) -> None:
    harness.ask("brake_release")
    harness.run(600)
    harness.ask("tracking_check", 1)
    harness.port.place(0, 1.0)  # far from where it holds
    harness.run()
    assert harness.codes == ["tracking"] and currents(harness) == [0.02, 0.02]
    harness.ask("clear_fault")
    assert harness.ask("pid_enable", 1).outcome == "done"
    harness.ask("brake_release")
    harness.run(600)
    assert harness.record.brakes_released[0]
    harness.ask("power_off")
    harness.power()
    harness.run(10)
    assert currents(harness) == [0.02, 0.02] and not harness.record.brakes_released[0]


def test_too_much_current_in_a_brake_cuts_power(harness: IoHarness) -> None:
    word = int(harness.port.live[2, 4]) & 0xFFFF0000
    harness.port.live[2, 4] = word | round((1.2 * 0.3 + 0.05 + 6.25) / (12.5 / 65536)) + 1
    harness.run(100)
    assert harness.codes == []
    harness.run()
    assert harness.codes == ["current"] and not harness.record.power_requested[0]
    (event,) = [e for e in harness.core.reports.events if e.code == "current"]
    assert event.axis == 8 and event.limit == pytest.approx(1.2 * 0.3 + 0.05)


def test_brakes_are_refused_without_power_and_where_there_are_none() -> None:
    plain = IoHarness().power()
    assert plain.ask("brake_release").answers[-1] == ("refused", "it has no brakes")
    braked = IoHarness(robots=(robot("PSM1", 0, brakes=(brake(3, 0.5),)),))
    assert braked.ask("brake_release").answers[-1] == ("refused", "its amplifiers are not on")
    assert not np.any(braked.record.brakes_released)
