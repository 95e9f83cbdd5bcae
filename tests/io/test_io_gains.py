"""Gains changed by command: who, what, from which cycle on, and what everybody can read."""

from __future__ import annotations

import numpy as np
import pytest

from tests.io.harness import FakeCommand, IoHarness, robot
from trocar.procs.document.gains import GAINS, value_of


@pytest.fixture
def harness() -> IoHarness:
    return IoHarness().control()


def reported(harness: IoHarness) -> list[tuple[str, int, str]]:
    return [(e.component, e.axis, e.text) for e in harness.core.reports.events if e.text.startswith("gains changed")]


def test_a_gain_changes_within_the_cycle_of_its_command(harness: IoHarness) -> None:
    harness.send(1, position=np.full(8, 0.1))
    harness.run(2)
    before = harness.core.pid.effort.copy()
    done = harness.ask("set_gains", 3, 2.0, 0.02, robot="PSM1 p_gain p_deadband @anton")
    assert done.outcome == "done"
    changed = harness.core.pid.effort
    assert changed[3] == pytest.approx(2.0 * 0.08) and np.array_equal(np.delete(changed, 3), np.delete(before, 3))
    assert reported(harness) == [("PSM1", 3, "gains changed by anton: p_gain 1 -> 2, p_deadband 0 -> 0.02")]


def test_the_record_shows_the_disturbance_that_an_observer_compensates(harness: IoHarness) -> None:
    record = harness.core.record
    asked = harness.ask("set_gains", 3, 1.0, 0.4, 20.0,
                        robot="PSM1 use_disturbance_observer nominal_mass disturbance_cutoff")
    assert asked.outcome == "done"
    harness.send(1, position=np.full(8, 0.1))
    harness.run(20)
    assert record.disturbance[3] > 0.01, "something holds it: it does not go where it is pushed"
    assert record.setpoint_effort[3] == pytest.approx(0.1 + record.disturbance[3])
    assert not np.delete(record.disturbance, 3).any()
    harness.ask("pid_enable", 0)
    harness.run(1)
    assert not record.disturbance.any()


def test_all_axes_change_together(harness: IoHarness) -> None:
    harness.core.reports.events.clear()
    assert harness.ask("set_gains", -1, 0.25, robot="PSM1 d_gain").outcome == "done"
    assert harness.core.parts.gains.record["d_gain"].tolist() == [0.25] * 7
    assert [row[:2] for row in reported(harness)] == [("PSM1", axis) for axis in range(7)]
    assert "by another program" in reported(harness)[0][2]


def test_the_record_shows_files_first_and_every_change(harness: IoHarness) -> None:
    record, reports = harness.core.parts.gains.record, harness.core.reports
    assert "gains" in reports.changed and record["changes"] == 0
    assert record["p_gain"].tolist() == [1.0] * 7 and record["pid_max_output"].tolist() == [-1.0] * 7
    reports.changed.clear()
    harness.ask("set_gains", 0, 3.0, robot="PSM1 p_gain")
    assert reports.changed == {"gains"} and record["changes"] == 1
    rows = harness.core.pid.gains
    for gain in GAINS:
        assert record[gain.key].tolist() == [value_of(row, gain.key) for row in rows]


@pytest.mark.parametrize(("text", "values", "reason"), [
    ("PSM1 p_gain", (0, -1.0), "axis 0: p_gain -1; allowed: from 0"),
    ("PSM1 p_gain", (7, 1.0), "axis 7; allowed: 0 to 6, -1 for all"),
    ("PSM1 p_gain", (0.5, 1.0), "axis, -1: all 0.5"),
    ("PSM1 p_gain", (np.nan, 1.0), "axis, -1: all nan"),
    ("PSM1 p_gain", (), "none was given"),
    ("PSM1 p_gain", (0,), "1 gains and 0 values"),
    ("PSM1", (0,), "0 gains and 0 values"),
    ("PSM1 p_gain d_gain", (0, 1.0), "2 gains and 1 values"),
    ("PSM1 gain", (0, 1.0), "no gain 'gain'; there are: p_gain"),
    ("PSM1 p_gain", (0, np.inf), "inf; allowed: finite numbers"),
    ("PSM1 p_gain", (0, 11.0), "more than 10 times 1; go there in smaller steps"),
    ("PSM2 p_gain", (0, 1.0), "no robot 'PSM2' here; there are: PSM1"),
    ("", (0, 1.0), "no robot ''"),
])
def test_what_makes_no_sense_is_refused_and_nothing_changes(
    harness: IoHarness, text: str, values: tuple[float, ...], reason: str
) -> None:
    before = list(harness.core.pid.gains)
    refused = harness.ask("set_gains", *values, robot=text)
    assert refused.answers[0][0] == "refused" and reason in refused.answers[0][1]
    assert harness.core.pid.gains == before and reported(harness) == []


