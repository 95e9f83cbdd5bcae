"""Plausibility of a master's motion: one rule for all masters, ours and third-party ones.

A pose that a hand cannot reach from the previous one is a fault, and so is a twist too fast: following ends, and
restarts only after STEADY_NS without a fault.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from trocar.procs.kinematics.poses import Array, angle_between
from trocar.procs.node.inputs import LATE_NS

# A hand is slower than this, even if it rolls a master between two fingers; an encoder that jumps, or a tracker
# that lost its target, is faster. The additional step permits coarse resolution and late records.
MAX_M_S: Final = 2.0
MAX_RAD_S: Final = 30.0
STEP_M: Final = 0.005
STEP_RAD: Final = 0.1
MAX_STEP_NS: Final = LATE_NS  # a later record is from a master that was silent
STEADY_NS: Final = 500_000_000  # time without a fault until the master is plausible again


class MotionCheck:
    """`fault`: why a master is implausible from this cycle on; `doubt`: the same for as long as it lasts."""

    def __init__(self, name: str, pose: Array, twist: Array) -> None:
        """`pose` (7,) and `twist` (6,) of the tip, in the reference frame, are views of the newest record."""
        self._name, self._pose, self._twist = name, pose, twist
        self.fault = self.doubt = ""
        self.last = np.zeros(7)
        self.has_last = False
        self.stamp_ns = self.seen_ns = self._steady_ns = 0
        self.room_m, self.room_rad = STEP_M, STEP_RAD  # remaining: a master that is always too fast uses them up

    def forget(self) -> None:
        """The master may be anywhere: the next pose is not compared."""
        self.has_last = False

    def look(self, stamp_ns: int, now_ns: int, *, known: bool, objection: str = "") -> None:
        """Once a cycle. `known`: the pose is, `objection`: any other problem of the record with this stamp."""
        self.fault = ""
        if stamp_ns != self.stamp_ns:
            wrong = self._judge(stamp_ns, now_ns, known) or objection
            if wrong:
                if now_ns >= self._steady_ns:  # reported once for a series of faults
                    self.fault = self.doubt = wrong
                self._steady_ns = now_ns + STEADY_NS
            self.stamp_ns, self.seen_ns = stamp_ns, now_ns
        if now_ns >= self._steady_ns:
            self.doubt = ""

    def _judge(self, stamp_ns: int, now_ns: int, known: bool) -> str:
        had_last, self.has_last = self.has_last, known
        if not known:
            return ""
        passed_ns = max(stamp_ns - self.stamp_ns, now_ns - self.seen_ns)
        wrong = self._jump(min(passed_ns, MAX_STEP_NS) * 1e-9) if had_last else ""
        self.last[...] = self._pose
        return wrong or self._speed()

    def _jump(self, passed_s: float) -> str:
        far, turn = math.dist(self._pose[:3], self.last[:3]), angle_between(self._pose, self.last)
        room_m, room_rad = self.room_m + MAX_M_S * passed_s - far, self.room_rad + MAX_RAD_S * passed_s - turn
        self.room_m = STEP_M if room_m < 0.0 else min(room_m, STEP_M)
        self.room_rad = STEP_RAD if room_rad < 0.0 else min(room_rad, STEP_RAD)
        if room_m < 0.0:
            return f"{self._name} jumped by {far * 1e3:.0f} mm; a hand moves at {MAX_M_S:g} m/s at most"
        if room_rad < 0.0:
            return f"{self._name} jumped by {math.degrees(turn):.0f}°; a hand turns at {MAX_RAD_S:g} rad/s at most"
        return ""

    def _speed(self) -> str:
        linear, angular = math.hypot(*self._twist[:3]), math.hypot(*self._twist[3:])
        if linear <= MAX_M_S and angular <= MAX_RAD_S:  # false for NaN, too
            return ""
        return f"{self._name} reports a speed of {linear:.3g} m/s, {angular:.3g} rad/s"
