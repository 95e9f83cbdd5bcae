"""Kill -9 at any point harms nobody else: thousands of deaths of writers, readers, clients and owners.

TROCAR_KILLS: how many deaths in the long run (10000), TROCAR_SEED: another seed. A violation names its seed and death.
"""

from __future__ import annotations

import json
import os
from typing import Any

import pytest

from tests.shm.kills import VICTIMS
from tests.shm.wrongs import WRONGS

HARNESS = "from tests.shm.kills import main; main()"
SEED = os.environ.get("TROCAR_SEED", "1")
SHARE = 60  # deaths of each in the suite: 420 in all
LONG_S = 7200.0


def deaths(world: Any, victim: str, kills: int, wrong: str = "", walk: int = 0) -> dict[str, Any]:
    """The harness's report."""
    harness = world.start(HARNESS, victim, str(kills), SEED, wrong, str(walk))
    out, _ = harness.communicate(timeout=LONG_S)
    assert harness.returncode == 0, "the harness itself has died"
    report: dict[str, Any] = json.loads(out)
    print(json.dumps(report))
    return report


def innocent(report: dict[str, Any], kills: int) -> None:
    """All died, in all four ways, and nothing was amiss."""
    assert not report["violation"], report["violation"]
    assert sum(report["kinds"].values()) == report["kills"] == kills and len(report["kinds"]) == 4, report


@pytest.mark.slow
@pytest.mark.parametrize("victim", VICTIMS)
def test_death_at_any_point_harms_nobody(world: Any, victim: str) -> None:
    innocent(deaths(world, victim, SHARE), SHARE)


@pytest.mark.slow
def test_a_death_between_any_two_steps_of_a_stop_harms_nobody(world: Any) -> None:
    report = deaths(world, "who stops", 350, walk=1)
    assert not report["violation"] and report["kinds"] == {"late steps": 350}, report
    assert report["sent"] > 50 and report["died_unrecorded"] > 5, "not all steps were walked"


@pytest.mark.soak
@pytest.mark.parametrize("victim", VICTIMS)
def test_thousands_of_deaths_harm_nobody(world: Any, victim: str) -> None:
    kills = int(os.environ.get("TROCAR_KILLS", "10000")) // len(VICTIMS)
    innocent(deaths(world, victim, kills), kills)


@pytest.mark.slow
@pytest.mark.parametrize("wrong", WRONGS)
def test_a_seeded_mistake_is_caught(world: Any, wrong: str) -> None:
    _, victim, walk, lives = WRONGS[wrong]
    report = deaths(world, victim, lives, wrong, walk)
    assert report["violation"].startswith(f"seed {SEED}, {victim}: life {report['kills']}, steps "), report
    assert "Traceback" not in report["violation"], "the mistake itself is broken"
