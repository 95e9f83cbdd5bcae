"""Benchmarks of what runs beside a robot: one short measurement of each at one arm, which leaves nothing behind."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from tests.retries import measured
from trocar.procs.config import PROJECT_CONFIGS
from trocar.shm.memory.segment import names_of
from trocar.tools.bench import beside, bridges, gui, recorder

pytestmark = pytest.mark.slow
SLOWER = "trocar: {io: {period_s: 0.002}, arm: {period_s: 0.002}}\n"


@pytest.fixture(autouse=True)
def one_arm(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """One arm at 500 Hz instead of the full robot, and short times before each measurement."""
    file = tmp_path / "one.yaml"
    file.write_text((PROJECT_CONFIGS / "systems" / "kinematic.yaml").read_text() + SLOWER)
    monkeypatch.setattr(beside, "FULL", file)
    for module in (beside, bridges, gui):
        monkeypatch.setattr(module, "ARMS", ("PSM1",))
    for part in (bridges, gui, recorder):
        monkeypatch.setattr(part, "SETTLE_S", 0.3)
    monkeypatch.setattr(bridges, "COMMANDS", 20)
    monkeypatch.setattr(gui, "SYSTEM_PAGE", ("PSM1/state", "system/state", "messages"))


def test_the_web_console_is_measured_and_nothing_is_left(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    figures = measured(monkeypatch, tmp_path, lambda: gui.run(seconds=0.5, pairs=1)["figures"],
                       lambda figures: all(figure > 0.0 for figure in figures.values()))
    assert 0.0 < figures["gui_cpu_percent_system"] < 100.0 and 0.0 < figures["gui_cpu_percent_3d"] < 100.0
    assert figures["gui_cpu_percent_no_browser"] >= 0.0 and figures["io_period_p99_ratio"] > 0.0
    assert not names_of(f"bench-gui-{os.getpid()}")


def test_bridges_are_measured_and_nothing_is_left(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    figures = measured(monkeypatch, tmp_path, lambda: bridges.run(seconds=0.5, pairs=1)["figures"],
                       lambda figures: figures["ros_messages_per_s"] > 30.0)
    assert figures["ros_cpu_percent_30_topics"] > 0.0
    assert figures["socket_command_ms_p50"] > 0.0 and figures["io_period_p99_ratio"] > 0.0
    assert not names_of(f"bench-bridges-{os.getpid()}")


def test_the_recorder_is_measured_and_nothing_is_left(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    figures = measured(monkeypatch, tmp_path, lambda: recorder.run(seconds=1.0, pairs=1)["figures"],
                       lambda figures: figures["mb_per_minute"] > 0.0 and figures["sequence_gaps"] == 0)
    assert 0.0 < figures["recorder_cpu_percent"] < 100.0
    assert 0.0 < figures["mb_per_minute"] < figures["named_mb_per_minute"]
    assert figures["sequence_gaps"] == 0 and figures["io_period_p99_ratio"] > 0.0
    assert not names_of(f"bench-recorder-{os.getpid()}")
