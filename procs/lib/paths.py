"""Where a system keeps its files outside shared memory."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path


def log_folder(environ: Mapping[str, str], system: str) -> Path:
    """Folder of a system's log files: `TROCAR_STATE`, else `XDG_STATE_HOME/trocar`, else `~/.local/state/trocar`."""
    chosen = environ.get("TROCAR_STATE")
    if chosen:
        return Path(chosen) / system
    state = environ.get("XDG_STATE_HOME")
    root = Path(state) if state else Path(environ.get("HOME", "/tmp")) / ".local" / "state"
    return root / "trocar" / system
