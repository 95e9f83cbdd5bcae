"""Moves and streams slow down before walls, and a slowed move gets faster as slowly as its joints may."""

from __future__ import annotations

import numpy as np
import pytest

from tests.arm.test_neighbours import NEAR_X, beside, pytestmark, shifted
from tests.arm.test_walls import pose, tip
from trocar.procs.tables.arm_types import base_name

__all__ = ["pytestmark"]  # the same condition


def test_the_setpoint_slows_down_to_half_of_what_it_may_before_a_wall() -> None:
    made, _ = beside()
    distances = []
    for share in np.linspace(0.0, 1.0, 200):
        made.send("servo_cp", pose(made, (share * NEAR_X, 0.0, tip(made)[2])), base_name("PSM1"))
        made.arm.control.walls.is_news = True
        made.arm.control.walls.show(made.arm.control.here, made.now_ns)
        distances.append(float(made.walls["distance"][0]))
    shrunk = -np.diff(distances)
    assert (shrunk <= np.array(distances[:-1]) * (made.period_ns * 1e-9 / 0.1) + 1e-9).all() and min(distances) > 0.0


def test_moves_of_two_arms_slow_down_before_each_other_though_they_see_each_other_late() -> None:
    made, there = beside()
    there.put(shifted(-0.15))
    move = made.send("move_jp", (-0.8, 0.0, 0.12, 0.0, 0.0, 0.0))
    places, steps = [made.state["setpoint_position"][:6].copy()] * 10, []  # 20 ms
    while move.outcomes[-1] == "accepted":
        there.go((*(places.pop(0) * (-1.0, 1.0, 1.0, 1.0, 1.0, 1.0)), 0.0))  # the same motion from the other side
        made.step()
        places.append(made.state["setpoint_position"][:6].copy())
        steps.append(abs(places[-1][0] - places[-2][0]))
    assert move.outcomes[-1] == "failed" and "wall arms: PSM2 is in the way" in move.replies[-1][1]
    there.go((*(places[-1] * (-1.0, 1.0, 1.0, 1.0, 1.0, 1.0)), 0.0))
    made.run(0.1)
    assert -1e-4 < made.walls["distance"][0] < 2e-3
    assert max(steps) > 5e-4 and steps[-1] < 0.1 * max(steps) and np.abs(np.diff(steps)).max() < 1e-4, "no sudden stop"


@pytest.mark.parametrize("cause", ["instrument", "base", "wall", "ratio", "goal"])
def test_a_move_that_was_slowed_down_gets_faster_no_sooner_than_its_joints_accelerate(cause: str) -> None:
    made, there = beside()
    there.put(shifted(-0.15))
    assert made.send("move_jp", (-0.8, 0.0, 0.12, 0.0, 0.0, 0.0)).outcomes == ["accepted"]
    places = [made.state["setpoint_position"][:6].copy()] * 2

    def run(cycles: int) -> None:
        for _ in range(cycles):
            made.step()
            places.append(made.state["setpoint_position"][:6].copy())

    speeds = [0.0]
    while speeds[-1] > 0.4 * max(speeds) or max(speeds) < 0.1:
        there.go((*(places[-1] * (-1.0, 1.0, 1.0, 1.0, 1.0, 1.0)), 0.0))  # the same motion from the other side
        run(1)
        speeds.append(abs(places[-1][0] - places[-2][0]) / (made.period_ns * 1e-9))
    assert made.arm.control.walls.stopped_by == "arms: PSM2"
    first = len(places) - 2
    if cause == "instrument":
        there.state["instrument"][...], there.state["tool"][...] = 1, b""
        run(1)
    elif cause == "base":
        there.put(shifted(NEAR_X), known=False)
        run(1)
    else:
        name, *request = {"wall": ("remove_wall", (), "arms"), "ratio": ("trajectory_j/set_ratio", (0.9,)),
                          "goal": ("move_jp", (0.2, 0.0, 0.12, 0.0, 0.0, 0.0))}[cause]
        assert made.send(name, *request).outcomes[-1] in ("done", "accepted")
        places.append(made.state["setpoint_position"][:6].copy())
    run(150)
    rates = np.diff(places[first:], axis=0)[:, 0] / (made.period_ns * 1e-9)
    rises = np.diff(np.abs(rates)) / (made.period_ns * 1e-9)
    assert rises.max() <= 2.05 * made.arm.control.joints.a_max[0], "the move's own, and that of its time"
    assert rates[-1] < -0.55 or cause in ("ratio", "goal")
