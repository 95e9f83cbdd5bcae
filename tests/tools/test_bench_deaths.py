"""`trocar bench deaths`: what it takes from records, and the table that it shows. It runs by hand: it takes minutes."""

from __future__ import annotations

import numpy as np
import pytest

from trocar.tools.bench.deaths import DeathEffect, _stands

FIELDS = [("stamp_ns", "i8"), ("powered", "?", (2,)), ("setpoint_cp", "f8", (7,))]


def records(*rows: tuple[int, bool, float]) -> np.ndarray:
    """At ms, with power, the setpoint there (m)."""
    made = np.zeros(len(rows), FIELDS)
    for row, (ms, powered, place) in zip(made, rows, strict=True):
        row["stamp_ns"], row["powered"][1], row["setpoint_cp"][0] = ms * 1_000_000, powered, place
    return made


def test_an_effect_counts_from_the_first_record_that_shows_it() -> None:
    found = DeathEffect("off", "IO1", lambda rows: ~rows["powered"].any(axis=1))._found
    assert found(records((10, True, 0), (12, False, 0), (14, False, 0)), 9_000_000) == pytest.approx(0.003)
    assert found(records((10, True, 0), (12, True, 0)), 9_000_000) == found(records((10, False, 0)), 9_000_000) == 0.0


def test_a_slave_stands_from_its_last_motion_on() -> None:
    way = records((10, True, 0.0), (12, True, 0.1), (14, True, 0.2), (16, True, 0.2), (100, True, 0.2))
    assert not _stands(way).any(), "not for long"
    way = np.append(way, records((220, True, 0.2)))
    assert _stands(way).tolist() == [False, False, True, True, True, True]
