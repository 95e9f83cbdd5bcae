"""A short `trocar bench arm`: every figure is there, and makes sense."""

from __future__ import annotations

import os

import numpy as np
import pytest

from trocar.procs.arm.loop import AT_REST, PERIODS_OVERLOADED, most_periods
from trocar.procs.arm.motion import Mode
from trocar.procs.config import PROJECT_CONFIGS
from trocar.procs.host.stepped_arm import SteppedArm
from trocar.procs.native.library import native
from trocar.shm.memory.segment import names_of
from trocar.shm.system import directory
from trocar.shm.system.subscriptions import Subscriber
from trocar.tools.bench import arm as bench_arm

KEYS = ("cycle_cpu_us_p50", "cycle_following_cpu_us_p50", "fk_jacobian_us_p50", "ik_near_us_p50",
        "ik_unreachable_us_p999")


@pytest.mark.slow
def test_a_short_bench_gives_every_figure_and_leaves_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    assert all((PROJECT_CONFIGS / "systems" / f"{file}.yaml").exists() for file in bench_arm.FILES.values())
    monkeypatch.setattr(bench_arm, "FILES", {"": "kinematic"})
    result = bench_arm.run(cycles=60, poses=60)
    figures = result["figures"]
    assert all(figures[key] > 0.0 for key in KEYS)
    assert figures["cycle_following_cpu_us_p50"] > figures["cycle_holding_cpu_us_p50"] > 0.0
    assert figures["cycle_wanted_cpu_us_p50"] > 0.0
    assert figures["ik_unreachable_poses"] > 10
    if native().library is not None:
        assert all(figures[f"{key}_numpy"] > 0.0 for key in KEYS) and figures["native_ratio"] > 0.0
    assert not names_of(f"bench-arm-{os.getpid()}")


def _steps(bench: SteppedArm, count: int) -> None:
    for _ in range(count):
        bench.step()


def test_an_arm_rests_until_it_is_asked_for_something() -> None:
    with bench_arm.arm_bench("kinematic") as bench:
        loop = bench.loop
        assert loop.rest_periods == 15 and not loop.may_rest
        _steps(bench, AT_REST + 3)
        assert loop.may_rest and not loop.has_news()
        bench.send("state_command", (), "enable")
        assert loop.has_news()
        bench.step()
        assert not loop.may_rest
        _steps(bench, 3 * AT_REST)
        assert loop.may_rest and bench.arm.state == "ENABLED"


def test_an_arm_does_not_rest_while_a_reader_wants_every_record() -> None:
    with bench_arm.arm_bench("kinematic") as bench:
        loop = bench.loop
        _steps(bench, AT_REST + 3)
        for every in (False, True):
            subscriber = Subscriber(bench.name, "PSM1", every=every)
            subscriber.want("state")
            bench.step()
            assert loop.may_rest is not every
            subscriber.close()
            bench.step()
            assert loop.may_rest


@pytest.mark.slow
def test_an_arm_that_moves_or_pushes_or_follows_takes_every_cycle() -> None:
    with bench_arm.arm_bench("kinematic") as bench:
        loop, motion = bench.loop, bench.arm.control.motion
        bench_arm.home(bench)
        _steps(bench, AT_REST + 3)
        assert loop.may_rest
        here = bench.arm.io.setpoint[: bench.arm.joints.count].copy()
        here[0] += 0.5
        bench.send("move_jp", here)
        _steps(bench, 2)
        while motion.moving:
            assert not loop.may_rest
            bench.step()
        assert not loop.may_rest
        _steps(bench, AT_REST + 3)
        assert loop.may_rest
        bench.send("servo_jf", np.zeros(bench.arm.joints.count))
        _steps(bench, 2 * AT_REST)
        assert motion.mode is Mode.EFFORT and not loop.may_rest


def test_an_arm_that_is_short_of_time_takes_fewer_cycles_and_says_so_once() -> None:
    with bench_arm.arm_bench("kinematic") as bench:
        loop = bench.loop
        reported = directory.reader(bench.name, "PSM1", "events")
        moving = [loop.periods(short, bench.now_ns) for short in (False, True, True)]
        assert moving == [1, PERIODS_OVERLOADED, PERIODS_OVERLOADED]
        warnings = [row["text"].decode() for row in reported.since(0) if row["code"] == b"cpu-overload"]
        reported.close()
    assert warnings == ["PSM1: the machine is overloaded: one cycle in 2"]


def test_an_arm_that_is_slow_by_its_file_is_never_so_slow_that_it_seems_silent() -> None:
    assert most_periods(1 / 1500) >= PERIODS_OVERLOADED and most_periods(0.01) == 1 == most_periods(0.02)
