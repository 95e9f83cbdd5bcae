"""A hand at the master feels a wall that stops the slave."""

from __future__ import annotations

import math

import pytest

from tests.teleop.harness import TeleopHarness


@pytest.mark.parametrize("most", [0.0, 2.0])
def test_a_hand_feels_a_wall_that_stops_the_slave_as_far_as_is_configured(most: float) -> None:
    harness = TeleopHarness(wall_force=most)
    harness.follow()
    harness.lead(0.005, 0.0, 0.0)
    assert not harness.master.asked("body/servo_cf")
    harness.slave.obeys, harness.slave.says["servo_cp"] = False, "at wall floor"
    harness.lead(0.003, 0.0, -0.004)
    harness.run(0.002)
    sent = [values for _, values, _ in harness.master.asked("body/servo_cf")]
    assert "is at wall floor" in harness.text("reason") and bool(sent) is bool(most)
    if sent:
        assert sent[-1] == pytest.approx((-0.6, 0.0, 0.8, 0.0, 0.0, 0.0, 0.03, 1.0), abs=1e-6), "200 N/m · 5 mm"
        harness.lead(0.03, 0.0, -0.04)
        force = harness.master.asked("body/servo_cf")[-1][1][:3]
        assert math.hypot(*force) == pytest.approx(most)
    harness.forget()
    harness.slave.obeys = True
    harness.slave.says.clear()
    harness.run(0.5)
    sent = harness.master.asked("body/servo_cf")
    harness.run(0.1)
    assert harness.following and harness.master.asked("body/servo_cf") == sent, "away from the wall, nothing is felt"
