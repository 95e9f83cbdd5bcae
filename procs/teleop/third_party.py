"""An arm of a third-party program: its values are checked before use."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from trocar.procs.kinematics.poses import Array
from trocar.procs.node.inputs import Fields, Input
from trocar.procs.teleop.arms import TeleopArm
from trocar.shm.mailbox.client import LoopClient
from trocar.shm.ring.ring import RingReader

UNIT: Final = 1e-3  # permitted deviation of a quaternion from length 1


class ThirdPartyArm(TeleopArm):
    """A TeleopArm with more faults: a value that is not a number, and a gripper that comes and goes."""

    sets_pace = False  # its records may be irregular

    def __init__(self, name: str, record: Input, events: RingReader, sender: LoopClient) -> None:
        super().__init__(name, record, events, sender, is_master=True)  # a third-party slave is checked, too
        self._shown = record.field("measured_cp"), record.field("setpoint_cp")
        self._had_gripper = False

    def base_of(self, field: Fields) -> Array:
        """Programs do not report bases; a change of base shows as a jump."""
        return np.zeros(7)

    @property
    def has_jaw(self) -> bool:
        return super().has_jaw and math.isfinite(self.jaw)

    def objection(self) -> str:
        if not self._known:
            return ""
        if not all(_is_pose(pose) for pose in self._shown):
            self.is_known = False
            return f"{self.name} reports an invalid pose"
        had, self._had_gripper = self._had_gripper, bool(self._gripper_valid)
        if had and not self._had_gripper:
            return f"{self.name} has lost its gripper"
        is_fine = not self._had_gripper or math.isfinite(self._gripper)
        return "" if is_fine else f"{self.name} reports an invalid gripper angle"


def _is_pose(pose: Array) -> bool:
    return bool(abs(math.hypot(*pose[3:]) - 1.0) <= UNIT and math.isfinite(pose[:3].sum()))
