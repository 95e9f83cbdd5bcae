"""`trocar bench rl`: speed of whole systems in one process, time to restore a snapshot, reproducibility.

Hosts (procs/host) of a KINEMATIC PSM, a PSM on emulated boards, and four PSMs on eight boards, each with io, arms and
physics at 500 Hz and goals at 50 Hz. Ratios are seconds of the system's time a second: real (`…_realtime_ratio`) and of
CPU (`…_per_cpu_s`), medians (and p05) of windows of some seconds; for four PSMs the arms' seconds are added up. Restore
times are CPU time of one PSM on boards. Hashes are of every record of io, boards and arms: twice in this process, in
another host, in another process.

If Ray is installed, episodes of PsmReach on boards run on its actors too, with the same results. `ray_scaling_4` is the
steps a second of four actors by four times those of one, the median of some rounds, each with both; None where the
machine has fewer than five cores free, as the driver and Ray need one. `ray_cpu_scaling_4` is the same of simulated
seconds a second of CPU time: the loss of cores by sharing memory and caches, without the load of other processes.
"""

from __future__ import annotations

import hashlib
import importlib.util
import os
import statistics
import subprocess
import sys
import time
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
import psutil

from trocar.procs.machine.paths import ROOT
from trocar.tools.bench.host_run import BOARDS, FOUR_PSMS, KINEMATIC, SETS, HostRun
from trocar.tools.output.printing import Say, progress
from trocar.tools.systems.find import environment

WINDOWS: Final = 20
WINDOW_S: Final = 2.0
RESETS: Final = 200
EPISODE_S: Final = 0.2
PATIENCE_S: Final = 120.0
HASHED: Final = (KINEMATIC, BOARDS)
ACTORS: Final = 4
FREE_CORES: Final = 5
ROUNDS: Final = 3
EPISODES: Final = 4
"""Of an actor in a round."""
OPTIONS: Final = {"backend": "boards", "horizon": 100}
NO_RAY: Final[dict[str, float | None]] = dict.fromkeys(
    ("ray_scaling_4", "ray_cpu_scaling_4", "ray_steps_per_s_1", "ray_steps_per_s_4"))


def run(seconds: float = WINDOW_S, windows: int = WINDOWS, resets: int = RESETS, processes: bool = True
        ) -> dict[str, Any]:
    """Measure. `processes`: also compare with other processes."""
    load = [round(x, 2) for x in os.getloadavg()]
    figures: dict[str, float | int | None] = {}
    with progress("bench rl") as say:
        for kind, ratio, cpu_ratio in ((KINEMATIC, "kinematic_500_realtime_ratio", "kinematic_500_per_cpu_s"),
                                       (BOARDS, "boards_500_realtime_ratio", "boards_500_per_cpu_s"),
                                       (FOUR_PSMS, "boards_4psm_env_s_per_s", "boards_4psm_env_s_per_cpu_s")):
            say(f"{kind}: speed", None)
            with HostRun(kind) as host:
                wall, cpu = _ratios(host, seconds, windows)
                figures |= {ratio: _at(wall, 50), f"{ratio}_p05": _at(wall, 5),
                            cpu_ratio: _at(cpu, 50), f"{cpu_ratio}_p05": _at(cpu, 5)}
                if kind == BOARDS:
                    say("going back", None)
                    figures |= _resets(host, resets)
        hashes = {kind: _hashes(kind, say, processes) for kind in HASHED}
        figures |= NO_RAY
        if processes and all(map(importlib.util.find_spec, ("ray", "gymnasium"))):
            say("actors of Ray", None)
            on_ray, hashes["ray"] = _ray()
            figures |= on_ray
    is_equal = all(len(set(rows.values())) == 1 for rows in hashes.values())
    figures["hashes_equal"] = int(is_equal)
    problems = [] if is_equal else [f"not all hashes are equal: {hashes}"]
    return {"figures": figures, "problems": problems, "conditions": {
        "windows": windows, "window_s": seconds, "resets": resets, "sets": list(SETS), "hashes": hashes,
        "load_before": load, "load_after": [round(x, 2) for x in os.getloadavg()]}}


def _ratios(host: HostRun, seconds: float, windows: int) -> tuple[list[float], list[float]]:
    """Arms' seconds a second, and a second of CPU time, in each window; all begin alike."""
    wall, cpu = [], []
    for _ in range(windows):
        host.restore()
        begin, begin_cpu = time.monotonic_ns(), time.thread_time_ns()
        host.play(seconds)
        passed, passed_cpu = time.monotonic_ns() - begin, time.thread_time_ns() - begin_cpu
        wall.append(host.arms * seconds * 1e9 / passed)
        cpu.append(host.arms * seconds * 1e9 / passed_cpu)
    return wall, cpu


def _resets(host: HostRun, resets: int) -> dict[str, float]:
    """CPU time of going back after a short episode, ms."""
    times = []
    for _ in range(resets):
        host.play(EPISODE_S)
        begin = time.thread_time_ns()
        host.restore()
        times.append((time.thread_time_ns() - begin) * 1e-6)
    return {"reset_ms_p50": _at(times, 50), "reset_ms_p99": _at(times, 99), "snapshot_ms": host.snapshot_ms}


def _hashes(kind: str, say: Say, processes: bool) -> dict[str, str]:
    """Of the same seconds, by where they were played."""
    say(f"{kind}: hashes", None)
    with HostRun(kind) as host:
        found = {"first": host.hash(), "second": host.hash()}
    with HostRun(kind) as host:
        found["another host"] = host.hash()
    if processes:
        words = [sys.executable, "-P", "-m", "trocar.tools.bench.host_run", kind]
        done = subprocess.run(words, cwd=ROOT, env=environment(), stdout=subprocess.PIPE, text=True, check=False,
                              timeout=PATIENCE_S)
        found["another process"] = done.stdout.strip() or f"exit code {done.returncode}"
    return found


def _at(values: list[float], percent: float) -> float:
    return float(np.percentile(values, percent))


def _ray() -> tuple[dict[str, float | None], dict[str, str]]:
    """Figures, and hashes of the same episodes by where they ran."""
    from trocar.procs.rl import ray_actors, rollouts

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
    return figures, {"here": _hash(list(rollouts.run(task, seeds))), "actors": _hash(there)}


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
