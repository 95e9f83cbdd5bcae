"""`trocar bench boards`: ratios of turns side by side, every figure, and nothing left behind."""

from __future__ import annotations

import contextlib
import math
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from unittest.mock import Mock

import pytest

from trocar.procs.machine.paths import ROOT
from trocar.procs.native.library import native
from trocar.shm.memory.segment import names_of
from trocar.tools.bench import boards as bench_boards
from trocar.tools.bench.boards import COMPARED, FIGURES, NUMPY
from trocar.tools.bench.children import Report
from trocar.tools.output.errors import Problem


class ScriptedTeam:
    """Its turns give these medians of a cycle, ns, one after the other."""

    def __init__(self, medians: list[int]) -> None:
        self._medians = iter(medians)

    def wait(self) -> None:
        """Be ready."""

    def measure(self, turn_s: float) -> Report:
        p50 = next(self._medians)
        measured = {name.partition(" ")[2] for name, _, _ in (*FIGURES.values(), *COMPARED.values())}
        return {what: {"p10": p50 - 1, "p50": 2 * p50 if what == "paused" else p50, "p99": 3 * p50, "n": 10}
                for what in measured}


def test_ratios_are_formed_with_both_neighbours_and_of_paused_windows(monkeypatch: pytest.MonkeyPatch) -> None:
    medians = {10: [80_000, 120_000], 2: [40_000, 80_000, 20_000], 8: [30_000] * 2, NUMPY: [90_000] * 2}
    monkeypatch.setattr(bench_boards, "_team", lambda boards: contextlib.nullcontext(ScriptedTeam(medians[boards])))
    monkeypatch.setattr(bench_boards, "native", lambda: Mock(library=object()))
    figures = bench_boards.run(rounds=2)["figures"]
    assert figures["ratio_10_vs_2"] == 1.75, "of 2 and 1, 1.5 and 6"
    assert figures["native_ratio"] == 3.0
    assert (figures["cycle_cpu_us_p50"], figures["cycle_cpu_us_p99"]) == (100.0, 300.0)
    assert figures["cycle_cpu_us_p50_2"] == 40.0, "of 40, 80 and 20: a turn between two rounds counts once"


@pytest.mark.slow
def test_a_short_bench_gives_every_figure(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    result = bench_boards.run(rounds=1, turn_s=0.05)
    figures = result["figures"]
    there = native().library is not None
    compared = {"native_ratio", *COMPARED} if there else {key for key in COMPARED if not key.endswith("_numpy")}
    assert set(figures) == {*FIGURES, *compared, "ratio_10_vs_2"}
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
