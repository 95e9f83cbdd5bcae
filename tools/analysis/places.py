"""Where recordings of a system are."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path

from trocar.procs.machine.paths import is_folder, log_folder, recordings_folder
from trocar.shm.memory.segment import SegmentError
from trocar.shm.system import directory


def folder_of(system: str) -> Path:
    """The folder named by its configuration, while that is in memory, else the one beside its logs."""
    from trocar.procs.document.system import from_json  # imported only where recordings are kept or listed

    with contextlib.suppress(SegmentError, ValueError):
        row = from_json(directory.document(system)).recorder
        return recordings_folder(os.environ, system, row.folder if row is not None else "")
    return recordings_folder(os.environ, system)


def all_folders() -> list[Path]:
    """Those of all systems that are in memory or have kept logs."""
    state = log_folder(os.environ, "any").parent
    kept = [entry.name for entry in state.iterdir()] if is_folder(state) else []
    return [folder_of(system) for system in sorted({*directory.systems(), *kept})]
