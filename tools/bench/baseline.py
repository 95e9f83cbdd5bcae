"""What this machine allows: the datagrams of io's cycle exchanged by C programs, compiled for the bench."""

from __future__ import annotations

import os
import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import Final

SOURCE: Final = Path(__file__).with_name("baseline.c")
REPLY_BYTES, WRITE_BYTES = 1092, 218  # of eight QLA1 of Rev 8
WAIT_NS, SPIN_NS = 50_000, 50_000


@dataclass(frozen=True, slots=True)
class BaselineRun:
    """Share of the deadlines missed, time from a reply to the write behind it, CPU time of a cycle but for WAIT_NS."""

    missed: float
    reply_to_write_us_p50: float
    reply_to_write_us_p99: float
    cpu_us: float


class Baseline:
    """The compiled program; `why_not` says why there is none."""

    def __init__(self, folder: Path) -> None:
        """Compiles into `folder`."""
        self._program = folder / "baseline"
        command = [os.environ.get("CC", "cc"), "-O2", "-Wall", "-Wextra", str(SOURCE), "-o", str(self._program)]
        try:
            done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
            self.why_not = done.stderr.strip() if done.returncode else ""
        except (OSError, subprocess.TimeoutExpired) as error:
            self.why_not = str(error)

    def run(self, hz: float, seconds: float, client_core: int, server_core: int, spin_ns: int = SPIN_NS) -> BaselineRun:
        """At `hz`, on these cores (-1: any)."""
        given = [round(hz), max(1, round(seconds)), client_core, server_core, REPLY_BYTES, WRITE_BYTES, WAIT_NS,
                 spin_ns]
        done = subprocess.run([self._program, *map(str, given)], capture_output=True, text=True, timeout=seconds + 60,
                              check=True)
        cycles, missed, p50, p99, cpu_ns = map(int, done.stdout.split())
        return BaselineRun(missed / max(1, missed + cycles), p50 * 1e-3, p99 * 1e-3, cpu_ns * 1e-3)
