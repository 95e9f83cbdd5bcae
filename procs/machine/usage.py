"""What processes use of the machine: share of a core and memory, for who shows it."""

from __future__ import annotations

from collections.abc import Iterable

import psutil


class Usage:
    """Looked at now and then; shares are of the time since the last look."""

    def __init__(self) -> None:
        self._known: dict[int, psutil.Process] = {}

    def of(self, pid: int) -> tuple[float | None, float | None]:
        """Percent of a core and MB of its own; None where there is no such process, or it is not ours to ask."""
        try:
            process = self._known.setdefault(pid, psutil.Process(pid)) if pid > 0 else None
            if process is None:
                return None, None
            return process.cpu_percent(), process.memory_info().rss * 1e-6
        except psutil.Error:
            self._known.pop(pid, None)
            return None, None

    def keep(self, pids: Iterable[int]) -> None:
        """Forget all others: their numbers may be given to other processes."""
        self._known = {pid: self._known[pid] for pid in pids if pid in self._known}
