"""Measured current against what was requested: for whom, how much, for how long."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from tests.io.boards_harness import BoardsHarness, rig_of
from tests.io.harness import IoHarness, robot
from trocar.procs.document.system import Brake, Linear

AMOUNT_A, LAST_S = 0.5, 10 / 1024


def powered(count: int = 1, **changes) -> IoHarness:
    harness = IoHarness(count, current_error_a=AMOUNT_A, current_error_s=LAST_S, **changes)
    for name in harness.core.robots.names:
        harness.power(name)
    return harness


def test_current_unlike_the_request_cuts_power_on_the_11th_cycle() -> None:
    harness = powered()
    harness.port.current(5, -0.6)
    harness.run(10)
    assert harness.codes == []
    harness.run(1)
    assert harness.codes == ["current-error"]
    event = next(e for e in harness.core.reports.events if e.kind == "error")
    assert (event.component, event.axis, event.limit) == ("PSM1", 5, AMOUNT_A)
    assert event.value == pytest.approx(0.6, abs=1e-3)
    assert not harness.record.power_requested[0] and harness.record.fault[0] == 21
    harness.run(100)
    assert harness.codes == ["current-error"]


def test_a_missing_current_counts_as_well_as_one_too_many() -> None:
    harness = powered()
    harness.ask("pid_enable", 1)
    harness.send(1, in_effort=True, effort=1.6)  # 0.8 A
    harness.run(30)
    assert harness.codes == ["current-error"]
    assert "also axis 1, 2, 3, 4, 5, 6" in next(e.text for e in harness.core.reports.events if e.kind == "error")


def test_what_follows_its_request_is_fine() -> None:
    harness = powered()
    harness.ask("pid_enable", 1)
    harness.send(1, in_effort=True, effort=1.6)
    harness.run(2)
    for axis in range(7):
        harness.port.current(axis, 0.8)
    harness.run(200)
    assert harness.codes == [] and harness.record.current_request[0] == 0.8


def test_one_good_cycle_forgives_a_difference() -> None:
    harness = powered()
    for amperes in (0.6, 0.0, 0.6):
        harness.port.current(2, amperes)
        harness.run(10 if amperes else 1)
    assert harness.codes == []


def test_a_brake_is_compared_too_and_told_after_the_actuators() -> None:
    brake = Brake(1, 3, Linear(5242.88, 32768.0), Linear(12.5 / 65536, -6.25), 1.5, 1.2, 0.5, 0.9, 0.0)
    harness = powered(robots=(robot("PSM1", 0, brakes=(brake,)),))
    harness.ask("pid_enable", 1)
    harness.ask("brake_release")
    harness.run(12)
    (event,) = [e for e in harness.core.reports.events if e.kind == "error"]
    assert (event.code, event.axis) == ("current-error", 7) and event.value == pytest.approx(1.2, abs=1e-3)


def test_an_amplifier_that_is_off_owes_no_current() -> None:
    harness = powered()
    harness.ask("power_off")
    harness.port.current(5, 0.9)
    harness.run(100)
    assert harness.codes == []


def test_only_the_robot_with_the_difference_loses_power() -> None:
    harness = powered(2)
    harness.port.current(8, 0.7)
    harness.run(11)
    errors = [(e.code, e.component, e.axis) for e in harness.core.reports.events if e.kind == "error"]
    assert errors == [("current-error", "PSM2", 1)]
    assert harness.record.power_requested.tolist() == [True, False]


def test_a_difference_that_is_not_a_number_is_one() -> None:
    harness = powered()
    samples = harness.by_numpy().core.samples
    decode = samples.decode

    def broken() -> None:
        decode()
        samples.current[4] = np.nan

    samples.decode = broken  # type: ignore[method-assign]
    harness.run(11)
    assert harness.codes == ["current-error"]


def test_nothing_is_compared_unless_asked() -> None:
    harness = IoHarness().power()
    harness.port.current(5, -0.6)
    harness.run(100)
    assert harness.codes == []


@pytest.mark.slow
def test_emulated_robots_keep_to_the_tolerance_of_their_boards() -> None:
    """What the controllers' own check allows (0.44 A for 50 ms) bothers no healthy robot, also with brakes let go."""
    system = rig_of("jhu-daVinci-Si/system-PSM1").system
    assert system.emulation is not None
    checked = dataclasses.replace(system.emulated().ios[0], current_error_a=0.44, current_error_s=0.05)
    emulation = dataclasses.replace(system.emulation, ios=(checked,))
    harness = BoardsHarness(dataclasses.replace(system, emulation=emulation))
    for name, *values in (("power_on",), ("bias_encoders", 30), ("pid_enable", 1), ("brake_release",)):
        assert harness.do(name, "PSM1", *values).outcome == "done"
    harness.run(2.0)
    assert harness.errors() == [] and harness.record.amps_on[0]
