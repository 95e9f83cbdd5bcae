"""`trocar bench recorder`: one short measurement, which leaves nothing behind."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from tests.retries import measured
from trocar.procs.config import PROJECT_CONFIGS
from trocar.shm.memory.segment import names_of
from trocar.tools.bench import beside, recorder

TWO_ARMS = PROJECT_CONFIGS / "systems" / "kinematic-teleop.yaml"


@pytest.mark.slow
@pytest.mark.alone
def test_the_recorder_is_measured_and_nothing_is_left(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(beside, "FULL", TWO_ARMS)
    monkeypatch.setattr(beside, "ARMS", ("PSM1", "MTMR"))
    figures = measured(monkeypatch, tmp_path, lambda: recorder.run(seconds=1.5, pairs=1)["figures"],
                       lambda figures: figures["mb_per_minute"] > 0.0 and figures["sequence_gaps"] == 0)
    assert 0.0 < figures["recorder_cpu_percent"] < 100.0
    assert 0.0 < figures["mb_per_minute"] < figures["named_mb_per_minute"]
    assert figures["sequence_gaps"] == 0
    assert figures["io_period_p99_ratio"] > 0.0
    assert not names_of(f"bench-recorder-{os.getpid()}")
