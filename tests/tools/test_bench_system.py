"""`trocar bench system`: what is made of the counters, and one short measurement of a master and a slave."""

from __future__ import annotations

import importlib
import json
import shlex
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from tests.conftest import ROOT
from tests.retries import measured
from tests.system.robot import SLOWER
from trocar.shm.memory.segment import names_of
from trocar.tools.bench import system as bench_system
from trocar.tools.bench.system import Mark, figures, row
from trocar.tools.cli import VERBS, examples_of
from trocar.tools.output.errors import Misuse
from trocar.tools.verbs.bench import bench


def mark(at_s: float, pid: int, cycles: int, missed: int, cpu_s: float, kind: str = "io") -> Mark:
    return Mark(round(at_s * 1e9), round(at_s * 1e9), kind, pid, cycles, missed, 0, cpu_s, "FIFO 80", 40.0)


def test_row_tells_what_happened_in_the_window() -> None:
    made = row("io", mark(5.0, 7, 1000, 50, 1.0), mark(6.0, 7, 1990, 60, 1.5))
    assert (made["rate_hz"], made["missed_percent"], made["cpu_percent"]) == (990.0, 1.0, 50.0)


def test_process_started_anew_counts_from_its_start() -> None:
    made = row("io", mark(5.0, 7, 1000, 50, 9.0), mark(5.5, 8, 100, 0, 0.25))
    assert (made["rate_hz"], made["missed"], made["cpu_percent"]) == (200.0, 0, 50.0)


def test_figures_are_those_of_the_worst_io_and_of_all_processes() -> None:
    rows = [row("IO1", mark(0.0, 1, 0, 0, 0.0), mark(1.0, 1, 1500, 0, 0.2)),
            row("IO2", mark(0.0, 2, 0, 0, 0.0), mark(1.0, 2, 990, 10, 0.2)),
            row("PSM1", mark(0.0, 3, 0, 0, 0.0, "arm"), mark(1.0, 3, 980, 20, 0.1, "arm")),
            row("boards1", mark(0.0, 4, 0, 0, 0.0, "boards"), mark(1.0, 4, 1500, 0, 0.25, "boards"))]
    found = figures(rows)
    assert found["io_rate_hz"] == 990.0 and found["io_missed_percent"] == 1.0
    assert found["cpu_percent_without_boards"] == pytest.approx(50.0) and found["arm_missed_percent"] == 2.0
    assert found["cpu_percent_boards"] == pytest.approx(25.0) and found["cpu_percent_total"] == pytest.approx(75.0)
    assert found["locked_mb"] == 160.0


def test_options_of_another_bench_are_refused() -> None:
    for name in ("ring", "io"):
        with pytest.raises(Misuse, match=f"bench {name} takes no seconds"):
            bench(name, None, None, "", 3.0)
    with pytest.raises(Misuse, match="no bench nothing"):
        bench("nothing", None, None, "", 0.0)


@pytest.mark.parametrize("as_json", [True, False])
def test_a_bench_shows_figures_the_machine_and_problems(
        as_json: bool, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    ran = {"figures": {"us_p50": 1.5}, "conditions": {"cores": "two"}, "problems": ["too busy"]}
    monkeypatch.setattr(importlib, "import_module", lambda name: SimpleNamespace(run=lambda: ran))
    assert bench("ring", as_json=as_json) == 1
    shown = capsys.readouterr().out
    if as_json:
        row = json.loads(shown)
        assert (row["bench"], row["figures"], row["problems"]) == ("ring", ran["figures"], ran["problems"])
        assert row["conditions"]["cores"] == "two" and "python" in row["conditions"], "its own count"
    else:
        assert all(words in shown for words in ("us_p50", "python", "PROBLEM: too busy"))


def test_missing_file_is_a_problem_that_names_it(tmp_path: Path) -> None:
    with pytest.raises(bench_system.Problem, match=r"absent\.json"):
        bench_system.run(tmp_path / "absent.json")


@pytest.mark.slow
def test_the_example_of_help_measures_every_process_and_what_follows(
        monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (example,) = (line for verb in VERBS for line in examples_of(verb) if line.startswith("trocar bench"))
    # One pair at 500 Hz: a slow machine keeps up with it.
    smaller = example.replace("--seconds 5", f"{ROOT / 'configs/systems/kinematic-teleop.yaml'} --seconds 1")
    command = [sys.executable, "-m", "trocar", *shlex.split(smaller)[1:], *SLOWER]

    def run() -> dict[str, Any]:
        with subprocess.Popen(command, cwd=ROOT, text=True, stdout=subprocess.PIPE,
                              stderr=subprocess.PIPE) as done:
            reported, problem = done.communicate(timeout=180)
        assert not names_of(f"bench-system-{done.pid}")
        if not reported:
            raise bench_system.Problem(problem)
        return dict(json.loads(reported))

    result = measured(monkeypatch, tmp_path, run,
                      lambda found: len(found["homed"]) == 2 and len(found["following"]) == 1)
    rows = {each["name"]: each for each in result["processes"]}
    assert {"io", "MTMR", "PSM1", "MTMR_PSM1", "console", "system", "bench"} <= set(rows)
    assert result["homed"] == ["MTMR", "PSM1"] and result["figures"]["arms"] == 2
    assert result["following"] == ["MTMR_PSM1"], result["problems"]
    assert all(rows[name]["cpu_percent"] > 0.0 for name in ("io", "PSM1", "MTMR_PSM1"))
    figures = result["figures"]
    assert 0.0 < figures["cpu_percent_rest"] < figures["cpu_percent_following"] and 0.0 < figures["up_s"] < 180.0
    assert figures["arm_period_p99_us"] > 1000.0, "at 500 Hz"
    assert 50.0 < figures["pss_mb"] < 1000.0
    rights = [each["scheduling"] for each in rows.values() if "scheduling" in each]
    assert (result["figures"]["locked_mb"] > 100.0) == any(words.endswith(", locked") for words in rights)
