"""The newest lines of a process's log, for the page Processes: `log:NAME`."""

from __future__ import annotations

import os
from functools import partial
from pathlib import Path
from typing import Any, Final

from trocar.procs.crtk.names import none_such
from trocar.procs.document.system import SystemConfig
from trocar.procs.gui.sources import Maker
from trocar.procs.machine.paths import log_folder
from trocar.shm.system.loglines import parsed

LOOK_NS: Final = 250_000_000
BYTES: Final = 1 << 16
"""Number of bytes read from its end."""
LINES: Final = 200
LETTERS: Final = 1000
"""Of one line."""


class LogSource:
    """The end of one file, read again when it has changed."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._look_ns = 0
        self._seen: tuple[int, ...] = ()
        self._shown: dict[str, Any] = {"age": 0.0, "rows": []}

    def read(self, now_ns: int) -> dict[str, Any]:
        """`rows`, oldest first: local time, level and text; the first two are empty in lines of libraries.

        `problem` in their place while the file cannot be read.
        """
        if now_ns >= self._look_ns:
            self._look_ns = now_ns + LOOK_NS
            try:
                self._look()
            except OSError as error:
                self._seen, self._shown = (), {"age": None, "problem": str(error)}
        return self._shown

    def _look(self) -> None:
        with self._path.open("rb") as file:
            status = os.fstat(file.fileno())
            seen = status.st_ino, status.st_size, status.st_mtime_ns
            if seen != self._seen:
                self._seen = seen
                file.seek(max(0, status.st_size - BYTES))
                lines = file.read(BYTES).decode(errors="replace").split("\n")
                if status.st_size > BYTES:
                    del lines[0]  # its beginning is missing
                rows = [parsed(line[:LETTERS]) for line in lines if line][-LINES:]
                self._shown = {"age": 0.0, "rows": [(row.local[11:23], row.level, row.text) for row in rows]}

    def close(self) -> None:
        """No open files."""


def log_of(document: SystemConfig, name: str) -> Maker:
    """Source for the log of a process; ValueError if there is no such process."""
    known = ["supervisor", *(row.name for row in document.processes)]
    if name not in known:
        raise ValueError(none_such("process", name[:80], known))
    return partial(LogSource, log_folder(os.environ, document.name) / f"{name}.log")
