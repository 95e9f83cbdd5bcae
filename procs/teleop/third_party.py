"""An arm that is a third-party program: nothing that it says is believed before it is looked at."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from procs.inputs import LATE_NS, Input, RecordReader
from procs.kinematics.poses import angle_between
from procs.requests import Sender
from procs.teleop.arms import Array, Fields, TeleopArm

# A hand goes slower than this, a tracker that lost its way is faster. What a step may have on top lets devices of
# coarse resolution and records that were held up through.
FASTEST_M_S: Final = 2.0
FASTEST_RAD_S: Final = 15.0
STEP_M: Final = 0.005
STEP_RAD: Final = 0.1
MAX_STEP_NS: Final = LATE_NS  # a record that comes later is from somebody who was silent
STEADY_NS: Final = 500_000_000  # so long without a fault until it is believed again
UNIT: Final = 1e-3  # how far from length 1 a quaternion may be


class ThirdPartyArm(TeleopArm):
    """The same as an arm, and `doubt`: why its pose is not believed now.

    A pose that cannot be reached from the one before is a fault, and so is a twist too fast, a number that is none or a
    gripper that comes and goes: following ends, and restarts only after STEADY_NS without a fault.
    """

    sets_pace = False  # its records come when it likes

    def __init__(self, name: str, record: Input, events: RecordReader, sender: Sender) -> None:
        super().__init__(name, record, events, sender)
        self._shown = record.field("measured_cp"), record.field("setpoint_cp"), record.field("measured_cv")
        self._last = np.zeros(7)
        self._has_last = self._had_gripper = False
        self._last_stamp_ns = self._last_seen_ns = self._steady_ns = 0
        self._room_m, self._room_rad = STEP_M, STEP_RAD  # left: who is quicker all the time uses them up

    def base_of(self, field: Fields) -> Array:
        """Programs do not tell of bases; one that is another is a jump."""
        return np.zeros(7)

    @property
    def has_jaw(self) -> bool:
        """See TeleopArm."""
        return super().has_jaw and math.isfinite(self.jaw)

    def look(self, now_ns: int) -> None:
        """See TeleopArm."""
        super().look(now_ns)
        self.fault = ""
        if self.restarted:
            self._has_last = False
        if self.whole and self.stamp_ns != self._last_stamp_ns:
            wrong = self._what_is_wrong()
            if wrong:
                if now_ns >= self._steady_ns:  # the first: it is reported once, however many follow
                    self.fault = self.doubt = wrong
                self._steady_ns = now_ns + STEADY_NS
            self._last_stamp_ns, self._last_seen_ns = self.stamp_ns, now_ns
        if now_ns < self._steady_ns:
            self._reported = False
        elif self.doubt:
            self.doubt = ""

    def _what_is_wrong(self) -> str:
        """The fault of a new record, "": none; what it says is what the next one is compared with."""
        if not self._known:
            self._has_last = False  # it says itself that it does not know
            return ""
        pose, setpoint, twist = self._shown
        if not (_is_pose(pose) and _is_pose(setpoint)):
            self._has_last = False
            return f"what {self.name} says is no pose"
        wrong = self._jump(pose) if self._has_last else ""
        self._last[...], self._has_last = pose, True
        return wrong or self._motion(twist) or self._fingers()

    def _jump(self, pose: Array) -> str:
        passed_ns = max(self.stamp_ns - self._last_stamp_ns, self._now_ns - self._last_seen_ns)
        passed_s = min(passed_ns, MAX_STEP_NS) * 1e-9
        way, turn = math.dist(pose[:3], self._last[:3]), angle_between(pose, self._last)
        room_m, room_rad = self._room_m + FASTEST_M_S * passed_s - way, self._room_rad + FASTEST_RAD_S * passed_s - turn
        self._room_m = STEP_M if room_m < 0.0 else min(room_m, STEP_M)
        self._room_rad = STEP_RAD if room_rad < 0.0 else min(room_rad, STEP_RAD)
        if room_m < 0.0:
            return f"{self.name} jumped by {way * 1e3:.0f} mm, a hand's way in that time is {FASTEST_M_S:g} m/s"
        if room_rad < 0.0:
            return f"{self.name} jumped by {math.degrees(turn):.0f}°, a hand's turn is {FASTEST_RAD_S:g} rad/s"
        return ""

    def _motion(self, twist: Array) -> str:
        linear, angular = math.hypot(*twist[:3]), math.hypot(*twist[3:])
        if linear <= FASTEST_M_S and angular <= FASTEST_RAD_S:  # not a number fails, too
            return ""
        return f"{self.name} says it goes at {linear:g} m/s, {angular:g} rad/s"

    def _fingers(self) -> str:
        """A gripper that is there or is not; without one the jaw stands open."""
        had, self._had_gripper = self._had_gripper, bool(self._gripper_valid)
        if had and not self._had_gripper:
            return f"{self.name} has lost its gripper"
        return "" if not self._had_gripper or math.isfinite(self._gripper) else f"{self.name}'s gripper is no angle"


def _is_pose(pose: Array) -> bool:
    return bool(abs(math.hypot(*pose[3:]) - 1.0) <= UNIT and math.isfinite(pose[:3].sum()))
