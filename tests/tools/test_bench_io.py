"""`trocar bench io`: what is put together from the measurements, and one short measurement of the real thing."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.retries import measured
from trocar.shm.memory.segment import names_of
from trocar.tools.bench import io_loop as bench_io
from trocar.tools.bench.io_loop import Baseline
from trocar.tools.output.errors import Problem


def keeping_up_to(limit_hz: float) -> Callable[[float], tuple[float, float]]:
    """A machine on which io misses a hundredth more of its deadlines than C programs do above a rate, less below."""
    return lambda hz: (0.021 if hz <= limit_hz else 0.03, 0.02)


@pytest.mark.parametrize(("limit_hz", "tried"), [
    (4100, [3000, 3500, 4000, 4500]),
    (2100, [2000, 2500, 3000]),
    (100, [500, 1000, 1500, 2000, 2500, 3000]),
    (10**9, list(range(3000, 8001, 500))),
])
def test_the_rate_is_sought_from_3_khz_in_the_direction_it_lies(limit_hz: float, tried: list[int]) -> None:
    missed = bench_io.sustained(keeping_up_to(limit_hz))
    assert sorted(missed) == tried
    kept = [hz for hz, (ours, theirs) in missed.items() if ours <= theirs + bench_io.MORE_MISSED]
    assert kept == [hz for hz in missed if hz <= limit_hz]


def test_the_c_programs_exchange_datagrams_and_count_what_they_miss(tmp_path: Path) -> None:
    baseline = Baseline(tmp_path)
    if baseline.why_not:
        pytest.skip(f"no compiler: {baseline.why_not}")
    for _ in range(3):  # on a busy machine hardly any write may be in time
        found = baseline.run(500.0, 1.0, -1, -1)
        if found.reply_to_write_us_p50 > 0.0:
            break
    assert 0.0 <= found.missed < 1.0 and 0.0 < found.reply_to_write_us_p50 <= found.reply_to_write_us_p99
    assert found.cpu_us > 0.0


def test_without_a_compiler_there_is_no_baseline_and_the_bench_says_why(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("CC", str(tmp_path / "absent"))
    assert "absent" in Baseline(tmp_path).why_not


@pytest.mark.slow
def test_a_short_measurement_counts_the_packets_of_a_cycle(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    found = measured(monkeypatch, tmp_path, lambda: bench_io._measure(bench_io.write_system(tmp_path, 1), 1.0),
                     lambda found: found["packets_per_cycle"] < 4.9 and found["cycles"] > 100)
    assert (found["boards"], found["axes"]) == (2, 7)
    assert 2.0 <= found["packets_per_cycle"] < 4.9  # of four, fewer or more where a busy machine makes replies late
    assert 0.0 < found["read_to_write_us_p50"] <= found["read_to_write_us_p99"]
    assert found["cycles"] > 100
    assert not [parts for parts in names_of() if parts[0].startswith(f"bench-io-{os.getpid()}")]


def test_a_rate_at_which_no_robot_can_be_homed_misses_everything() -> None:
    def cannot() -> float:
        raise Problem("the arms did not home: PSM1: io was restarted")

    assert bench_io.part_missed(lambda: 0.25) == (0.25, "")
    assert bench_io.part_missed(cannot) == (1.0, "the arms did not home: PSM1: io was restarted")
