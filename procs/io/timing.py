"""Check once a second, over the cycles of that second, that the loop keeps its period.

Time that io waits for replies that do not come is not counted: it is not the computer's fault.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from trocar.procs.io.record import IoRecord
from trocar.procs.io.reports import IoReports
from trocar.procs.tables import codes

INTERVAL_NS: Final = 1_000_000_000
START_NS: Final = 10_000_000_000  # no checks before
RATIO: Final = 2.0  # ratio of the mean period to the configured one that is too much
REPEAT_NS: Final = 120_000_000_000  # of the warning


class Timing:
    """Means over a second; powered robots are stopped when the loop is far too slow to control them. KINEMATIC ones
    need no control.
    """

    def __init__(self, name: str, period_s: float, record: IoRecord, reports: IoReports, now_ns: int) -> None:
        self._name, self._period_s, self._record, self._reports = name, period_s, record, reports
        self._start_ns = self._since_ns = now_ns
        self._warned_ns = now_ns - REPEAT_NS
        self._cycles = self._work_ns = self._waited_ns = 0

    def step(self, begin_ns: int, end_ns: int, waited_ns: int = 0) -> None:
        """Count a cycle with this begin and end; `waited_ns`: total time spent so far on replies that did not come."""
        self._cycles += 1
        self._work_ns += end_ns - begin_ns
        if end_ns - self._since_ns >= INTERVAL_NS:
            self._judge(end_ns, waited_ns)

    def _judge(self, now_ns: int, waited_ns: int) -> None:
        in_vain_ns = waited_ns - self._waited_ns
        period_s = (now_ns - self._since_ns - in_vain_ns) * 1e-9 / self._cycles
        work_s = (self._work_ns - in_vain_ns) * 1e-9 / self._cycles
        self._since_ns, self._cycles, self._work_ns, self._waited_ns = now_ns, 0, 0, waited_ns
        if now_ns - self._start_ns < START_NS:
            return
        if period_s > RATIO * self._period_s:
            for robot in np.flatnonzero(self._record.power_requested & ~self._record.simulated).tolist():
                self._reports.trip(codes.PERIOD, robot, value=period_s, limit=RATIO * self._period_s)
        elif work_s > self._period_s and now_ns - self._warned_ns >= REPEAT_NS:
            self._warned_ns = now_ns
            self._reports.warn(codes.PERIOD_LONG, self._name, value=work_s, limit=self._period_s)
