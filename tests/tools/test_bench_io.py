"""`trocar bench io`: what is put together from the measurements, and one short measurement of the real thing."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from shm.segment import names_of
from tools.bench import io_loop as bench_io


def keeping_up_to(limit_hz: float) -> Callable[[float], float]:
    """A machine that misses a hundredth of its deadlines above a rate, one in 5000 below."""
    return lambda hz: 0.0002 if hz <= limit_hz else 0.01


@pytest.mark.parametrize(("limit_hz", "tried"), [
    (4100, [3000, 3500, 4000, 4500]),
    (2100, [2000, 2500, 3000]),
    (100, [500, 1000, 1500, 2000, 2500, 3000]),
    (10**9, list(range(3000, 8001, 500))),
])
def test_the_rate_is_sought_from_3_khz_in_the_direction_it_lies(limit_hz: float, tried: list[int]) -> None:
    missed = bench_io.sustained(keeping_up_to(limit_hz))
    assert sorted(missed) == tried
    assert [hz for hz in missed if missed[hz] < bench_io.MAX_MISSED] == [hz for hz in missed if hz <= limit_hz]


def test_figures_without_a_number_are_of_eight_boards(monkeypatch: pytest.MonkeyPatch) -> None:
    def measure(file: Path, seconds: float, *sets: str) -> dict[str, Any]:
        assert seconds == 5.0 and not [each for each in sets if "cpu=" not in each]
        return {"read_to_write_us_p50": 50.0 + boards_of(file), "packets_per_cycle": 4.0}

    def part_missed(file: Path, seconds: float, *sets: str) -> float:
        assert (boards_of(file), seconds) == (8, 10.0)
        return keeping_up_to(3600)(1.0 / float(sets[0].removeprefix("io.period_s=")))

    def boards_of(file: Path) -> int:
        return 2 * file.read_text().count("type: PSM")

    monkeypatch.setattr(bench_io, "_measure", measure)
    monkeypatch.setattr(bench_io, "_part_missed", part_missed)
    result = bench_io.run()
    assert result["figures"] == {
        "read_to_write_us_p50_2": 52.0, "read_to_write_us_p50_4": 54.0, "read_to_write_us_p50": 58.0,
        "read_to_write_us_p50_10": 60.0, "packets_per_cycle_2": 4.0, "packets_per_cycle_4": 4.0,
        "packets_per_cycle": 4.0, "packets_per_cycle_10": 4.0, "ratio_10_vs_2": 60.0 / 52.0, "max_rate_hz": 3500,
    }
    assert list(result["conditions"]["missed_at_hz"]) == ["3000", "3500", "4000"]


@pytest.mark.slow
@pytest.mark.alone
def test_a_short_measurement_counts_the_packets_of_a_cycle(tmp_path: Path) -> None:
    for _ in range(3):  # others use lo, too
        found = bench_io._measure(bench_io.write_system(tmp_path, 1), 1.0)
        if found["packets_per_cycle"] < 4.5:
            break
    assert (found["boards"], found["axes"]) == (2, 7)
    assert 2.0 <= found["packets_per_cycle"] < 4.5  # fewer where a busy machine makes replies late
    assert 0.0 < found["read_to_write_us_p50"] <= found["read_to_write_us_p99"]
    assert found["cycles"] > 100
    assert not [parts for parts in names_of() if parts[0].startswith(f"bench-io-{os.getpid()}")]
