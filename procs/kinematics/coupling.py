"""Actuators to joints and back, for positions, velocities and efforts.

One matrix defines all of them: joint = A · actuator for positions and velocities; power is the same on both sides, so
efforts use the transposed inverse: joint effort = A⁻ᵀ · actuator effort, actuator effort = Aᵀ · joint effort.
"""

from __future__ import annotations

import numpy as np

from trocar.procs.document.system import Chain, Matrix, Tool
from trocar.procs.kinematics.poses import Array

TOOL_AT = 3  # an instrument's four discs follow the arm's first three joints


class Coupling:
    """The coupling of one robot with n actuators, SI."""

    def __init__(self, actuator_to_joint: Array) -> None:
        """`actuator_to_joint`: (n, n), invertible (ValueError otherwise)."""
        matrix = np.array(actuator_to_joint, dtype=np.float64)
        if matrix.ndim != 2 or matrix.shape[0] != matrix.shape[1] or not np.isfinite(matrix).all():
            raise ValueError(f"a coupling is a finite square matrix, not one of shape {matrix.shape}")
        if not np.linalg.cond(matrix) <= 1e9:
            raise ValueError("a coupling must be invertible")
        self.n = matrix.shape[0]
        self.actuator_to_joint = matrix
        self.joint_to_actuator = np.linalg.inv(matrix).astype(np.float64)
        self.is_identity = bool(np.array_equal(matrix, np.eye(self.n)))


def coupling(actuators: int, chain: Chain, tool: Tool | None = None) -> Coupling:
    """The coupling of an arm: its instrument's block on the last four actuators, else the kinematic file's, else none.
    """
    matrix = np.eye(actuators)
    if tool is not None:
        _place(matrix, tool.actuator_to_joint, TOOL_AT, tool.source or tool.name)
    elif chain.actuator_to_joint is not None:
        _place(matrix, chain.actuator_to_joint, 0, chain.source or "chain")
    return Coupling(matrix)


def _place(matrix: Array, block: Matrix, at: int, source: str) -> None:
    values = np.array(block)
    end = at + len(values)
    if values.shape != (len(values), len(values)) or end > len(matrix):
        raise ValueError(f"{source}: a coupling of shape {values.shape} does not fit {len(matrix)} actuators at {at}")
    matrix[at:end, at:end] = values
