"""Common parts of benchmarks: facts about this machine, medians by turns, CPU time, waiting, homing, numpy for C."""

from __future__ import annotations

import os
import platform
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from statistics import median
from typing import Any, Final, TypeVar

import numpy as np
import psutil
from numpy.typing import NDArray

from trocar.procs.machine.paths import PROJECT_CONFIGS
from trocar.procs.native.library import SWITCH, native
from trocar.procs.tables.bring_up import HOMED
from trocar.shm.time.clock import monotonic_ns, pause
from trocar.tools.client.bring_up import bring_all
from trocar.tools.output.errors import Problem

FULL: Final = PROJECT_CONFIGS / "systems" / "kinematic-full.yaml"
PATIENCE_S: Final = 40.0
POLL_S: Final = 0.001
HOMING_TRIES, AGAIN_S = 3, 1.0
WHOLE_PROCESS: Final = 2  # CPUCLOCK_SCHED: CPU time of all of its threads
Found = TypeVar("Found")


def machine() -> dict[str, Any]:
    """The conditions of every benchmark."""
    return {"computed_by": "native" if native().library is not None else f"numpy: {native().why}",
            "cores": len(psutil.Process().cpu_affinity() or []), "load": os.getloadavg()[0],
            "kernel": platform.release(), "python": platform.python_version(), "numpy": np.__version__}


def cpu_model() -> str:
    """The processor's name."""
    for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
        if line.startswith("model name"):
            return line.split(":", 1)[1].strip()
    return platform.machine()


def seconds_since(begin_ns: int) -> float:
    """Real time since `monotonic_ns()` was `begin_ns`."""
    return (monotonic_ns() - begin_ns) * 1e-9


def by_turns(tries: int, variants: Mapping[str, Callable[[], Mapping[str, float]]]) -> dict[str, dict[str, float]]:
    """Measure all variants one after the other, `tries` times; the median of each figure."""
    found: dict[str, list[Mapping[str, float]]] = {name: [] for name in variants}
    for _ in range(tries):
        for name, measure in variants.items():
            found[name].append(measure())
    return {name: {key: median(row[key] for row in rows) for key in rows[0]} for name, rows in found.items()}


def medians(tries: int, measure: Callable[[], Mapping[str, float]]) -> dict[str, float]:
    """The median of each figure of some tries."""
    return by_turns(tries, {"": measure})[""]


def percentiles(name: str, values: Sequence[float] | NDArray[Any], *percents: float, unit: float = 1.0
                ) -> dict[str, float]:
    """Figures NAME_p50 (of 99.9: NAME_p999) of some values, times `unit`."""
    return {f"{name}_p{percent:g}".replace(".", ""): float(np.percentile(values, percent)) * unit
            for percent in percents}


def wait_until(done: Callable[[], Found], what: str) -> Found:
    """Wait until `done` returns a result; Problem if that takes longer than PATIENCE_S."""
    end = monotonic_ns() + round(PATIENCE_S * 1e9)
    while not (found := done()):
        if monotonic_ns() >= end:
            raise Problem(f"not within {PATIENCE_S:g} s: {what}")
        pause(POLL_S)
    return found


def home_all(system: str, *names: str) -> list[str]:
    """Home these arms, or all; returns why earlier tries failed: a busy machine may stall an arm and end its homing."""
    refusals: list[str] = []
    while len(refusals) < HOMING_TRIES:
        pause(len(refusals) * AGAIN_S)
        try:
            bring_all(system, names, HOMED)
        except Problem as problem:
            refusals.append(str(problem))
        else:
            return refusals
    raise Problem(f"the arms did not home: {'; then '.join(refusals)}")


def cpu_s(pid: int) -> float:
    """CPU time of a process so far, s, all threads, user and kernel; 0 if it has ended.

    `/proc/PID/stat`, which psutil reads, counts in ticks of 10 ms; this is to the nanosecond.
    """
    try:
        return time.clock_gettime_ns((~pid << 3) | WHOLE_PROCESS) * 1e-9  # as clock_getcpuclockid does
    except OSError:
        return 0.0


def pss_mb(pid: int) -> float:
    """Proportional set size of a process and all its descendants, MB: shared parts count once."""
    process, found = psutil.Process(pid), 0
    for each in (process, *process.children(recursive=True)):
        with suppress(psutil.NoSuchProcess):  # it has ended
            found += each.memory_full_info().pss
    return found * 1e-6


@contextmanager
def without_native() -> Iterator[None]:
    """numpy does the work of objects made or started meanwhile."""
    before = os.environ.get(SWITCH)
    os.environ[SWITCH] = "0"
    native.cache_clear()
    try:
        yield
    finally:
        del os.environ[SWITCH]
        if before is not None:
            os.environ[SWITCH] = before
        native.cache_clear()
