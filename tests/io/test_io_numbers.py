"""Numbers that are none, or too large to compute with, never reach a motor."""

from __future__ import annotations

import numpy as np
import pytest

from tests.io.fault_rows import (
    ENGAGED_A,
    NUMBERS,
    brake_a,
    braked,
    is_off,
    lose_packets,
    nan_effort,
    reported,
    working,
    zero_current,
)


def test_a_set_point_that_is_no_number_is_found_without_packets_too() -> None:
    harness = working(braked())
    lose_packets(harness)
    nan_effort(harness)
    harness.run(1)
    assert sorted(reported(harness)) == ["not-finite", "read-missed"] and not harness.record.pid_enabled[0]
    assert zero_current(harness) and harness.record.power_requested[0] and brake_a(harness) == ENGAGED_A
    harness.run(30)
    assert harness.codes == ["not-finite", "bad-reads"] and is_off(harness)
    assert harness.record.fault[0] == NUMBERS["not-finite"], "the first stays latched"


def test_a_controller_that_computes_no_number_sends_0_a_and_goes_off() -> None:
    harness = working(braked())
    harness.send(1, position=0.01)
    harness.run(2)
    pid = harness.by_numpy().core.pid
    control = pid.control

    def broken(*measured: np.ndarray) -> bool:
        finite = control(*measured)
        if harness.record.pid_enabled[0]:
            pid.effort[2] = np.nan
        return finite

    pid.control = broken  # type: ignore[method-assign]
    harness.run(1)
    assert harness.port.sent[-1][0, 2] & 0xFFFF == 0x8000 and harness.codes == ["not-finite"]
    harness.run(1)
    assert zero_current(harness) and harness.record.power_requested[0] and brake_a(harness) == ENGAGED_A


@pytest.mark.parametrize("native", [True, False])
def test_a_law_that_gives_no_number_is_a_fault_although_the_position_is_exact(native: bool) -> None:
    harness = working(braked())
    harness.send(1, in_effort=False, position=0.0)
    harness.run(2)
    if not native:
        harness.by_numpy()
    harness.core.pid.d_gain[2] = np.inf  # times a velocity of 0 that is no number
    harness.run(1)
    assert harness.port.sent[-1][0, 2] & 0xFFFF == 0x8000 and harness.codes == ["not-finite"]
    assert not harness.record.pid_enabled[0] and "axis 2" in harness.core.reports.events[-1].text
