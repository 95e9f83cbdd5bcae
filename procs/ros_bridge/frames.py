"""Where the arms' tips are, for tf: a frame of each arm's name in the frame of its measured_cp."""

from __future__ import annotations

from collections.abc import Sequence

from trocar.procs.crtk.plain import plain
from trocar.procs.crtk.stamps import Stamps
from trocar.procs.ros_bridge.stamps import time_of
from trocar.procs.ros_messages.dds import Participant
from trocar.procs.ros_messages.messages import (
    MessageHeader,
    Quaternion,
    TFMessage,
    Transform,
    TransformStamped,
    Vector3,
)
from trocar.shm.system import directory


class TipFrames:
    """All tips that are known, in one message."""

    def __init__(self, participant: Participant, system: str, arms: Sequence[str]) -> None:
        self._writer = participant.writer("/tf", TFMessage)
        self._arms = []
        for name in arms:
            ring = directory.reader(system, name, "state")
            cells = ring.field("reference_valid"), ring.field("reference_frame"), ring.field("measured_cp")
            self._arms.append((name, ring, *cells))

    def step(self, stamps: Stamps) -> None:
        """The newest poses, if anybody reads them."""
        if not self._writer.is_read:
            return
        found = []
        for name, ring, valid, frame, pose in self._arms:
            if ring.newest() and bool(valid):
                header = MessageHeader(time_of(stamps.ns(ring.stamp_ns)), str(plain(frame.item())))
                numbers = pose.tolist()
                found.append(TransformStamped(header, name, Transform(Vector3(*numbers[:3]), Quaternion(*numbers[3:]))))
        if found:
            self._writer.write(TFMessage(found))

    def close(self) -> None:
        """Unmap."""
        for _, ring, *_ in self._arms:
            ring.close()
