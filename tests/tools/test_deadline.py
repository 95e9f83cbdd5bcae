"""Waits end when the time is over on both clocks, ours and the robot's."""

from __future__ import annotations

import pytest

from trocar.tools.client.deadline import Deadline

STEP_NS = 10_000_000


class Clocks:
    """Ours, and that of a robot whose time passes `speed` times as quickly."""

    def __init__(self, speed: float) -> None:
        self.ours, self.speed, self.robot, self.looks = 0, speed, 5_000_000_000.0, 0

    def stamp_ns(self) -> int:
        self.looks += 1
        return int(self.robot)

    def passed_s(self, deadline: Deadline, stands_after_s: float = 1e9) -> float:
        """When it is over, on our clock."""
        while not deadline.is_over():
            self.ours += STEP_NS
            self.robot += STEP_NS * self.speed if self.ours < stands_after_s * 1e9 else 0
            assert self.ours < 1e12
        return self.ours * 1e-9


@pytest.mark.parametrize(("speed", "seconds"), [(1.0, 10.0), (0.25, 40.0), (8.0, 10.0)])
def test_the_slower_clock_counts(speed: float, seconds: float) -> None:
    clocks = Clocks(speed)
    deadline = Deadline(10.0, clocks.stamp_ns, lambda: clocks.ours)
    assert clocks.passed_s(deadline) == pytest.approx(seconds, abs=0.6)
    assert clocks.looks < 100


def test_a_robot_whose_time_stands_holds_nobody_up() -> None:
    clocks = Clocks(0.5)
    assert clocks.passed_s(Deadline(10.0, clocks.stamp_ns, lambda: clocks.ours), 12.0) == pytest.approx(17.0, abs=1.1)
    clocks = Clocks(0.0)  # from the start
    assert clocks.passed_s(Deadline(10.0, clocks.stamp_ns, lambda: clocks.ours)) == pytest.approx(10.0, abs=0.1)


def test_where_time_is_ours_nobody_looks_at_the_robot_s() -> None:
    clocks = Clocks(1.0)
    assert clocks.passed_s(Deadline(10.0, None, lambda: clocks.ours)) == pytest.approx(10.0) and not clocks.looks


def test_a_short_wait_does_not_end_before_the_robot_shows_its_next_record() -> None:
    clocks = Clocks(0.1)
    assert clocks.passed_s(Deadline(0.05, clocks.stamp_ns, lambda: clocks.ours)) == pytest.approx(0.5, abs=0.1)
