"""Periodic messages: tips for tf, arm descriptions for RViz, and timing of all loops."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Final

from trocar.procs.crtk.plain import plain
from trocar.procs.crtk.views import Stamps
from trocar.procs.document.system import ArmConfig
from trocar.procs.kinematics.inverse.arms import carrying
from trocar.procs.kinematics.urdf import urdf
from trocar.procs.ros_bridge.publishing import ros_topic
from trocar.procs.ros_messages.dds import LATCHED, Participant
from trocar.procs.ros_messages.messages import (
    IntervalStatistics,
    MessageHeader,
    Quaternion,
    String,
    TFMessage,
    Transform,
    TransformStamped,
    Vector3,
    time_of,
)
from trocar.shm.ring.ring import RingReader
from trocar.shm.time.control_page import ControlPage

FIGURES: Final = ("avg", "std", "min", "max")
Reads = Callable[[str, str], RingReader]
"""Returns the reading end of a ring of an instance."""


@dataclass(slots=True)
class Throttle:
    """An action repeated at this interval, ns of the system's time."""

    period_ns: int
    do: Callable[[int], None]
    due_ns: int = 0

    def step(self, now_ns: int) -> None:
        """Execute the action if it is due."""
        if now_ns >= self.due_ns:
            self.due_ns = now_ns + self.period_ns
            self.do(now_ns)


class Descriptions:
    """The `robot_description` of each arm, published again when its instrument changes."""

    def __init__(self, participant: Participant, arms: Iterable[ArmConfig], reads: Reads) -> None:
        self._arms = []
        for arm in arms:
            ring = reads(arm.name, "state")
            writer = participant.writer(ros_topic(f"{arm.name}/robot_description"), String, LATCHED)
            self._arms.append((arm, ring, ring.field("tool"), writer))
        self._told: dict[str, str] = {}

    def step(self, now_ns: int) -> None:
        """Of those that carry something else than before."""
        for arm, ring, tool, writer in self._arms:
            carried = str(plain(tool.item())) if ring.newest() else ""
            if self._told.get(arm.name) != carried:
                self._told[arm.name] = carried
                writer.write(String(urdf(ros_topic(arm.name), carrying(arm, carried), arm.meshes)))


class TipFrames:
    """Tip poses of arms, in one message: a frame of each arm's name in the frame of its measured_cp."""

    def __init__(self, participant: Participant, arms: Iterable[ArmConfig], reads: Reads, stamps: Stamps) -> None:
        self._writer, self._stamps = participant.writer("/tf", TFMessage), stamps
        rings = [(arm.name, reads(arm.name, "state")) for arm in arms]
        self._arms = [(name, ring, ring.field("reference_valid"), ring.field("reference_frame"),
                       ring.field("measured_cp")) for name, ring in rings]

    def step(self, now_ns: int) -> None:
        """The newest known poses, if the topic has readers."""
        if not self._writer.is_read:
            return
        found = []
        for name, ring, valid, frame, pose in self._arms:
            if ring.newest() and bool(valid):
                header = MessageHeader(time_of(self._stamps.ns(ring.stamp_ns)), str(plain(frame.item())))
                numbers = pose.tolist()
                found.append(TransformStamped(header, name, Transform(Vector3(*numbers[:3]), Quaternion(*numbers[3:]))))
        if found:
            self._writer.write(TFMessage(found))


class LoopStatistics:
    """Statistics of all processes' loops in their last second, from their control pages: a topic for each."""

    def __init__(self, participant: Participant, pages: Mapping[str, ControlPage], stamps: Stamps) -> None:
        self._stamps = stamps
        self._rows = [(participant.writer(f"stats/{ros_topic(name)}/period_statistics", IntervalStatistics), page)
                      for name, page in pages.items()]

    def step(self, now_ns: int) -> None:
        """Publish, for topics with readers."""
        for writer, page in self._rows:
            if not writer.is_read:
                continue
            period, work = ([float(page.get(f"{what}_{figure}")) for figure in FIGURES] for what in ("period", "work"))
            message = IntervalStatistics()
            message.header.stamp = time_of(self._stamps.ns(now_ns))
            message.period_avg, message.period_std_dev, message.period_min, message.period_max = period
            (message.compute_time_avg, message.compute_time_std_dev, message.compute_time_min,
             message.compute_time_max) = work
            message.number_of_samples = int(page.get("interval_cycles"))
            message.number_of_overruns, message.statistics_interval = int(page.get("overruns")), 1.0
            writer.write(message)
