"""A chain in pinocchio: the truth that our own kinematics are compared with."""

from __future__ import annotations

import numpy as np
import pinocchio

from trocar.procs.document.system import Chain, DhLink, Tool
from trocar.procs.kinematics.forward import split_row
from trocar.procs.kinematics.poses import renormalised


class PinocchioChain:
    """Poses, Jacobians and holding efforts at joints (n,); new arrays."""

    def __init__(self, chain: Chain, tool: Tool | None = None, tip: np.ndarray | None = None,
                 masses: dict[int, float] | None = None) -> None:
        links = chain.links + (tool.links if tool is not None else ())
        if tip is None:
            tip = renormalised(np.array(tool.tip)) if tool is not None else np.eye(4)
        self.model = pinocchio.Model()
        before_next = np.array(chain.base) if chain.base is not None else np.eye(4)
        self.frames = [self._frame("base", 0, before_next)]
        joint = 0
        for index, link in enumerate(links):
            before, after = split_row(chain.convention, link)
            kind = pinocchio.JointModelPZ() if link.joint_type == "prismatic" else pinocchio.JointModelRZ()
            joint = self.model.addJoint(joint, kind, pinocchio.SE3(before_next @ before), f"{index} {link.name}")
            self.model.appendBodyToJoint(joint, _inertia(link, (masses or {}).get(index)), pinocchio.SE3(after))
            self.frames.append(self._frame(f"link {index + 1}", joint, after))
            before_next = after
        self.end = self._frame("tip", joint, before_next @ tip)
        self.data = self.model.createData()

    def frame(self, q: np.ndarray, link: int = -1) -> np.ndarray:
        """The frame after so many links, -1: the tip."""
        pinocchio.framesForwardKinematics(self.model, self.data, q)
        return np.array(self.data.oMf[self.end if link < 0 else self.frames[link]].homogeneous)

    def body(self, q: np.ndarray) -> np.ndarray:
        return np.array(pinocchio.computeFrameJacobian(self.model, self.data, q, self.end, pinocchio.LOCAL))

    def spatial(self, q: np.ndarray) -> np.ndarray:
        return np.array(pinocchio.computeJointJacobians(self.model, self.data, q))

    def efforts(self, q: np.ndarray, up: np.ndarray) -> np.ndarray:
        """That hold the links where gravity is -`up`."""
        self.model.gravity.linear = -up
        return np.array(pinocchio.computeGeneralizedGravity(self.model, self.data, q))

    def _frame(self, name: str, joint: int, placement: np.ndarray) -> int:
        kind = pinocchio.FrameType.OP_FRAME
        return int(self.model.addFrame(pinocchio.Frame(name, joint, 0, pinocchio.SE3(placement), kind)))


def _inertia(link: DhLink, mass: float | None) -> pinocchio.Inertia:
    return pinocchio.Inertia(link.mass if mass is None else mass, np.array(link.com), np.array(link.inertia))


def twist_between(f: np.ndarray, g: np.ndarray) -> np.ndarray:
    """The logarithm of f⁻¹ · g, both (4, 4)."""
    return np.array(pinocchio.log6(pinocchio.SE3(f).actInv(pinocchio.SE3(g))).vector)
