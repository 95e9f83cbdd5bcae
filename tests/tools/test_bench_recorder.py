"""`trocar bench recorder`: one short measurement, which leaves nothing behind."""

from __future__ import annotations

import contextlib
import os

import pytest

from shm.segment import names_of
from tools.bench import recorder
from tools.errors import Problem


@pytest.mark.slow
@pytest.mark.alone
def test_the_recorder_is_measured_and_nothing_is_left() -> None:
    for forgiven in (Problem, Problem, ()):  # on a busy machine arms may not home, or who is measured has no core
        with contextlib.suppress(forgiven):
            figures = recorder.run(seconds=2.5, pairs=1)["figures"]
            if figures["mb_per_minute"] > 0.0 and figures["sequence_gaps"] == 0:
                break
    assert 0.0 < figures["recorder_cpu_percent"] < 100.0
    assert 0.0 < figures["mb_per_minute"] < figures["named_mb_per_minute"]
    assert figures["sequence_gaps"] == 0
    assert figures["io_period_p99_ratio"] > 0.0
    assert not names_of(f"bench-recorder-{os.getpid()}")
