"""How much faster four actors of Ray are than one, on episodes of PsmReach on boards, and whether they do the same.

`ray_scaling_4` is the steps a second of four actors by four times those of one, the median of some rounds, each with
both; None where the machine has fewer than five cores free, as the driver and Ray need one. `ray_cpu_scaling_4` is the
same of simulated seconds a second of CPU time: what cores lose by sharing memory and caches, without what others do on
them.
"""

from __future__ import annotations

import hashlib
import importlib.util
import os
import statistics
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import psutil

from trocar.tools.output.printing import Say

ACTORS: Final = 4
FREE_CORES: Final = 5
ROUNDS: Final = 3
EPISODES: Final = 4
"""Of an actor in a round."""
OPTIONS: Final = {"backend": "boards", "horizon": 100}
NOT_MEASURED: Final[dict[str, float | None]] = {"ray_scaling_4": None, "ray_cpu_scaling_4": None,
                                               "ray_steps_per_s_1": None, "ray_steps_per_s_4": None}


@dataclass(frozen=True, slots=True)
class Scaling:
    """What was measured, and hashes of the same episodes by where they ran."""

    figures: dict[str, float | None]
    hashes: dict[str, str]


def run(say: Say) -> Scaling | None:
    """Measure; None where there is no Ray, or no gymnasium."""
    if importlib.util.find_spec("ray") is None or importlib.util.find_spec("gymnasium") is None:
        return None
    from trocar.procs.rl import ray_actors, rollouts

    say("actors of Ray", None)
    task = rollouts.RolloutTask("trocar/PsmReach-v0", OPTIONS)
    free = len(psutil.Process().cpu_affinity() or []) - os.getloadavg()[0]
    seeds = range(ACTORS)
    with ray_actors.running_ray(ACTORS) as ray:
        runners = ray_actors.actors_of(ray, task, ACTORS)
        there = list(ray_actors.shared(ray, runners, seeds))  # they home here, and find their starts
        for _ in range(2):
            _round(ray, runners)
        pairs = [(_round(ray, runners[:1]), _round(ray, runners)) for _ in range(ROUNDS)]
    median = [[statistics.median(pair[which][what] for pair in pairs) for what in (0, 1)] for which in (0, 1)]
    scaling = statistics.median(four[0] / (ACTORS * one[0]) for one, four in pairs)
    figures: dict[str, float | None] = {
        "ray_scaling_4": scaling if free >= FREE_CORES else None,
        "ray_cpu_scaling_4": statistics.median(four[1] / one[1] for one, four in pairs),
        "ray_steps_per_s_1": median[0][0], "ray_steps_per_s_4": median[1][0]}
    return Scaling(figures, {"here": _hash(list(rollouts.run(task, seeds))), "actors": _hash(there)})


def _round(ray: Any, runners: Sequence[Any]) -> tuple[float, float]:
    """Steps a second, and simulated seconds a CPU second, of as many episodes for each actor."""
    from trocar.procs.rl import ray_actors

    begin = time.monotonic()
    done = list(ray_actors.shared(ray, runners, range(EPISODES * len(runners))))
    wall_s = time.monotonic() - begin
    cpu_s = sum(row.cpu_s for row in done)
    return sum(row.steps for row in done) / wall_s, sum(row.simulated_s for row in done) / cpu_s


def _hash(episodes: Sequence[Any]) -> str:
    rows = sorted((row.seed, row.hash) for row in episodes)
    return hashlib.sha256(repr(rows).encode()).hexdigest()[:16]
