"""What arms look like, for RViz and others: `robot_description` of each, told anew when it gets another instrument."""

from __future__ import annotations

from collections.abc import Iterable

from trocar.procs.crtk.plain import plain
from trocar.procs.document.system import ArmConfig
from trocar.procs.kinematics.inverse.arms import carrying
from trocar.procs.kinematics.urdf import urdf
from trocar.procs.ros_bridge.publishing import ros_topic
from trocar.procs.ros_messages.dds import LATCHED, Participant
from trocar.procs.ros_messages.messages import String
from trocar.shm.system import directory


class Descriptions:
    """Of all arms."""

    def __init__(self, participant: Participant, system: str, arms: Iterable[ArmConfig]) -> None:
        self._arms = []
        for arm in arms:
            ring = directory.reader(system, arm.name, "state")
            writer = participant.writer(ros_topic(f"{arm.name}/robot_description"), String, LATCHED)
            self._arms.append((arm, ring, ring.field("tool"), writer))
        self._told: dict[str, str] = {}

    def step(self) -> None:
        """Of those that carry something else than before."""
        for arm, ring, tool, writer in self._arms:
            carried = str(plain(tool.item())) if ring.newest() else ""
            if self._told.get(arm.name) != carried:
                self._told[arm.name] = carried
                writer.write(String(urdf(ros_topic(arm.name), carrying(arm, carried))))

    def close(self) -> None:
        """Unmap."""
        for _, ring, *_ in self._arms:
            ring.close()
