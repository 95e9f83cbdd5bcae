"""Names of the ROS nodes behind messages, as their processes announce them (topic `ros_discovery_info`)."""

from __future__ import annotations

from typing import Final
from uuid import UUID

from trocar.procs.ros_messages.dds import PARTICIPANTS, Participant
from trocar.procs.ros_messages.messages import ParticipantEntitiesInfo

KEPT: Final = 1000
NAME: Final = 64  # characters


class NodeNames:
    """The first node of each process; any program may announce any name, so it is for messages only."""

    def __init__(self, participant: Participant) -> None:
        self._reader = participant.read_as("ros_discovery_info", ParticipantEntitiesInfo, PARTICIPANTS, latched=True)
        self._names: dict[bytes, str] = {}

    def look(self) -> None:
        """Read what processes have announced since the last call."""
        for info in self._reader.take():
            names = [node.node_name[:NAME] for node in info.node_entities_info_seq]
            if len(self._names) >= KEPT:
                self._names.clear()
            self._names[bytes(info.gid.data)] = next((name for name in names if name.isidentifier()), "")

    def of(self, participant: UUID) -> str:
        """The node of this participant; "": unknown."""
        return self._names.get(participant.bytes, "")
