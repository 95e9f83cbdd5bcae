"""The storm itself. By hand, with a seed of one's own: python -m tests.soak.storm --seed 7 --events 300."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from tests.soak.storm import Storm

SEED = int(os.environ.get("TROCAR_STORM_SEED", "1"))
EVENTS = int(os.environ.get("TROCAR_STORM_EVENTS", "300"))


@pytest.mark.soak
@pytest.mark.slow
def test_no_event_moves_or_powers_a_robot_more_than_asked(tmp_path: Path) -> None:
    report = Storm(SEED, tmp_path).run(EVENTS)
    print(report.text())
    assert report.events.total() >= EVENTS and report.records > 0
    assert not report.lost, "the witness was too slow: nothing is proved"
    assert not report.violations, report.text()
