"""A teleoperation's own record; arrays are resolved once, texts written when they change."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from trocar.procs.node.inputs import Fields
from trocar.shm.memory.layout import shorten


class TeleopRecord:
    """The `state` record of the topic table; a kind fills its own fields by `field`."""

    def __init__(self, field: Fields, kind: str, masters: Sequence[str], slave: str, console: str) -> None:
        self.field = field
        field("kind")[...], field("slave")[...], field("console")[...] = kind.encode(), slave.encode(), console.encode()
        field("masters")[...] = b""
        field("masters")[: len(masters)] = [name.encode() for name in masters]
        self._scale = field("scale")
        for name in ("goal_cp", "goal_jp", "jaw_goal", "gripper_ghost"):
            field(name)[...] = np.nan
        for name in ("sent_ns", "master_stamp_ns", "slave_stamp_ns", "gripper_range", "roll_range", "angle_error"):
            field(name)[...] = 0
        field("operator_active")[...] = False
        field("alignment_offset")[...] = (0.0, 0.0, 0.0, 1.0)
        self.valid = field("valid")
        self._state, self._desired, self._reason = field("state"), field("desired_state"), field("reason")
        self._following, self._clutched, self._busy = field("following"), field("clutched"), field("is_busy")
        self._reported: tuple[str, str, str] | None = None
        self._room = self._reason.dtype.itemsize

    def scale(self, of_file: float) -> float:
        """The scale given to the previous process; without one, that of the file."""
        return float(self._scale) if self._scale > 0.0 else of_file

    def show_scale(self, scale: float) -> None:
        """Show the scale in force."""
        self._scale[...] = scale

    def show(self, state: str, desired: str, reason: str, *, following: bool, clutched: bool) -> None:
        """Fill the fields that both kinds have."""
        self._following[...], self._clutched[...] = following, clutched
        if self._reported != (state, desired, reason):
            self._reported = (state, desired, reason)
            self._state[...], self._desired[...] = state.encode(), desired.encode()
            self._reason[...] = shorten(reason, self._room)
            self._busy[...] = state != desired
