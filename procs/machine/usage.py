"""Resource usage of processes: share of a core, and memory."""

from __future__ import annotations

from collections.abc import Iterable

import psutil


class Usage:
    """Usage by process; CPU shares are averages since the previous call."""

    def __init__(self) -> None:
        self._known: dict[int, psutil.Process] = {}

    def of(self, pid: int) -> tuple[float | None, float | None]:
        """CPU in percent of a core, and resident memory in MB; None without such a process or access to it."""
        try:
            process = self._known.setdefault(pid, psutil.Process(pid)) if pid > 0 else None
            if process is None:
                return None, None
            return process.cpu_percent(), process.memory_info().rss * 1e-6
        except psutil.Error:
            self._known.pop(pid, None)
            return None, None

    def keep(self, pids: Iterable[int]) -> None:
        """Forget all other processes, because their ids may be reused."""
        self._known = {pid: self._known[pid] for pid in pids if pid in self._known}
