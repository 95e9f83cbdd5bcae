"""The children of a bench: one line each way, and whoever dies, hangs or will not go is dealt with."""

from __future__ import annotations

import contextlib
import sys
from pathlib import Path

import psutil
import pytest

from trocar.tools.bench import children as bench_children
from trocar.tools.bench.children import WARM_UP, Team, summary
from trocar.tools.output.errors import Problem

READY = "print('{}', flush=True)\n"
ANSWERS = READY + "import sys\nfor line in sys.stdin: print('{\"%s\": {\"p50\": 1}}' % sys.argv[1], flush=True)"
STUBBORN = (READY + "import signal, subprocess, sys\n"
            "child = subprocess.Popen([sys.executable, '-c', 'import signal; signal.pause()'])\n"
            "open(sys.argv[1], 'w').write(str(child.pid))\n"
            "input(); print('{}', flush=True)\nsignal.pause()")


def python(code: str, *arguments: str) -> list[str]:
    return [sys.executable, "-c", code, *arguments]


def test_percentiles_leave_the_warm_up_out() -> None:
    assert summary([10_000] * WARM_UP + list(range(100, 0, -1))) == {"p50": 51, "p99": 100, "n": 100}
    assert summary([3, 1, 2]) == {"p50": 2, "p99": 3, "n": 3}
    with pytest.raises(Problem, match=r"nothing was measured"):
        summary([])


@pytest.mark.slow
def test_every_child_says_what_it_measured() -> None:
    with Team("test", {"a": python(ANSWERS, "one"), "b": python(ANSWERS, "two")}) as team:
        team.wait()
        for _ in range(2):
            assert team.measure(0.01) == {"one": {"p50": 1}, "two": {"p50": 1}}


@pytest.mark.slow
def test_a_child_that_ends_is_told_with_its_last_word() -> None:
    with Team("test", {"a": python(ANSWERS, "one"), "b": python(READY + "input(); raise SystemExit('oh')")}) as team:
        team.wait()
        with pytest.raises(Problem, match=r"^bench test: b ended with 1: oh$"):
            team.measure(0.01)


@pytest.mark.slow
def test_a_child_that_falls_silent_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    with Team("test", {"b": python(READY + "input(); input(); input()")}) as team:
        team.wait()
        monkeypatch.setattr(bench_children, "PATIENCE_S", 0.3)
        with pytest.raises(Problem, match=r"^bench test: b did not answer within 0.31 s$"):
            team.measure(0.01)


@pytest.mark.slow
def test_who_will_not_go_is_killed_with_its_children(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bench_children, "FAREWELL_S", 0.1)
    note = tmp_path / "pid"
    with Team("test", {"a": python(STUBBORN, str(note))}) as team:
        team.wait()
        team.measure(0.01)
    monkeypatch.setattr(bench_children, "FAREWELL_S", 30.0)
    with contextlib.suppress(psutil.NoSuchProcess):
        assert bench_children._gone(psutil.Process(int(note.read_text())))
