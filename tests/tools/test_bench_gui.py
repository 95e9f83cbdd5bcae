"""`trocar bench gui`: one short measurement, which leaves nothing behind."""

from __future__ import annotations

import os

import pytest

from shm.segment import names_of
from tools.bench import gui


@pytest.mark.slow
@pytest.mark.alone
def test_the_web_console_is_measured_and_nothing_is_left() -> None:
    figures = gui.run(seconds=0.4, pairs=1)["figures"]
    assert 0.0 < figures["gui_cpu_percent_system"] < 100.0 and 0.0 < figures["gui_cpu_percent_3d"] < 100.0
    assert figures["gui_cpu_percent_no_browser"] >= 0.0 and figures["io_period_p99_ratio"] > 0.0
    assert not names_of(f"bench-gui-{os.getpid()}")
