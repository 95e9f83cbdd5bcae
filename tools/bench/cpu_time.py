"""CPU time of other processes, to the nanosecond.

`/proc/PID/stat`, which psutil reads, counts in ticks of 10 ms: of a process that uses 2 % of a core most looks of half
a second see none at all.
"""

from __future__ import annotations

import time
from typing import Final

WHOLE_PROCESS: Final = 2  # CPUCLOCK_SCHED: what the scheduler gave all of its threads


def cpu_s(pid: int) -> float:
    """CPU time of a process so far, s, all threads, user and kernel; 0 when it is gone."""
    try:
        return time.clock_gettime_ns((~pid << 3) | WHOLE_PROCESS) * 1e-9  # as clock_getcpuclockid does
    except OSError:
        return 0.0
