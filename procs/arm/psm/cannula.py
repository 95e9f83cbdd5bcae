"""Keeps an instrument's wrist from bending in the cannula, and checks whether its tip is beyond the cannula.

All distances are from the remote centre, where the shaft passes through the cannula: the wrist (frame 4 of the chain)
lies on the shaft, so it moves out with insertion.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from trocar.procs.arm.control import Control
from trocar.procs.arm.joints import JointSpace
from trocar.procs.arm.reports import REPORT_NS
from trocar.procs.document.system import Tool
from trocar.procs.kinematics.poses import Array
from trocar.procs.node.requests import CommandRefused
from trocar.procs.tables import codes

INSERTION: Final = 2
WRIST_FRAME, TIP_FRAME = 4, 6  # indices in the chain
SAFE_DISTANCE: Final = 0.045  # m to the wrist
SAFE_BUFFER: Final = 0.002  # less by this is enough for Cartesian control to begin
MIN_GOAL: Final = 0.001  # m to the tip: closer, its direction is undefined
DEPTH: Final = 0.025  # m to the tip: further, it is beyond the cannula
SNAKE_DEPTH: Final = 0.027
PROBE: Final = 0.2  # m of insertion


class Cannula:
    """Call `measure` after every change of the joint space."""

    def __init__(self, control: Control) -> None:
        self._control = control
        self._wrist = 0.0

    def measure(self) -> None:
        """Wrist position without insertion: behind the remote centre, so negative."""
        kinematics = self._control.joints.kinematics
        if kinematics is not None:
            at = np.zeros(kinematics.n)
            at[INSERTION] = PROBE
            self._wrist = float(np.linalg.norm(kinematics.fk_to(at, WRIST_FRAME)[:3, 3])) - PROBE

    def safe(self, at: Array) -> str:
        """Why Cartesian control may not begin at joints (size,); "": it may."""
        if at[INSERTION] + self._wrist >= SAFE_DISTANCE - SAFE_BUFFER:
            return ""
        least = SAFE_DISTANCE - SAFE_BUFFER - self._wrist
        return f"the instrument needs to be inserted past the cannula, to {least:.4f} m, for Cartesian control"

    def guard(self, found: Array, seed: Array) -> None:
        """Keep the wrist out of the cannula; from a start inside the safe distance, it retracts no further.

        Changes joints (count,) that were found for a goal; CommandRefused for a goal at the remote centre.
        """
        least = SAFE_DISTANCE - self._wrist
        if found[INSERTION] >= least:
            return
        kinematics = self._control.joints.kinematics
        if kinematics is not None and np.linalg.norm(kinematics.fk(found, np.eye(4))[:3, 3]) < MIN_GOAL:
            reason = "can't solve IK too close to RCM"
            self._control.report(codes.NEAR_RCM, reason, REPORT_NS)
            raise CommandRefused(f"unable to solve inverse kinematics ({reason})")
        found[INSERTION] = max(seed[INSERTION], found[INSERTION]) if seed[INSERTION] <= least else least

    def beyond(self, joints: JointSpace, tool: Tool, discs: Array) -> str:
        """How far the tip of a newly attached instrument is beyond the cannula, for the present actuators (7,); "": it
        is not.
        """
        if joints.kinematics is None:
            return ""
        given = self._control.arm.cannula_depth
        least = given or (SNAKE_DEPTH if tool.snake else DEPTH)
        at = joints.to_joint @ discs
        depth = float(np.linalg.norm(joints.kinematics.fk_to(at[: joints.count], TIP_FRAME)[:3, 3]))
        source = "of the arm file" if given else "not in the arm file"
        return f"{depth * 1e3:.1f} mm deep, cannula_depth ({source}) {least * 1e3:.0f} mm" if depth >= least else ""
