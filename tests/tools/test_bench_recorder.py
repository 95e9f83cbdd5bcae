"""`trocar bench recorder`: one short measurement, which leaves nothing behind."""

from __future__ import annotations

import os

import pytest

from shm.segment import names_of
from tools.bench import recorder


@pytest.mark.slow
@pytest.mark.alone
def test_the_recorder_is_measured_and_nothing_is_left() -> None:
    figures = recorder.run(seconds=1.2, pairs=1)["figures"]
    assert 0.0 < figures["recorder_cpu_percent"] < 100.0
    assert 0.0 < figures["mb_per_minute"] < figures["named_mb_per_minute"]
    assert figures["sequence_gaps"] == 0
    assert figures["io_period_p99_ratio"] > 0.0
    assert not names_of(f"bench-recorder-{os.getpid()}")
