"""`trocar bench start`: what is measured, and one measurement that leaves nothing behind."""

from __future__ import annotations

import os

import pytest

from trocar.shm.memory.segment import names_of
from trocar.tools.bench import start


def test_each_command_is_tried_by_turns_and_its_median_counts(monkeypatch: pytest.MonkeyPatch) -> None:
    tried: list[str] = []

    def once(*words: str) -> tuple[float, float]:
        tried.append(words[0])
        return float(len(tried)), 0.5

    monkeypatch.setattr(start, "_once", once)
    found = start._by_turns({"help": ("help",), "status": ("status",)})
    assert tried[:4] == ["help", "status", "help", "status"] and len(tried) == 2 * start.TRIES
    assert found == {"help_s": start.TRIES, "help_cpu_s": 0.5, "status_s": start.TRIES + 1, "status_cpu_s": 0.5}


@pytest.mark.slow
def test_verbs_are_measured_on_a_whole_robot_that_is_gone_afterwards(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(start, "TRIES", 1)
    figures = start.run()["figures"]
    assert all(figure > 0.0 for figure in figures.values())
    assert max(figures["python_cpu_s"], figures["numpy_cpu_s"]) < figures["status_cpu_s"]
    assert not names_of(f"bench-start-{os.getpid()}")
