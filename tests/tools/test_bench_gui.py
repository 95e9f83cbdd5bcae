"""`trocar bench gui`: one short measurement, which leaves nothing behind."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from tests.retries import measured
from trocar.shm.memory.segment import names_of
from trocar.tools.bench import gui


@pytest.mark.slow
@pytest.mark.alone
def test_the_web_console_is_measured_and_nothing_is_left(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    figures = measured(monkeypatch, tmp_path, lambda: gui.run(seconds=1.0, pairs=1)["figures"],
                       lambda figures: all(figure > 0.0 for figure in figures.values()))
    assert 0.0 < figures["gui_cpu_percent_system"] < 100.0 and 0.0 < figures["gui_cpu_percent_3d"] < 100.0
    assert figures["gui_cpu_percent_no_browser"] >= 0.0 and figures["io_period_p99_ratio"] > 0.0
    assert not names_of(f"bench-gui-{os.getpid()}")
