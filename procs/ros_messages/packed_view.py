"""A view as the ROS message that it becomes, packed: for the ROS bridge and for recordings."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

import numpy as np

from trocar.procs.crtk.views import OpenTopic
from trocar.procs.ros_messages.messages import JointStates
from trocar.procs.ros_messages.packing import PackedMessage
from trocar.procs.ros_messages.view_messages import VIEW_MESSAGES

SECOND_NS: Final = 1_000_000_000


class PackedView:
    """One view; `carrier` is its message for a writer of DDS, `data` the message packed."""

    def __init__(self, source: OpenTopic, frame: Callable[[], str]) -> None:
        """The caller of `pack` reads `source`; `frame` returns the frame at that time."""
        row = VIEW_MESSAGES[source.entry.kind]
        self._source, self._parts, self._frame = source, row.parts, frame
        self._packed = PackedMessage(row.message, row.put)
        self._has_joints = row.message is JointStates
        self._texts: tuple[bytes, str] = b"?", ""
        self.carrier: Any = self._packed.carrier

    def pack(self, stamp_ns: int) -> None:
        """The record last read, with this stamp; an invalid one gets a stamp of 0."""
        source, packed = self._source, self._packed
        texts = source.part("name").tobytes() if self._has_joints else b"", self._frame()
        if texts != self._texts:
            self._texts = texts
            self._name(packed.message)
        blocks = [np.asarray(source.part(part), dtype=np.float64).ravel() for part in self._parts]
        packed.pack(texts, blocks, divmod(stamp_ns if source.valid and source.stamp_ns else 0, SECOND_NS))

    @property
    def data(self) -> bytes:
        """The last packed message."""
        return bytes(self._packed.data)

    def _name(self, message: Any) -> None:
        if self._has_joints:
            message.name = self._source.labels()
        if hasattr(message, "header"):
            message.header.frame_id = self._texts[1]
