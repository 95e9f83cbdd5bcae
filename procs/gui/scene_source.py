"""The robot in space: where the links of every arm are, from its joints and its kinematic chain."""

from __future__ import annotations

import contextlib
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from procs.arm_types import ARM_TYPES
from procs.document.arms import ArmConfig
from procs.document.system import SystemConfig
from procs.kinematics.carrying import carrying
from procs.kinematics.forward import Kinematics
from procs.kinematics.poses import matrix_from_pose, pose_from_matrix
from shm import directory
from shm.segment import SegmentError

Array = NDArray[np.float64]
LATE_NS: Final = 500_000_000


class SceneArm:
    """One arm: the frames of its links in the frame that its poses are told in."""

    def __init__(self, document: SystemConfig, arm: ArmConfig) -> None:
        """Attach; SegmentError when its record cannot be read."""
        self._arm = arm
        self._reader = directory.reader(document.name, arm.name, "state", "arm", often=False)
        self._cells = {name: self._reader.field(name) for name in (
            "position", "count", "tool", "base_frame", "reference_frame", "state", "valid", "has_jaw", "jaw_position",
            "setpoint_position", "gripper_position", "reference_valid")}
        self._tool, self._kinematics = "", carrying(arm, arm.endoscope)
        self._lower, self._upper = self._kinematics.lower, self._kinematics.upper
        self._sequence, self._seen_ns = 0, 0
        self._base = np.eye(4)
        self._frames: list[float] = []

    def read(self, now_ns: int) -> dict[str, Any]:
        """`frames`: x y z and quaternion x y z w of the base, of each joint and of the tip, one after the other."""
        if not self._reader.newest():
            return {"frames": [], "late": True}
        if self._reader.sequence != self._sequence:
            self._sequence, self._seen_ns = self._reader.sequence, now_ns
        cells = self._cells
        tool = cells["tool"].item().decode(errors="replace") or self._arm.endoscope
        if tool != self._tool:
            self._tool, self._kinematics = tool, carrying(self._arm, tool)
        count = min(self._kinematics.n, int(cells["count"]))
        q = np.nan_to_num(cells["position"][:self._kinematics.n])
        q[count:] = 0.0
        base = cells["base_frame"]
        self._base = matrix_from_pose(base) if np.isfinite(base).all() and base[3:].any() else np.eye(4)
        lower, upper = self._kinematics.lower[:count], self._kinematics.upper[:count]
        near = np.minimum(q[:count] - lower, upper - q[:count]) < 0.03 * (upper - lower)
        return {"frames": frames_of(self._kinematics, q, self._base), "near": near.tolist(),
                "state": cells["state"].item().decode(errors="replace"),
                "jaw": float(cells["jaw_position"]) if cells["has_jaw"] else None,
                "frame": cells["reference_frame"].item().decode(errors="replace"),
                "late": now_ns - self._seen_ns > LATE_NS}

    def close(self) -> None:
        """Unmap."""
        self._reader.close()


def frames_of(kinematics: Kinematics, q: Array, base: Array) -> list[float]:
    """Poses of base, joints and tip, 7 numbers each, of an arm whose base is there."""
    poses = [pose_from_matrix(base)]
    matrix = np.eye(4)
    for frame in kinematics.links.frames(q.tolist()):
        matrix[:3] = np.reshape(frame, (3, 4))
        poses.append(pose_from_matrix(base @ matrix))
    poses.append(pose_from_matrix(base @ kinematics.fk(q)))
    return [round(float(value), 5) for value in np.concatenate(poses)]


class SceneSource:
    """All arms, in one message."""

    def __init__(self, document: SystemConfig) -> None:
        self._arms: dict[str, SceneArm] = {}
        for arm in document.arms:
            with contextlib.suppress(SegmentError):
                self._arms[arm.name] = SceneArm(document, arm)

    def read(self, now_ns: int) -> dict[str, Any]:
        """`arms`, by name."""
        return {"age": 0.0, "arms": {name: arm.read(now_ns) for name, arm in self._arms.items()}}

    def close(self) -> None:
        """Unmap."""
        for arm in self._arms.values():
            arm.close()


def drawn(arm: ArmConfig) -> dict[str, Any]:
    """What a page has to know of an arm to draw it: which of its joints slide."""
    return {"type": arm.type, "slides": [link.joint_type == "prismatic" for link in arm.chain.links],
            "endoscope": ARM_TYPES[arm.type].has_endoscope}
