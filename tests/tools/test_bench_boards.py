"""`trocar bench boards`: ratios of turns side by side, every figure, and nothing left behind."""

from __future__ import annotations

import math
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from trocar.procs.machine.paths import ROOT
from trocar.procs.native.library import kernel
from trocar.shm.memory.segment import names_of
from trocar.tools.bench import boards as bench_boards
from trocar.tools.bench.boards import COMPARED, FIGURES, BoardsReport, BoardsResult
from trocar.tools.output.errors import Problem


def turn(p50: int) -> BoardsReport:
    measured = {what for _, what, _ in FIGURES.values()}
    return {what: {"p10": p50 - 1, "p50": p50, "p99": 3 * p50, "n": 10} for what in measured}


def test_ratios_are_formed_with_both_neighbours() -> None:
    found = BoardsResult()
    found.keep_round(turn(40_000), turn(80_000), turn(80_000))  # 2 and 1
    found.keep_round(turn(80_000), turn(120_000), turn(20_000))  # 1.5 and 6
    figures = found.figures()
    assert figures["ratio_10_vs_2"] == 1.75
    assert (figures["cycle_cpu_us_p50"], figures["cycle_cpu_us_p99"]) == (100.0, 300.0)
    assert figures["cycle_cpu_us_p50_2"] == 40.0  # of 40, 80 and 20: a turn between two rounds counts once
    assert found.span() == "80.0 to 120.0"


def test_eight_boards_are_compared_with_and_without_the_kernel() -> None:
    found = BoardsResult()
    found.keep_round(turn(40_000), turn(80_000), turn(80_000))
    found.keep_eight(turn(30_000), turn(90_000))
    figures = found.figures()
    assert (figures["cycle_cpu_us_p50_8"], figures["cycle_cpu_us_p50_8_numpy"], figures["kernel_ratio"]) == (30, 90, 3)


@pytest.mark.slow
@pytest.mark.alone
def test_a_short_bench_gives_every_figure(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    result = bench_boards.run(rounds=1, turn_s=0.05)
    figures = result["figures"]
    assert result["bench"] == "boards"
    numpy = {"kernel_ratio", *(f"{key}_numpy" for key in COMPARED)} if kernel().library is not None else set()
    assert set(figures) == {*FIGURES, *COMPARED, *numpy, "ratio_10_vs_2"}
    assert all(math.isfinite(x) and x > 0 for x in figures.values())
    assert list(tmp_path.iterdir()) == []
    assert not [parts for parts in names_of() if parts[0].startswith(f"bench{os.getpid()}-")]


@pytest.mark.slow
def test_boards_that_fail_end_the_bench(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.setattr(bench_boards, "to_json", lambda system: b"no document")
    with pytest.raises(Problem, match="boards ended with 1: ValueError: the document is not readable"):
        bench_boards.run(rounds=1, turn_s=0.01)
    assert list(tmp_path.iterdir()) == []
    assert not [parts for parts in names_of() if parts[0].startswith(f"bench{os.getpid()}-")]


@pytest.mark.slow
def test_the_measuring_half_says_who_starts_it() -> None:
    done = subprocess.run([sys.executable, "-m", "trocar.procs.boards.cost"], cwd=ROOT, capture_output=True, text=True,
                          check=False)
    assert done.returncode == 1 and done.stderr == "started by: trocar bench boards\n"
