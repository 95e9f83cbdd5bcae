"""`trocar bench bridges`: one short measurement, which leaves nothing behind."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from tests.retries import measured
from trocar.procs.config import PROJECT_CONFIGS
from trocar.shm.memory.segment import names_of
from trocar.tools.bench import beside, bridges

TWO_ARMS = PROJECT_CONFIGS / "systems" / "kinematic-teleop.yaml"


@pytest.mark.slow
@pytest.mark.alone
def test_bridges_are_measured_and_nothing_is_left(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(beside, "FULL", TWO_ARMS)
    monkeypatch.setattr(bridges, "ARMS", ("PSM1", "MTMR"))
    figures = measured(monkeypatch, tmp_path, lambda: bridges.run(seconds=1.0, pairs=1)["figures"],
                       lambda figures: figures["ros_messages_per_s"] > 30.0)
    assert figures["ros_cpu_percent_30_topics"] > 0.0
    assert figures["socket_command_ms_p50"] > 0.0 and figures["io_period_p99_ratio"] > 0.0
    assert not names_of(f"bench-bridges-{os.getpid()}")
