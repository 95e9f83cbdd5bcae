"""A hand at the master feels a wall that stops the slave."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.teleop.harness import PERIOD_NS, TeleopHarness
from trocar.procs.teleop.wall_force import FALL, RISE, STIFFNESS

WRENCH = "body/servo_cf"


def at_wall(most: float = 2.0, **settings: bool) -> TeleopHarness:
    """Following, with a slave that a wall stops from now on."""
    harness = TeleopHarness(wall_force=most, **settings)
    if harness.base is not None:
        harness.base.set(reference_valid=True, measured_cp=(0, 0, 0, 0, 0, 0, 1))
    harness.follow()
    stop(harness)
    return harness


def stop(harness: TeleopHarness) -> None:
    harness.slave.obeys, harness.slave.says["servo_cp"] = False, "at wall floor"


def forces(harness: TeleopHarness) -> list[tuple[float, ...]]:
    return [values[:3] for _, values, _ in harness.master.asked(WRENCH)]


def sizes(harness: TeleopHarness) -> list[float]:
    return [math.hypot(*force) for force in forces(harness)]


@pytest.mark.parametrize("most", [0.0, 2.0])
def test_a_hand_feels_a_wall_that_stops_the_slave_as_far_as_is_configured(most: float) -> None:
    harness = TeleopHarness(wall_force=most)
    harness.follow()
    harness.lead(0.005, 0.0, 0.0)
    assert not forces(harness)
    stop(harness)
    harness.lead(0.003, 0.0, -0.004)
    harness.run(0.1)
    assert "is at wall floor" in harness.text("reason") and bool(forces(harness)) is bool(most)
    if most:
        sent = harness.master.asked(WRENCH)[-1][1]
        assert sent == pytest.approx((-0.6, 0.0, 0.8, 0.0, 0.0, 0.0, 0.03, 1.0), abs=1e-6), "200 N/m · 5 mm"
        harness.lead(0.03, 0.0, -0.04)
        harness.run(0.1)
        assert sizes(harness)[-1] == pytest.approx(most) and max(sizes(harness)) <= most + 1e-9


def test_the_force_grows_slowly_and_ends_in_the_cycle_in_which_the_wall_is_left() -> None:
    harness = at_wall(5.0)
    harness.lead(0.0, 0.0, -0.025)
    harness.run(0.3)
    grown = np.diff(sizes(harness))
    assert grown.max() == pytest.approx(RISE * PERIOD_NS * 1e-9, rel=1e-3) and sizes(harness)[0] < 0.1
    harness.lead(0.0, 0.0, 0.02)
    harness.run(0.2)
    assert sizes(harness)[-1] == pytest.approx(STIFFNESS * 0.005), "it falls with the depth"
    assert np.diff(sizes(harness)).min() >= -FALL * PERIOD_NS * 1e-9 - 1e-9
    harness.forget()
    harness.slave.says.clear()
    harness.lead(0.0, 0.0, 0.015)  # the slave, still at the wall, follows slowly
    harness.run(0.2)
    assert len(forces(harness)) <= 3 and forces(harness)[-1] == (0.0, 0.0, 0.0), "at most until the goal is answered"
    assert harness.following and all(force[2] >= 0.0 for force in forces(harness)), "never towards the wall"


def test_a_hand_that_comes_back_faster_than_the_slave_is_not_pulled_to_the_wall() -> None:
    harness = at_wall()
    harness.lead(0.0, 0.0, -0.005)
    harness.run(0.1)
    harness.lead(0.0, 0.0, 0.02)  # answers still name the wall
    harness.run(0.05)
    assert "is at wall floor" in harness.text("reason")
    assert all(force[2] >= 0.0 for force in forces(harness)) and sizes(harness)[-1] == 0.0


def test_the_force_follows_the_direction_out_of_the_wall() -> None:
    harness = at_wall()
    harness.lead(0.0, 0.0, -0.005)
    harness.run(0.1)
    harness.lead(0.005, 0.0, 0.0)
    harness.run(1.0)
    assert forces(harness)[-1] == pytest.approx((-1.0, 0.0, 1.0), abs=0.02)


def test_in_a_base_that_has_turned_the_force_has_the_axes_of_the_master() -> None:
    harness = at_wall(base=True)
    assert harness.base is not None
    half = math.sqrt(0.5)
    harness.base.set(measured_cp=(0, 0, 0, 0, 0, half, half))  # 90° about z
    harness.run(0.05)  # the slave, at 0, has nothing to do
    harness.lead(0.005, 0.0, 0.0)
    harness.run(0.2)
    assert forces(harness)[-1] == pytest.approx((-1.0, 0.0, 0.0), abs=1e-6)


@pytest.mark.parametrize("cause", ["clutch", "refusal", "scale", "wrench", "pause"])
def test_after_an_interruption_the_force_grows_from_0(cause: str) -> None:
    harness = at_wall()
    harness.lead(0.0, 0.0, -0.01)
    harness.run(0.2)
    assert sizes(harness)[-1] == pytest.approx(2.0)
    if cause == "clutch":
        harness.send("clutch", 1)
        assert forces(harness)[-1] == (0.0, 0.0, 0.0)
        harness.send("clutch", 0)
        harness.run(0.01)
    elif cause == "refusal":
        harness.slave.refuses["servo_cp"] = "no"
        harness.run(0.01)
        assert sizes(harness)[-1] == 0.0
        harness.slave.refuses.clear()
        harness.run(0.05)
    elif cause == "wrench":
        harness.send("following/mtm/body/servo_cf", *(0.0,) * 6)
    elif cause == "pause":
        harness.now_ns += 50_000_000
    else:
        harness.send("set_scale", 0.5)
    harness.forget()
    harness.lead(0.0, 0.0, -0.005)
    harness.run(0.2)
    assert harness.following and sizes(harness)[0] <= 0.1 and sizes(harness)[-1] > 0.9
    assert np.diff(sizes(harness)).max() <= RISE * PERIOD_NS * 1e-9 + 1e-9
