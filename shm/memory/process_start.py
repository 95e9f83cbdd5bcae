"""When a process was started: with its pid a unique identifier."""

from __future__ import annotations

from pathlib import Path


def start_time(pid: int) -> int:
    """Start time of a process in clock ticks since boot, 0 if gone; with the pid a unique identifier of the process."""
    return _state_and_start(pid)[1]


def lives(pid: int, start: int) -> bool:
    """Whether this process has not ended, even if its parent has not waited for it yet."""
    state, found = _state_and_start(pid)
    return found == start and state not in ("", "Z", "X")


def _state_and_start(pid: int) -> tuple[str, int]:
    try:
        text = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return "", 0
    fields = text.rsplit(")", 1)[1].split()
    return fields[0], int(fields[19])
