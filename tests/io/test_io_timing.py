"""A loop that does not keep its period: warned of, and stopped when it is far too slow."""

from __future__ import annotations

import pytest

from tests.io.harness import IoHarness
from trocar.procs.io.record import IoRecord
from trocar.procs.io.reports import IoReports
from trocar.procs.io.timing import Timing

PERIOD_S = 1 / 1500
SLOW_NS = 1_333_334  # just above twice the period
SECOND = 1_000_000_000


class Loop:
    """Cycles of some length in which some time is work."""

    def __init__(self) -> None:
        self.reports, self.record = IoReports(), IoRecord.private(7, 2, 0)
        self.record.power_requested[1] = True
        self.now_ns = 5 * SECOND
        self.timing = Timing("IO1", PERIOD_S, self.record, self.reports, self.now_ns)

    def run(self, seconds: float, period_ns: int = 666_667, work_ns: int = 100_000) -> None:
        for _ in range(round(seconds * SECOND / period_ns)):
            self.now_ns += period_ns
            self.timing.step(self.now_ns - work_ns, self.now_ns)

    @property
    def trips(self) -> list[tuple[str, int]]:
        return [(trip.fault.code, trip.robot) for trip in self.reports.trips]


def test_a_loop_that_keeps_its_period_is_fine() -> None:
    loop = Loop()
    loop.run(20.0)
    assert loop.trips == [] and loop.reports.events == []


def test_twice_the_period_is_the_limit_and_only_powered_robots_are_stopped() -> None:
    loop = Loop()
    loop.run(11.0)
    loop.run(3.0, 1_333_333)
    assert loop.trips == []
    loop.run(1.5, SLOW_NS)
    assert set(loop.trips) == {("period", 1)}
    trip = loop.reports.trips[0]
    assert trip.limit == pytest.approx(1.3333333e-3) and trip.value > trip.limit


def test_nothing_is_judged_in_the_first_ten_seconds() -> None:
    loop = Loop()
    loop.run(9.5, 2_000_000, 1_000_000)
    assert loop.trips == [] and loop.reports.events == []
    loop.run(1.6, 2_000_000, 1_000_000)
    assert set(loop.trips) == {("period", 1)}


def test_long_work_is_warned_of_every_two_minutes() -> None:
    loop = Loop()
    loop.run(100.0, 700_000, 680_000)
    (event,) = loop.reports.events
    assert (event.kind, event.code, event.component) == ("warning", "period-long", "IO1")
    assert event.value == pytest.approx(0.00068) and event.limit == pytest.approx(PERIOD_S)
    loop.run(40.0, 700_000, 680_000)
    assert len(loop.reports.events) == 2 and loop.trips == []


def test_waiting_in_vain_for_replies_is_not_the_computers_fault() -> None:
    loop, waited_ns = Loop(), 0
    for _ in range(round(15.0 * SECOND / 2_666_667)):
        loop.now_ns += 2_666_667
        waited_ns += 2_000_000
        loop.timing.step(loop.now_ns - 2_200_000, loop.now_ns, waited_ns)
    assert loop.trips == [] and loop.reports.events == []
    for _ in range(round(1.5 * SECOND / 4_000_000)):
        loop.now_ns += 4_000_000
        waited_ns += 2_000_000
        loop.timing.step(loop.now_ns - 3_500_000, loop.now_ns, waited_ns)
    assert set(loop.trips) == {("period", 1)}, "but what comes on top of it is"


def test_a_powered_robot_is_stopped_and_can_be_brought_back() -> None:
    harness = IoHarness().control()
    harness.core._timing._start_ns -= 10 * SECOND
    for _ in range(800):
        harness.clock.ns += 500_000
        harness.run(1)
    assert harness.codes == ["period"] and not harness.record.pid_enabled[0] and harness.record.power_requested[0]
    harness.run_s(1.1)
    harness.ask("clear_fault")
    assert harness.ask("pid_enable", 1).outcome == "done"
    harness.run_s(1.5)
    assert harness.codes == ["period"] and harness.record.pid_enabled[0]
