"""A short `trocar bench rl`: every figure is there, and all hashes are equal."""

from __future__ import annotations

import pytest

from trocar.shm.memory.segment import names_of
from trocar.tools.bench import rl as bench_rl

RATIOS = ("kinematic_500_realtime_ratio", "boards_500_realtime_ratio", "boards_4psm_env_s_per_cpu_s")


@pytest.mark.slow
def test_a_short_bench_gives_every_figure_and_the_same_hashes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bench_rl, "FOUR_PSMS", bench_rl.KINEMATIC)  # four take four times as long to home
    result = bench_rl.run(seconds=0.1, windows=2, resets=3, processes=False)
    figures, conditions = result["figures"], result["conditions"]
    assert not result["problems"]
    assert all(figures[name] >= figures[f"{name}_p05"] > 0.0 for name in RATIOS)
    assert figures["reset_ms_p99"] >= figures["reset_ms_p50"] > 0.0
    assert figures["hashes_equal"] == 1 and figures["ray_scaling_4"] is None
    assert {kind: len(rows) for kind, rows in conditions["hashes"].items()} == {"kinematic": 3, "boards": 3}
    assert len(conditions["load_before"]) == 3
    assert not [name for name in names_of() if name[0].startswith("bench-rl")]