def test_one_bad_axis_refuses_all_of_a_change() -> None:
    harness = IoHarness().control()
    harness.ask("set_gains", 4, 0.1, robot="PSM1 p_gain")
    refused = harness.ask("set_gains", -1, 5.0, robot="PSM1 p_gain")
    assert "axis 4: p_gain 5 is more than 10 times" in refused.answers[0][1]
    assert harness.core.parts.gains.record["p_gain"].tolist() == [1.0, 1.0, 1.0, 1.0, 0.1, 1.0, 1.0]


def test_a_robot_without_controller_has_no_gains() -> None:
    harness = IoHarness(robots=(robot("PSM1", 0), robot("SUJ", 2)))
    refused = harness.ask("set_gains", 0, 1.0, robot="SUJ p_gain")
    assert refused.answers == [("refused", "it has no joint controller")]


def test_two_changes_in_one_cycle_both_count(harness: IoHarness) -> None:
    commands = [FakeCommand("set_gains", "PSM1 p_gain", 1, 2.0), FakeCommand("set_gains", "PSM1 d_gain", 1, 0.5)]
    harness.run(1, *commands)
    row = harness.core.pid.gains[1]
    assert (row.p_gain, row.d_gain) == (2.0, 0.5) and harness.core.parts.gains.record["changes"] == 2


def test_gains_stay_when_the_controller_goes_off_and_on(harness: IoHarness) -> None:
    harness.ask("set_gains", 2, 4.0, robot="PSM1 p_gain")
    harness.ask("pid_enable", 0)
    assert harness.ask("set_gains", 3, 10.0, robot="PSM1 p_gain").answers == [("done", "")]
    assert harness.ask("pid_enable", 1).outcome == "done"
    assert harness.core.parts.gains.record["p_gain"].tolist() == [1.0, 1.0, 4.0, 10.0, 1.0, 1.0, 1.0]


SLIP = "axis 3: p_gain 4000 is more than 10 times 1, used last; set it again to confirm"


@pytest.fixture
def slipped(harness: IoHarness) -> IoHarness:
    """Off, with a gain whose decimal point has slipped."""
    harness.ask("pid_enable", 0)
    assert harness.ask("set_gains", 3, 4000.0, 0.5, robot="PSM1 p_gain d_gain").answers == [("done", SLIP)]
    return harness


def test_a_slip_of_the_decimal_point_while_it_is_off_does_not_act_when_it_is_switched_on(slipped: IoHarness) -> None:
    assert slipped.ask("pid_enable", 1).answers == [("refused", SLIP)]
    assert slipped.ask("pid_enable", 1).outcome == "refused", "asking twice confirms nothing"
    assert not slipped.core.record.pid_enabled[0] and not slipped.core.pid.enabled.any()


@pytest.mark.parametrize("value", [4000.0, 9.0])
def test_the_same_gain_again_or_a_smaller_one_lets_it_be_switched_on(slipped: IoHarness, value: float) -> None:
    assert slipped.ask("set_gains", 3, value, robot="PSM1 p_gain").answers == [("done", "")]
    assert slipped.ask("pid_enable", 1).outcome == "done"
    slipped.ask("pid_enable", 0)
    assert slipped.ask("pid_enable", 1).outcome == "done", "it was on with these"


def test_another_gain_or_another_slip_confirms_nothing(slipped: IoHarness) -> None:
    slipped.ask("set_gains", 3, 0.5, robot="PSM1 d_gain")
    slipped.ask("set_gains", 2, 1.0, robot="PSM1 p_gain")
    assert slipped.ask("set_gains", 3, 5000.0, robot="PSM1 p_gain").answers[0][1].startswith("axis 3: p_gain 5000 is")
    assert slipped.ask("pid_enable", 1).outcome == "refused"


def test_many_small_steps_while_it_is_off_are_one_large_one(harness: IoHarness) -> None:
    harness.ask("pid_enable", 0)
    for value in (10.0, 100.0, 1000.0):
        harness.ask("set_gains", 3, value, robot="PSM1 p_gain")
    assert harness.ask("pid_enable", 1).outcome == "refused"


def test_small_steps_while_it_is_on_count_one_by_one(harness: IoHarness) -> None:
    for value in (10.0, 100.0):
        assert harness.ask("set_gains", 3, value, robot="PSM1 p_gain").outcome == "done"
    harness.ask("pid_enable", 0)
    assert harness.ask("pid_enable", 1).outcome == "done"
