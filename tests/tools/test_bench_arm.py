"""A short `trocar bench arm`: every figure is there, and makes sense."""

from __future__ import annotations

import os

import pytest

from procs.arm.loop import AT_REST, REST_PERIODS, SHORT_PERIODS, most_periods
from shm import directory
from shm.segment import names_of
from tools.bench import arm as bench_arm

KEYS = ("cycle_cpu_us_p50", "cycle_following_cpu_us_p50", "fk_jacobian_us_p50", "ik_near_us_p50",
        "ik_unreachable_us_p999")


@pytest.mark.slow
@pytest.mark.alone
def test_a_short_bench_gives_every_figure_and_leaves_nothing() -> None:
    result = bench_arm.run(cycles=60, poses=60)
    figures = result["figures"]
    assert result["bench"] == "arm" and all(figures[key] > 0.0 for key in KEYS)
    assert figures["cycle_following_cpu_us_p50"] > figures["cycle_holding_cpu_us_p50"] > 0.0
    assert figures["cycle_wanted_cpu_us_p50"] > 0.0
    assert figures["ik_unreachable_poses"] > 10
    if result["conditions"]["computed_by"] == "the kernel":
        assert all(figures[f"{key}_numpy"] > 0.0 for key in KEYS) and figures["kernel_ratio"] > 0.0
    assert not names_of(f"bench-arm-{os.getpid()}")


def test_a_played_arm_may_rest_until_it_is_asked_for_something() -> None:
    with bench_arm.ArmBench("kinematic") as bench:
        loop = bench._loop
        for _ in range(AT_REST + 3):
            bench.step()
        assert loop.may_rest
        bench.send("state_command", (), "enable")
        bench.step()
        assert not loop.may_rest
        for _ in range(3 * AT_REST):
            bench.step()
        assert loop.may_rest and bench.arm.state == "ENABLED"


def test_an_arm_that_is_short_of_time_takes_every_second_cycle_and_says_so_once() -> None:
    with bench_arm.ArmBench("kinematic") as bench:
        loop = bench._loop
        reported = directory.reader(bench.name, "PSM1", "events")
        assert [loop.periods(short, bench.now_ns) for short in (False, True, True)] == [1, SHORT_PERIODS, SHORT_PERIODS]
        for _ in range(AT_REST + 3):
            bench.step()
        assert loop.periods(True, bench.now_ns) == REST_PERIODS and loop.periods(False, bench.now_ns) == 1
        warnings = [row["text"].decode() for row in reported.since(0) if row["code"] == b"cpu-overload"]
        reported.close()
    assert warnings == ["PSM1: the machine is short of time: one cycle in 2"]


def test_an_arm_that_is_slow_by_its_file_is_never_so_slow_that_it_seems_silent() -> None:
    assert most_periods(1 / 1500) >= REST_PERIODS and most_periods(0.01) == 1 == most_periods(0.02)
