"""`trocar bench start`: waiting time for a verb, and for a system to be up.

Each figure is the median of some tries, by turns; `_cpu_s` is its CPU time, which depends less on other load.
`python_s` is an interpreter that does nothing, `numpy_s` one that loads numpy as verbs do: the difference to a verb is
ours. `script_s` imports trocar and names `trocar.psm`. `up_s` is `trocar up` of the whole robot (two masters, setup
joints, ECM, three PSMs, four teleoperations, all KINEMATIC), `status_s` looks at it, `idle_status_s` finds that no such
system is up.
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
from functools import partial
from typing import Any, Final

from trocar.procs.machine.paths import ROOT
from trocar.shm.time.clock import monotonic_ns
from trocar.tools.bench.measuring import FULL, by_turns, seconds_since
from trocar.tools.systems.find import environment
from trocar.tools.systems.supervising import StartRequest, up_meanwhile

TRIES: Final = 10
TROCAR: Final = ("-P", "-m", "trocar")


def run() -> dict[str, Any]:
    """Measure."""
    name, begin = f"bench-start-{os.getpid()}", monotonic_ns()
    with up_meanwhile(StartRequest(FULL, name)):
        up_s = seconds_since(begin)
        found = by_turns(TRIES, {what: partial(_once, what, *words) for what, words in {
            "python": ("-c", "pass"), "numpy": ("-c", "import numpy"), "script": ("-c", "import trocar; trocar.psm"),
            "version": (*TROCAR, "--version"), "help": (*TROCAR, "--help"),
            "idle_status": (*TROCAR, "status", "--system", f"{name}-not"),
            "status": (*TROCAR, "status", "--system", name), "list": (*TROCAR, "list", "--system", name),
        }.items()})
    figures = {key: value for each in found.values() for key, value in each.items()}
    return {"figures": {**figures, "up_s": up_s}, "conditions": {"system": str(FULL), "tries": TRIES}}


def _once(what: str, *words: str) -> dict[str, float]:
    """Wall seconds, and CPU seconds, of a fresh interpreter; its output and exit code do not matter."""
    environ = {**environment(), "OPENBLAS_NUM_THREADS": "1"}
    begin, used = monotonic_ns(), _children_s()
    subprocess.run([sys.executable, *words], cwd=ROOT, env=environ, stdout=subprocess.DEVNULL,
                   stderr=subprocess.DEVNULL, check=False)
    return {f"{what}_s": seconds_since(begin), f"{what}_cpu_s": _children_s() - used}


def _children_s() -> float:
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime
