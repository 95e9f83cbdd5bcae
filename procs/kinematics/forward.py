"""Forward kinematics and Jacobians of a Denavit-Hartenberg chain, on pinocchio.

The tip transform goes through a unit quaternion, as dVRK loads it, and belongs to the full chain only. Jacobian rows:
linear x y z, then angular x y z.
"""

from __future__ import annotations

import numpy as np
import pinocchio
from numpy.typing import NDArray

from procs.document.system import Chain, DhLink, Tool
from procs.kinematics.denavit import split_row
from procs.kinematics.poses import renormalised

Array = NDArray[np.float64]


class Kinematics:
    """A chain with an optional tool: joints in file order, poses in the chain's base frame (with its base offset).

    `update(q)` computes the tip pose and body Jacobian once; `tip`, `body`, `spatial` are preallocated arrays that the
    next call overwrites. q: (n,) float64, contiguous, rad or m.
    """

    def __init__(self, chain: Chain, tool: Tool | None = None, tip: Array | None = None) -> None:
        """`tip` (4, 4) replaces the tool's tip transform (endoscopes, whose tips stand in no file)."""
        links = chain.links + (tool.links if tool is not None else ())
        if not links:
            raise ValueError(f"{chain.source or 'chain'}: a chain needs at least one joint")
        if tip is None:
            tip = renormalised(np.array(tool.tip)) if tool is not None else np.eye(4)
        self.n = len(links)
        self.names = tuple(link.name for link in links)
        self.lower = np.array([link.lower for link in links])
        self.upper = np.array([link.upper for link in links])
        self.effort_max = np.array([link.effort_max for link in links])
        self.is_prismatic = np.array([link.joint_type == "prismatic" for link in links])
        self._model, self._frames = _model(chain, links, tip)
        self._data = self._model.createData()
        self._end = self._frames[-1]
        # pinocchio computes into its own memory; these are views of it, taken once
        self._end_rotation = self._data.oMf[self._end].rotation
        self._end_position = self._data.oMf[self._end].translation
        self.joint_jacobian: Array = self._data.J
        """Spatial Jacobian (6, n) of the last `update`."""
        self.tip = np.eye(4)
        self._tip_rotation = self.tip[:3, :3]
        self._tip_position = self.tip[:3, 3]
        self.body = np.zeros((6, self.n), order="F")
        self._updated = b""  # joints that `tip`, `body` and `joint_jacobian` are for
        self.spatial = np.zeros((6, self.n), order="F")

    def update(self, q: Array) -> None:
        """Tip pose and body Jacobian at q into `tip` and `body`."""
        raw = q.tobytes()
        if raw == self._updated:  # a kinematic robot is where it was told to be
            return
        self._updated = raw
        pinocchio.computeJointJacobians(self._model, self._data, q)
        self.body[...] = pinocchio.getFrameJacobian(self._model, self._data, self._end, pinocchio.LOCAL)
        pinocchio.updateFramePlacement(self._model, self._data, self._end)  # the Jacobian does not do it
        self._tip_rotation[...] = self._end_rotation
        self._tip_position[...] = self._end_position

    def miss(self, q: Array, goal: pinocchio.SE3) -> tuple[Array, Array]:
        """Twist (6,) from the tip at q to the goal, in tip axes, and the body Jacobian (6, n) there. New arrays."""
        self._updated = b""
        pinocchio.computeJointJacobians(self._model, self._data, q)
        placement = pinocchio.updateFramePlacement(self._model, self._data, self._end)
        jacobian = pinocchio.getFrameJacobian(self._model, self._data, self._end, pinocchio.LOCAL)
        return pinocchio.log6(placement.actInv(goal)).vector, jacobian

    def fk(self, q: Array, out: Array | None = None) -> Array:
        """Pose of the tip (4, 4); written to `out` when given, else to `tip`."""
        self._updated = b""
        pinocchio.framesForwardKinematics(self._model, self._data, q)
        if out is None:
            self._tip_rotation[...] = self._end_rotation
            self._tip_position[...] = self._end_position
            return self.tip
        out[:3, :3] = self._end_rotation
        out[:3, 3] = self._end_position
        out[3] = (0.0, 0.0, 0.0, 1.0)
        return out

    def fk_to(self, q: Array, link: int) -> Array:
        """Pose (4, 4) of the frame after `link` joints, without the tip (0: the base, n: the last link). New array."""
        if not 0 <= link <= self.n:
            raise IndexError(f"link {link}: this chain has frames 0 to {self.n}")
        self._updated = b""
        pinocchio.framesForwardKinematics(self._model, self._data, q)
        return np.array(self._data.oMf[self._frames[link]].homogeneous)

    def body_jacobian(self, q: Array) -> Array:
        """Jacobian (6, n) of the tip's twist, at the tip in tip axes; the array `body`."""
        self._updated = b""
        self.body[...] = pinocchio.computeFrameJacobian(self._model, self._data, q, self._end, pinocchio.LOCAL)
        return self.body

    def spatial_jacobian(self, q: Array) -> Array:
        """Jacobian (6, n) of the spatial twist, at the base's origin in base axes; the array `spatial`."""
        self._updated = b""
        pinocchio.computeJointJacobians(self._model, self._data, q)
        self.spatial[...] = self.joint_jacobian
        return self.spatial


def _model(chain: Chain, links: tuple[DhLink, ...], tip: Array) -> tuple[pinocchio.Model, tuple[int, ...]]:
    """The pinocchio model and the ids of its frames: base, after each link, tip."""
    model = pinocchio.Model()
    before_next = np.array(chain.base) if chain.base is not None else np.eye(4)
    frames = [_frame(model, "base", 0, before_next)]
    joint = 0
    for index, link in enumerate(links):
        before, after = split_row(chain.convention, link)
        kind = pinocchio.JointModelPZ() if link.joint_type == "prismatic" else pinocchio.JointModelRZ()
        placement = pinocchio.SE3(before_next @ before)
        joint = model.addJoint(joint, kind, placement, f"{index} {link.name}")  # numbered: file names may repeat
        frames.append(_frame(model, f"link {index + 1}", joint, after))
        before_next = after
    frames.append(_frame(model, "tip", joint, before_next @ tip))
    return model, tuple(frames)


def _frame(model: pinocchio.Model, name: str, joint: int, placement: Array) -> int:
    frame = pinocchio.Frame(name, joint, 0, pinocchio.SE3(placement), pinocchio.FrameType.OP_FRAME)
    return int(model.addFrame(frame))
