"""`trocar bench start`: what is measured, and one measurement that leaves nothing behind."""

from __future__ import annotations

import os
from functools import partial

import pytest

from trocar.procs.config import PROJECT_CONFIGS
from trocar.shm.memory.segment import names_of
from trocar.tools.bench import start
from trocar.tools.bench.measuring import by_turns


def test_each_command_is_tried_by_turns_and_its_median_counts() -> None:
    tried: list[str] = []

    def once(name: str) -> dict[str, float]:
        tried.append(name)
        return {"s": float(len(tried)), "cpu_s": 0.5}

    found = by_turns(3, {name: partial(once, name) for name in ("help", "status")})
    assert tried == ["help", "status"] * 3
    assert found == {"help": {"s": 3.0, "cpu_s": 0.5}, "status": {"s": 4.0, "cpu_s": 0.5}}


@pytest.mark.slow
def test_verbs_are_measured_on_a_robot_that_is_gone_afterwards(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(start, "TRIES", 1)
    monkeypatch.setattr(start, "FULL", PROJECT_CONFIGS / "systems" / "kinematic.yaml")
    figures = start.run()["figures"]
    assert all(figure > 0.0 for figure in figures.values())
    assert max(figures["python_cpu_s"], figures["numpy_cpu_s"]) < figures["status_cpu_s"]
    assert not names_of(f"bench-start-{os.getpid()}")
