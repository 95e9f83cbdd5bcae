"""Health of a system during a run: periods and latency of io, errors, restarts; used by `demo`."""

from __future__ import annotations

import dataclasses
from collections import deque
from typing import Any

import numpy as np

from trocar.procs.document.system import from_json
from trocar.shm.system import directory
from trocar.shm.system.events import ERROR
from trocar.tools.inspect.processes import SILENT, STALLED, ProcessStatus, statuses
from trocar.tools.output.printing import plain

KEPT = 300_000  # cycles; more would only cost memory
FEWER = 0.9  # share of the nominal rate below which io was not on rate


class HealthWatch:
    """Watches a system from now on; call `collect` at least every two seconds."""

    def __init__(self, system: str, io: str) -> None:
        """`io` is the instance with the monitored cycles."""
        self.system, self._io = system, io
        self._reader = directory.reader(system, io, "state", "io", often=False)
        self._recv, self._write = self._reader.field("recv_ns"), self._reader.field("write_ns")
        self._stamps: deque[int] = deque(maxlen=KEPT)
        self._latency: deque[int] = deque(maxlen=KEPT)
        self._first: tuple[int, int] | None = None  # number and stamp of a record
        self._last = (0, 0)
        self._events = {
            instance: directory.reader(system, instance, ring, often=False)
            for instance, ring in directory.rings(system) if ring == "events"
        }
        self._begin = {process.name: process for process in statuses(system)}
        self.errors: dict[str, str] = {}
        """Their texts, and the first reporter of each: arms and the system repeat others' errors."""

    def collect(self) -> None:
        """Read events since the last call."""
        while self._reader.next():
            stamp = self._reader.stamp_ns
            self._stamps.append(stamp)
            self._last = self._reader.sequence, stamp
            self._first = self._first or self._last
            self._latency.append(int(self._write) - int(self._recv))
        for instance, reader in self._events.items():
            while reader.next():
                if int(reader.field("severity")) == ERROR:
                    self.errors.setdefault(self._bare(str(plain(reader.field("text").item()))), instance)

    def _bare(self, text: str) -> str:
        """An error without the names of those that report or repeat it."""
        who, _, rest = text.partition(": ")
        return self._bare(rest) if who in self._events else text

    def summary(self) -> dict[str, Any]:
        """Figures of the run; `problems`: errors and crashed processes; `late`: possibly an effect of other load."""
        self.collect()
        now = {process.name: process for process in statuses(self.system)}
        processes = [self._process(process) for process in now.values()]
        stamps, latency = np.array(self._stamps, dtype=np.int64), np.array(self._latency) * 1e-3
        periods = np.diff(stamps) * 1e-3
        nominal = 1.0 / from_json(directory.document(self.system)).io(self._io).period_s
        first, last = self._first or self._last, self._last  # with the records that we were too late to see
        rate = 1e9 * (last[0] - first[0]) / (last[1] - first[1]) if last[1] > first[1] else 0.0
        unwell = [process for process in now.values() if process.problem]
        late = [process.said for process in unwell if process.problem in (SILENT, STALLED)]
        problems = [f"{instance}: {text}" if instance else text for text, instance in self.errors.items()]
        problems += [process.said for process in unwell if process.problem not in (SILENT, STALLED)]
        problems += [f"process {row['name']} ended, and was started again" for row in processes if row["restarts"]]
        if rate < FEWER * nominal:
            late.append(f"{self._io} ran at {rate:.0f} Hz instead of {nominal:.0f}")
        return {
            "io_rate_hz": rate, "io_cycles": len(stamps), **_spread("io_period_us", periods),
            **_spread("read_to_write_us", latency), "processes": processes, "problems": problems,
            "late": late,
        }

    def _process(self, process: ProcessStatus) -> dict[str, Any]:
        begin = self._begin.get(process.name)
        if begin is None or begin.pid != process.pid:  # a new process counts from 0
            begin = dataclasses.replace(process, cycles=0, missed=0, overruns=0)
        cycles, missed = process.cycles - begin.cycles, process.missed - begin.missed
        return {"name": process.name, "cycles": cycles, "missed": missed, "overruns": process.overruns - begin.overruns,
                "missed_percent": 100.0 * missed / cycles if cycles else None, "restarts": process.restarts,
                "rate_hz": process.rate_hz, "period_p99_s": process.period_p99_s, "work_p99_s": process.work_p99_s,
                "scheduling": process.scheduling}

    def close(self) -> None:
        """Unmap."""
        self._reader.close()
        for reader in self._events.values():
            reader.close()


def _spread(name: str, values: Any) -> dict[str, float | None]:
    if not len(values):
        return {f"{name}_p50": None, f"{name}_p99": None, f"{name}_max": None}
    p50, p99, most = np.percentile(values, (50, 99, 100))
    return {f"{name}_p50": float(p50), f"{name}_p99": float(p99), f"{name}_max": float(most)}
