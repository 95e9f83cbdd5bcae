"""Measured current against what was requested: for whom, how much, for how long."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from procs.config import load_system
from procs.document.system import Brake, Linear
from tests import stock
from tests.io.boards_harness import Rig
from tests.io.harness import Stand, robot

AMOUNT_A, LAST_S = 0.5, 10 / 1024


def powered(count: int = 1, **changes) -> Stand:
    stand = Stand(count, current_error_a=AMOUNT_A, current_error_s=LAST_S, **changes)
    for name in stand.core.robots.names:
        stand.power(name)
    return stand


def test_current_unlike_the_request_cuts_power_on_the_11th_cycle() -> None:
    stand = powered()
    stand.port.current(5, -0.6)
    stand.run(10)
    assert stand.codes == []
    stand.run(1)
    assert stand.codes == ["current-error"]
    event = next(e for e in stand.core.reports.events if e.kind == "error")
    assert (event.component, event.axis, event.limit) == ("PSM1", 5, AMOUNT_A)
    assert event.value == pytest.approx(0.6, abs=1e-3)
    assert not stand.record.power_wanted[0] and stand.record.fault[0] == 21
    stand.run(100)
    assert stand.codes == ["current-error"]


def test_a_missing_current_counts_as_well_as_one_too_many() -> None:
    stand = powered()
    stand.ask("pid_enable", 1)
    stand.send(1, in_effort=True, effort=1.6)  # 0.8 A
    stand.run(30)
    assert stand.codes == ["current-error"]
    assert "also axis 1, 2, 3, 4, 5, 6" in next(e.text for e in stand.core.reports.events if e.kind == "error")


def test_what_follows_its_request_is_fine() -> None:
    stand = powered()
    stand.ask("pid_enable", 1)
    stand.send(1, in_effort=True, effort=1.6)
    stand.run(2)
    for axis in range(7):
        stand.port.current(axis, 0.8)
    stand.run(200)
    assert stand.codes == [] and stand.record.current_request[0] == 0.8


def test_one_good_cycle_forgives_a_difference() -> None:
    stand = powered()
    for amperes in (0.6, 0.0, 0.6):
        stand.port.current(2, amperes)
        stand.run(10 if amperes else 1)
    assert stand.codes == []


def test_a_brake_is_compared_too_and_told_after_the_actuators() -> None:
    brake = Brake(1, 3, Linear(5242.88, 32768.0), Linear(12.5 / 65536, -6.25), 1.5, 1.2, 0.5, 0.9, 0.0)
    stand = Stand(robots=(robot("PSM1", 0, brakes=(brake,)),), current_error_a=AMOUNT_A, current_error_s=LAST_S)
    stand.control()
    stand.ask("brake_release")
    stand.run(12)
    (event,) = [e for e in stand.core.reports.events if e.kind == "error"]
    assert (event.code, event.axis) == ("current-error", 7) and event.value == pytest.approx(1.2, abs=1e-3)


def test_an_amplifier_that_is_off_owes_no_current() -> None:
    stand = powered()
    stand.ask("power_off")
    stand.port.current(5, 0.9)
    stand.run(100)
    assert stand.codes == []


def test_only_the_robot_with_the_difference_loses_power() -> None:
    stand = powered(2)
    stand.port.current(8, 0.7)
    stand.run(11)
    errors = [(e.code, e.component, e.axis) for e in stand.core.reports.events if e.kind == "error"]
    assert errors == [("current-error", "PSM2", 1)]
    assert stand.record.power_wanted.tolist() == [True, False]


def test_a_difference_that_is_not_a_number_is_one() -> None:
    stand = powered()
    update = stand.core.samples.update

    def broken() -> None:
        update()
        stand.core.samples.current[4] = np.nan

    stand.core.samples.update = broken  # type: ignore[method-assign]
    stand.run(11)
    assert stand.codes == ["current-error"]


def test_nothing_is_compared_unless_asked() -> None:
    stand = Stand()
    stand.power()
    stand.port.current(5, -0.6)
    stand.run(1000)
    assert stand.codes == []


@pytest.mark.slow
def test_emulated_robots_keep_to_the_tolerance_of_their_boards() -> None:
    """What the controllers' own check allows (0.44 A for 50 ms) bothers no healthy robot, also with brakes let go."""
    found = stock.find("dvrk-site/jhu-daVinci-Si/system-PSM1.json")
    loaded = load_system(found, search=[stock.find("dvrk-share")], boards="emulated")
    assert loaded.system is not None and loaded.system.emulation is not None
    checked = dataclasses.replace(loaded.system.emulated().ios[0], current_error_a=0.44, current_error_s=0.05)
    rig = Rig(dataclasses.replace(loaded.system,
                                  emulation=dataclasses.replace(loaded.system.emulation, ios=(checked,))))
    for name, *values in (("power_on",), ("bias_encoders", 300), ("pid_enable", 1), ("brake_release",)):
        assert rig.do(name, "PSM1", *values).outcome == "done"
    rig.run(2.0)
    assert rig.errors() == [] and rig.record.amps_on[0]
