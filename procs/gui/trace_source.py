"""What the joint controller of an axis did since the last tick, sample by sample, for the plot of the page PID."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from trocar.procs.gui.robots import IoRobot
from trocar.procs.gui.sources import PROGRAM
from trocar.shm.system import directory
from trocar.shm.system.subscriptions import Subscriber
from trocar.shm.topics import IO_STATE

SIGNALS: Final = ("position", "setpoint_position", "velocity", "setpoint_velocity", "effort", "setpoint_effort",
                  "disturbance", "position_error")
CLOSEST_S: Final = 0.002
"""Between two samples that are sent."""
BEFORE_NS: Final = 1_000_000_000
"""Of what was before somebody looked."""


class TraceSource:
    """One axis of a robot."""

    def __init__(self, system: str, robot: IoRobot, axis: int) -> None:
        """Attach, and want it; SegmentError when it cannot be read."""
        self._reader = directory.reader(system, robot.io.name, IO_STATE.name, "io", often=False)
        self._subscriber: Subscriber | None = None
        try:
            self._subscriber = Subscriber(system, robot.io.name, PROGRAM)
            self._subscriber.want(IO_STATE.name)
        except BaseException:
            self.close()
            raise
        self._axis, self._robot = robot.axes.start + axis, robot.place
        self._each = max(1, round(CLOSEST_S / robot.io.period_s))
        self._stamp_ns, self._seen_ns = 0, 0

    def read(self, now_ns: int) -> dict[str, Any]:
        """`t` of the newest samples, s, and `v`: a list for each of `SIGNALS`."""
        if not self._reader.newest():
            return {"age": None}
        if self._reader.stamp_ns == self._stamp_ns:
            return {"age": round((now_ns - self._seen_ns) * 1e-9, 1), "t": [], "v": []}
        rows = self._reader.since(max(self._stamp_ns + 1, self._reader.stamp_ns - BEFORE_NS))
        if len(rows):
            self._stamp_ns, self._seen_ns = int(rows["stamp_ns"][-1]), now_ns
        rows = rows[rows["sequence"] % self._each == 0]
        columns = [rows[name][:, self._axis].astype(np.float32) for name in SIGNALS]
        for column in columns:  # no line while its boards are away: that is the last good value
            column[~rows["robot_valid"][:, self._robot]] = np.nan
        return {"age": 0.0, "t": [round(stamp * 1e-9, 4) for stamp in rows["stamp_ns"].tolist()], "v": columns}

    def close(self) -> None:
        """Unmap, want it no more."""
        self._reader.close()
        if self._subscriber is not None:
            self._subscriber.close()
