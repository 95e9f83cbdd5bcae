"""Which events are a fault, what led to it, and whether all was well before."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.recorder.harness import RingsOfATest
from trocar.procs.recorder.sources import SystemSources
from trocar.procs.recorder.watch import WELL_NS, FaultWatch
from trocar.procs.tables import codes
from trocar.shm.system import directory
from trocar.shm.system.events import Events
from trocar.shm.time.clock import monotonic_ns
from trocar.shm.time.control_page import create_control
from trocar.shm.topics import EVENTS


@pytest.fixture
def watch(rings: RingsOfATest) -> Iterator[FaultWatch]:
    found = FaultWatch(rings.sources)
    yield found
    found.close()

PUBLISHED = {"HOMED": "ENABLED", "HOMING": "ENABLED", "POWERING": "DISABLED"}


def goes(rings: RingsOfATest, *states: str) -> None:
    """The arm says these states, as arms do."""
    for state in states:
        rings.events.operating_state(PUBLISHED.get(state, state), state, state == "HOMED", state in PUBLISHED)


def test_fault_and_errors_that_power_off_are_faults(rings: RingsOfATest, watch: FaultWatch) -> None:
    goes(rings, "ENABLED")
    rings.events.report(codes.READ_MISSED, "a read failed", "PSM1")
    assert watch.look() == []
    rings.events.report(codes.TEMPERATURE, "amplifier 3 is too hot", "PSM1")
    goes(rings, "FAULT")
    found = [watch.explained(fault) for fault in watch.look()]
    assert [(fault.code, fault.reason) for fault in found] == [("temperature", "PSM1: amplifier 3 is too hot")] * 2
    assert watch.look() == []


def test_what_the_process_system_repeats_is_no_other_fault(rings: RingsOfATest) -> None:
    create_control(rings.system, "system", topics=(EVENTS,))
    directory.create_ring(rings.system, "system", EVENTS, {}, {"kind": "system"})
    watch = FaultWatch(SystemSources(rings.system, rings.table, "recorder"))
    repeats = directory.writer(rings.system, "system", "events", "system")
    Events(repeats, monotonic_ns).report(codes.TEMPERATURE, "PSM1: amplifier 3 is too hot", "PSM1")
    rings.events.report(codes.TEMPERATURE, "amplifier 3 is too hot", "PSM1")
    assert [fault.instance for fault in watch.look()] == ["PSM1"]
    for part in (watch, repeats):
        part.close()


@pytest.mark.parametrize("states", [("FAULT",), ("FAULT", "FAULT")])
def test_a_fault_before_it_began_is_none(rings: RingsOfATest, states: tuple[str, ...]) -> None:
    goes(rings, *states)
    late = FaultWatch(rings.sources)
    goes(rings, "FAULT")
    assert late.look() == []
    late.close()


def test_who_leaves_fault_by_a_command_has_no_other_fault(rings: RingsOfATest, watch: FaultWatch) -> None:
    goes(rings, "HOMED", "FAULT")
    assert len(watch.look()) == 1
    goes(rings, "FAULT", "FAULT", "DISABLED", "POWERING", "HOMED")  # to each command it says where it is
    assert watch.look() == []
    goes(rings, "FAULT")
    assert [fault.is_first for fault in watch.look()] == [True]


def test_homings_that_fail_again_are_not_the_first(rings: RingsOfATest, watch: FaultWatch) -> None:
    goes(rings, "HOMED", "FAULT")
    for _ in range(3):
        goes(rings, "FAULT", "DISABLED", "POWERING", "HOMING", "FAULT")
    assert [fault.is_first for fault in watch.look()] == [True, False, False, False]


def test_who_stays_without_power_is_well(rings: RingsOfATest, watch: FaultWatch,
                                         monkeypatch: pytest.MonkeyPatch) -> None:
    at_ns = 1_000_000_000
    monkeypatch.setattr("trocar.shm.system.events.monotonic_ns", lambda: at_ns)
    goes(rings, "FAULT", "DISABLED", "POWERING")
    at_ns += WELL_NS
    goes(rings, "FAULT")
    assert [fault.is_first for fault in watch.look()] == [True, False], "it was on its way to power"
    goes(rings, "DISABLED")
    at_ns += WELL_NS
    goes(rings, "FAULT")
    assert [fault.is_first for fault in watch.look()] == [True]


def test_the_error_before_a_fault_is_its_cause_and_not_what_came_of_it(rings: RingsOfATest, watch: FaultWatch) -> None:
    rings.events.report(codes.TRACKING, "PSM1 cannot follow", "PSM1")
    goes(rings, "FAULT")
    rings.events.report(codes.TRACKING, "PSM1 still cannot follow", "PSM1")
    [fault] = [watch.explained(fault) for fault in watch.look()]
    assert (fault.code, fault.reason) == ("tracking", "PSM1 cannot follow")


@pytest.mark.parametrize(("reason", "said"), [("power was lost", "PSM1: power was lost"), ("", "PSM1 is in FAULT")])
def test_without_an_error_it_is_what_the_record_says(rings: RingsOfATest, watch: FaultWatch, reason: str,
                                                     said: str) -> None:
    rings.state.field("reason")[...] = reason.encode()
    rings.write(1)
    goes(rings, "FAULT")
    assert [watch.explained(fault).reason for fault in watch.look()] == [said]
