"""The limit of open files: every process of a system inherits it from its supervisor."""

from __future__ import annotations

import resource
from typing import Final

ENOUGH: Final = 1024
"""The supervisor of a full system (93 segments) has 200 open, its recorder 165, or 260 if it starts after the names of
its memory were removed; users' processes add to them."""


def raised(soft: int, hard: int) -> int:
    """The soft limit for a supervisor and its processes: at least ENOUGH, as far as the hard limit allows."""
    return soft if _is_enough(soft) else hard if not _is_enough(hard) else ENOUGH


def raise_limit() -> None:
    """Set the soft limit of this process."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (raised(soft, hard), hard))


def shortage(soft: int, hard: int) -> tuple[str, str]:
    """The problem with these limits, and the command that fixes it; both empty if a system can start."""
    if _is_enough(raised(soft, hard)):
        return "", ""
    return (f"a process may open {hard} files at most (ulimit -Hn), a system needs up to {ENOUGH}",
            f"sudo prlimit --pid $$ --nofile={ENOUGH}:{ENOUGH}")


def _is_enough(limit: int) -> bool:
    return limit >= ENOUGH or limit == resource.RLIM_INFINITY
