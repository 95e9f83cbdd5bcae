"""Tables of digital potentiometers."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from trocar.procs.fpga import lookup

MISSING = 31.4159


def ramp(low: float, high: float, gap: slice = slice(0, 0)) -> list[float]:
    row = np.linspace(low, high, lookup.ENTRIES)
    row[gap] = MISSING
    return row.tolist()


def test_a_table_survives_its_way_through_the_document() -> None:
    rows = [ramp(-3.0, 3.0), ramp(0.3, -0.01, slice(100, 700))]
    table = lookup.unpack(lookup.pack(rows), 2)
    assert table[0].tolist() == rows[0]
    assert np.isnan(table[1, 100:700]).all() and table[1, 700:].tolist() == rows[1][700:]


@pytest.mark.parametrize("row", [[1.0] * 4095, [1.0] * 4097, [float("nan")] * 4096, ["1"] * 4096, []])
def test_a_row_that_is_none_is_refused_with_its_number(row: list[float]) -> None:
    with pytest.raises(ValueError, match=r"lookup\[1\].*4096 finite numbers"):
        lookup.pack([ramp(0, 1), row])


def test_text_of_another_size_is_no_table() -> None:
    with pytest.raises(ValueError, match="potentiometer table"):
        lookup.unpack(lookup.pack([ramp(0, 1)]), 2)
    with pytest.raises(ValueError):
        lookup.unpack("not base64!", 1)


def test_readings_lead_back_to_where_they_came_from() -> None:
    wrapped = np.roll(ramp(-2.9, 2.9, slice(0, 400)), 1000).tolist()  # tables wrap around index 0
    table = lookup.unpack(lookup.pack([ramp(-3.0, 3.0), ramp(0.29, 0.0), wrapped]), 3)
    inverse = lookup.InverseLookup(table)
    rng = np.random.default_rng(1)
    for _ in range(500):
        q = rng.uniform((-3.0, 0.0, -2.3), (3.0, 0.29, 2.9))
        back = table[np.arange(3), inverse.readings(q)]
        assert np.abs(back - q).max() < 6.0 / 4096


def test_positions_beyond_a_table_read_as_its_ends_and_an_empty_row_as_0() -> None:
    table = lookup.unpack(lookup.pack([ramp(-1.0, 1.0), [MISSING] * 4096]), 2)
    inverse = lookup.InverseLookup(table)
    assert inverse.readings(np.array([-5.0, 0.0])).tolist() == [0, 0]
    assert inverse.readings(np.array([5.0, 0.0])).tolist() == [4095, 0]
    assert inverse.readings(np.array([np.nan, np.nan])).shape == (2,)


@pytest.mark.parametrize("name", ["ECM-438610", "PSM1-292409"])
def test_tables_of_real_arms_lead_back_to_a_milliradian(data: Callable[[str], Path], name: str) -> None:
    path = data(f"dvrk-site/jhu-daVinci-Si/sawRobotIO1394-{name}-PotentiometerLookupTable.json")
    rows = json.loads(path.read_text(encoding="utf-8"))["lookup"]
    table = lookup.unpack(lookup.pack(rows), len(rows))
    inverse = lookup.InverseLookup(table)
    low, high = np.nanmin(table, axis=1), np.nanmax(table, axis=1)
    for share in np.linspace(0.02, 0.98, 200):
        q = low + share * (high - low)
        back = table[np.arange(len(rows)), inverse.readings(q)]
        assert np.abs(back - q).max() < 0.012  # the coarsest place of the ECM's last joint is 23 mrad wide
