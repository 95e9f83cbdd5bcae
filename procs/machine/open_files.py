"""How many files a process may have open: every process of a system inherits it from its supervisor."""

from __future__ import annotations

import resource
from typing import Final

ENOUGH: Final = 512  # the recorder of a full system has 165 open


def raised(soft: int, hard: int) -> int:
    """The soft limit that a supervisor sets for itself and its processes: enough, as far as the hard one allows."""
    return soft if _is_enough(soft) else hard if not _is_enough(hard) else ENOUGH


def raise_limit() -> None:
    """Set it for this process."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (raised(soft, hard), hard))


def shortage(soft: int, hard: int) -> tuple[str, str]:
    """What is wrong with the limits of this process, and the command that mends it; both empty: a system can start."""
    if _is_enough(raised(soft, hard)):
        return "", ""
    return (f"a process may open {hard} files at most (ulimit -Hn), a system needs up to {ENOUGH}",
            f"sudo prlimit --pid $$ --nofile={ENOUGH}:{ENOUGH}")


def _is_enough(limit: int) -> bool:
    return limit >= ENOUGH or limit == resource.RLIM_INFINITY
