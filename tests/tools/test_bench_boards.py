"""`trocar bench boards`: ratios of turns side by side, every figure, and nothing left behind."""

from __future__ import annotations

import math
from collections.abc import Iterator
from unittest.mock import Mock

import numpy as np
import pytest

from trocar.procs.native.library import native
from trocar.shm.memory.segment import names_of
from trocar.tools.bench import boards as bench_boards
from trocar.tools.bench.boards import COMPARED, CYCLES, FIGURES, NUMPY, SETS, TimedBoards, summary
from trocar.tools.bench.children import Report
from trocar.tools.bench.host_run import HostRun


class ScriptedBoards:
    """Its turns give these medians of a cycle, ns, one after the other."""

    def __init__(self, medians: list[int]) -> None:
        self._medians = iter(medians)

    def turn(self, seconds: float) -> Report:
        p50 = next(self._medians)
        measured = {name.partition(" ")[2] for name, _, _ in (*FIGURES.values(), *COMPARED.values())}
        return {what: {"p10": p50 - 1, "p50": p50, "p99": 3 * p50, "n": 10} for what in measured}


def test_ratios_are_formed_with_both_neighbours(monkeypatch: pytest.MonkeyPatch) -> None:
    medians = {10: [80_000, 120_000], 2: [40_000, 80_000, 20_000], 8: [30_000] * 2, NUMPY: [90_000] * 2}
    monkeypatch.setattr(bench_boards, "_homed", lambda stack, boards: ScriptedBoards(medians[boards]))
    monkeypatch.setattr(bench_boards, "native", lambda: Mock(library=object()))
    figures = bench_boards.run(rounds=2)["figures"]
    assert figures["ratio_10_vs_2"] == 1.75, "of 2 and 1, 1.5 and 6"
    assert figures["native_ratio"] == 3.0
    assert (figures["cycle_cpu_us_p50"], figures["cycle_cpu_us_p99"]) == (100.0, 300.0)
    assert figures["cycle_cpu_us_p50_2"] == 40.0, "of 40, 80 and 20: a turn between two rounds counts once"


@pytest.fixture
def one_psm() -> Iterator[HostRun]:
    with HostRun("1psm", SETS) as run:
        yield run


@pytest.mark.slow
def test_every_cycle_of_io_is_counted_with_the_arm_moving(one_psm: HostRun) -> None:
    world, seconds = one_psm.host.loops["boards"].world, 0.2  # type: ignore[attr-defined]
    packets, steps, position = world.buses[0].packets, world.board_ns, world.position.copy()
    found = TimedBoards(one_psm).turn(seconds)
    cycles = (world.buses[0].packets - packets) / 3  # query, read, write
    assert cycles == pytest.approx(1500 * seconds, abs=2) and (world.board_ns - steps) * 1e-9 == pytest.approx(seconds)
    assert {row["n"] for row in found.values()} == {int(cycles) // CYCLES}
    assert all(0 < row["p10"] <= row["p50"] <= row["p99"] for row in found.values())
    assert np.abs(world.position - position).max() > 2e-3


@pytest.mark.slow
def test_a_short_bench_gives_every_figure(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bench_boards, "SIZES", {10: 1, 2: 1, 8: 1})  # more arms take longer to home
    figures = bench_boards.run(rounds=1, turn_s=0.1)["figures"]
    there = native().library is not None
    compared = {"native_ratio", *COMPARED} if there else {key for key in COMPARED if not key.endswith("_numpy")}
    assert set(figures) == {*FIGURES, *compared, "ratio_10_vs_2"}
    assert all(math.isfinite(x) and x > 0 for x in figures.values())
    assert not [parts for parts in names_of() if parts[0].startswith("bench")]


def test_times_are_of_one_cycle() -> None:
    assert summary([300 * k for k in range(101)]) == {"p10": 1000, "p50": 5000, "p99": 9900, "n": 101}
