"""What the loops of all processes did in their last second, from their control pages."""

from __future__ import annotations

from trocar.procs.document.system import SystemConfig
from trocar.procs.ros_bridge.publishing import ros_topic
from trocar.procs.ros_bridge.stamps import time_of
from trocar.procs.ros_messages.dds import Participant
from trocar.procs.ros_messages.messages import IntervalStatistics
from trocar.shm.time.control_page import ControlPage

FIGURES = ("avg", "std", "min", "max")


class LoopStatistics:
    """One topic for each process."""

    def __init__(self, participant: Participant, system: SystemConfig) -> None:
        self._rows = [(participant.writer(f"stats/{ros_topic(row.name)}/period_statistics", IntervalStatistics),
                       ControlPage(system.name, row.name)) for row in system.processes]

    def step(self, ros_ns: int) -> None:
        """To whoever reads it."""
        for writer, page in self._rows:
            if not writer.is_read:
                continue
            period, work = ([float(page.get(f"{what}_{figure}")) for figure in FIGURES] for what in ("period", "work"))
            message = IntervalStatistics()
            message.header.stamp = time_of(ros_ns)
            message.period_avg, message.period_std_dev, message.period_min, message.period_max = period
            (message.compute_time_avg, message.compute_time_std_dev, message.compute_time_min,
             message.compute_time_max) = work
            message.number_of_samples = int(page.get("interval_cycles"))
            message.number_of_overruns, message.statistics_interval = int(page.get("overruns")), 1.0
            writer.write(message)

    def close(self) -> None:
        """Unmap."""
        for _, page in self._rows:
            page.close()
