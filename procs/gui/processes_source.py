"""State of the processes: their control pages, the supervisor's records about them, and their resource use."""

from __future__ import annotations

import contextlib
from typing import Any, Final

from trocar.procs.crtk.plain import plain
from trocar.procs.crtk.reported import supervised
from trocar.procs.document.system import SystemConfig
from trocar.procs.machine.usage import Usage
from trocar.shm.memory.segment import SegmentError
from trocar.shm.ring.ring import RingReader
from trocar.shm.system import directory
from trocar.shm.time.clock import monotonic_ns
from trocar.shm.time.control_page import ControlPage

LOOK_NS: Final = 1_000_000_000


class ProcessesSource:
    """All processes of a system, once a second."""

    def __init__(self, document: SystemConfig) -> None:
        self._pages: dict[str, ControlPage] = {}
        self._kinds = {"supervisor": "supervisor", **{row.name: row.kind for row in document.processes}}
        for name in self._kinds:
            with contextlib.suppress(SegmentError):
                self._pages[name] = ControlPage(document.name, name)
        self._ledger: RingReader = directory.reader(document.name, "supervisor", "state", "supervisor", often=False)
        self._usage = Usage()
        self._shown: dict[str, Any] = {}
        self._look_ns = 0

    def read(self, now_ns: int) -> dict[str, Any]:
        """`rows`, one for each process."""
        if now_ns >= self._look_ns:
            self._look_ns = now_ns + LOOK_NS
            said = supervised(self._ledger, "lifecycle", "restarts", "exit_reason")
            rows = [self._row(name, page, said.get(name, {})) for name, page in self._pages.items()]
            self._usage.keep(int(row["pid"]) for row in rows)
            self._shown = {"age": 0.0, "rows": rows}
        return self._shown

    def _row(self, name: str, page: ControlPage, said: dict[str, Any]) -> dict[str, Any]:
        pid, period_s, beat = int(page.get("pid")), float(page.get("period_avg")), int(page.get("heartbeat_ns"))
        row = {"name": name, "kind": self._kinds[name], "state": page.state, "pid": pid,
               "rate_hz": 1.0 / period_s if period_s > 0.0 else None,
               "period_p99_ms": float(page.get("period_p99")) * 1e3, "work_p99_ms": float(page.get("work_p99")) * 1e3,
               "missed": int(page.get("missed")),
               "error": plain(page.get("error")), "policy": plain(page.get("policy")),
               "silent_s": round((monotonic_ns() - beat) * 1e-9, 1) if beat else None, **said}
        if said.get("lifecycle") == "STOPPED":
            row |= {"state": "STOPPED", "rate_hz": None, "pid": 0, "silent_s": None}
        cpu, memory_mb = self._usage.of(int(str(row["pid"])))
        return row | {"cpu": cpu, "memory_mb": memory_mb}

    def close(self) -> None:
        """Unmap."""
        for page in self._pages.values():
            page.close()
        self._ledger.close()
