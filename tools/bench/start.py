"""`trocar bench start`: how long a person waits for a verb, and for a system to be up.

Each figure is the median of some tries, by turns; `_cpu_s` is what the processors did for it, which a busy machine
stretches less. `python_s` is an interpreter that does nothing, `numpy_s` one that loads numpy as verbs do: what lies
between that and a verb is ours. `up_s` is `trocar up` of the whole robot (two masters, setup joints, ECM, three
PSMs, four teleoperations, all KINEMATIC), `status_s` looks at it, `idle_status_s` finds that no such system is up.
"""

from __future__ import annotations

import os
import platform
import resource
import statistics
import subprocess
import sys
from typing import Any, Final

import psutil

from trocar.procs.machine.paths import PROJECT_CONFIGS, ROOT
from trocar.shm.time.clock import monotonic_ns
from trocar.tools.systems.find import environment
from trocar.tools.systems.supervising import StartRequest, up_meanwhile

FULL: Final = PROJECT_CONFIGS / "systems" / "kinematic-full.yaml"
TRIES: Final = 10
TROCAR: Final = ("-P", "-m", "trocar")


def run() -> dict[str, Any]:
    """Measure; returns the object that `--json` prints."""
    name, begin = f"bench-start-{os.getpid()}", monotonic_ns()
    with up_meanwhile(StartRequest(FULL, name)):
        up_s = (monotonic_ns() - begin) * 1e-9
        found = _by_turns({
            "python": ("-c", "pass"), "numpy": ("-c", "import numpy"), "version": (*TROCAR, "--version"),
            "help": (*TROCAR, "--help"), "idle_status": (*TROCAR, "status", "--system", f"{name}-not"),
            "status": (*TROCAR, "status", "--system", name), "list": (*TROCAR, "list", "--system", name),
        })
    return {
        "bench": "start", "figures": {**found, "up_s": up_s},
        "conditions": {"system": str(FULL), "tries": TRIES, "cores": len(psutil.Process().cpu_affinity() or []),
                       "load": os.getloadavg()[0], "kernel": platform.release(), "python": platform.python_version()},
    }


def _by_turns(commands: dict[str, tuple[str, ...]]) -> dict[str, float]:
    """Medians of the seconds that each takes, and of processor seconds."""
    seen: dict[str, list[float]] = {}
    for _ in range(TRIES):
        for name, words in commands.items():
            wall_s, cpu_s = _once(*words)
            seen.setdefault(f"{name}_s", []).append(wall_s)
            seen.setdefault(f"{name}_cpu_s", []).append(cpu_s)
    return {name: statistics.median(values) for name, values in seen.items()}


def _once(*words: str) -> tuple[float, float]:
    """Seconds, and processor seconds, of a fresh interpreter; what it says and its exit code do not matter."""
    environ = {**environment(), "OPENBLAS_NUM_THREADS": "1"}
    begin, used = monotonic_ns(), _children_s()
    subprocess.run([sys.executable, *words], cwd=ROOT, env=environ, stdout=subprocess.DEVNULL,
                   stderr=subprocess.DEVNULL, check=False)
    return (monotonic_ns() - begin) * 1e-9, _children_s() - used


def _children_s() -> float:
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime
