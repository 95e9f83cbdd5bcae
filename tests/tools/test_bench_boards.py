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
from trocar.procs.native.library import native
from trocar.shm.memory.segment import names_of
from trocar.tools.bench import boards as bench_boards
from trocar.tools.bench.boards import COMPARED, FIGURES
from trocar.tools.output.errors import Problem


@pytest.mark.slow
@pytest.mark.alone
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
