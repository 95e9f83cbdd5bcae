"""What counts as our own way of an arm: between the goals of the last moment, nearly; nothing else."""

from __future__ import annotations

import numpy as np

from tests.rl.playing import psm
from trocar.procs.rl.others import Way

HERE = np.array((0.1, 0.0, 0.12, 0.0, 0.0, 0.0, 0.3))
YAW = np.eye(7)[0]


def test_where_it_rests_it_has_to_stay() -> None:
    way = Way(psm())
    assert not way.has_begun
    way.begin(HERE)
    assert way.has_begun and not way.objection(HERE + 0.0005)
    assert way.objection(HERE + 0.01 * YAW) == "yaw 0.01 rad"
    assert way.objection(HERE + np.eye(7)[2] * 0.002) == "insertion 0.002 m"
    assert way.objection(HERE - np.eye(7)[6] * 0.01) == "jaw 0.01 rad"


def test_between_its_last_goals_it_may_be_anywhere() -> None:
    way = Way(psm())
    way.begin(HERE)
    way.add(HERE + 0.1 * YAW, 1_000_000_000)
    assert not way.objection(HERE) and not way.objection(HERE + 0.05 * YAW) and not way.objection(HERE + 0.1 * YAW)
    assert way.objection(HERE + 0.2 * YAW) and way.objection(HERE - 0.1 * YAW)


def test_where_it_was_long_ago_it_may_not_be() -> None:
    way = Way(psm())
    way.begin(HERE)
    for second in range(1, 4):
        way.add(HERE + second * YAW, second * 1_000_000_000)
    assert way.objection(HERE) and not way.objection(HERE + 2.5 * YAW)
