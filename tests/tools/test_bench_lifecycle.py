"""`trocar bench lifecycle`: one measurement, which leaves nothing behind."""

from __future__ import annotations

import os

import pytest

from trocar.procs.config import PROJECT_CONFIGS
from trocar.shm.memory.segment import names_of
from trocar.tools.bench import lifecycle


@pytest.mark.slow
def test_processes_come_and_go_and_nothing_is_left(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lifecycle, "TRIES", 1)
    monkeypatch.setattr(lifecycle, "FULL", PROJECT_CONFIGS / "systems" / "kinematic.yaml")
    figures = lifecycle.run()["figures"]
    assert set(figures) == {"up_s", "up_to_homed_s", "first_subscription_to_running_s", "last_left_to_stopped_s",
                            "restart_s", "down_s", "full_up_s", "full_down_s", "full_pss_mb"}
    assert 0.0 < figures["up_s"] < figures["up_to_homed_s"] and all(seconds > 0.0 for seconds in figures.values())
    assert not names_of(f"bench-lifecycle-{os.getpid()}")
