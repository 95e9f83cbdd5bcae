"""Whether a process had a core: who waits for one is silent, and does not hang."""

from __future__ import annotations

from pathlib import Path
from typing import Final

IDLE: Final = -1


def counted_ns(before_ns: int, core_ns: int, passed_ns: int) -> int:
    """Of the time that has passed, what a process had a core in, or wanted none; `core_time_ns` before, and now."""
    if core_ns == IDLE:
        return passed_ns
    return 0 if before_ns == IDLE else min(passed_ns, core_ns - before_ns)


def core_time_ns(pid: int) -> int:
    """The time that a process has had a core so far, while it wants one; IDLE when it sleeps, is stopped or is gone."""
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0]
        return int(Path(f"/proc/{pid}/schedstat").read_text().split()[0]) if state == "R" else IDLE
    except (OSError, ValueError, IndexError):  # it has ended, or this kernel keeps no such figures
        return IDLE
