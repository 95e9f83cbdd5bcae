"""The process that keeps log files small (procs/machine/log_files.py), for as long as the system is up."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Final

from trocar.procs.document.system import Logs
from trocar.procs.machine import log_files

AGAIN_NS: Final = 5_000_000_000


class LogKeeper:
    """The process that keeps logs small; started at once and restarted when it ends. No process depends on it."""

    def __init__(self, folder: Path, logs: Logs) -> None:
        limits = map(str, (logs.max_bytes, logs.max_age_s, logs.keep))
        # -I and -S: it needs only the standard library, and must not import modules from the working folder
        self._command = [sys.executable, "-I", "-S", log_files.__file__, str(folder), str(os.getpid()), *limits]
        self._begun_ns = 0
        self._popen = self._begin()

    def beat(self, now_ns: int) -> None:
        """Restart the process if it has ended."""
        if now_ns - self._begun_ns > AGAIN_NS:
            self._begun_ns = now_ns
            if self._popen.poll() is not None:
                self._popen = self._begin()

    def _begin(self) -> subprocess.Popen[bytes]:
        return subprocess.Popen(self._command, stdin=subprocess.DEVNULL, start_new_session=True)

    def close(self) -> None:
        """Kill the process; it needs no cleanup."""
        self._popen.kill()
        self._popen.wait()
