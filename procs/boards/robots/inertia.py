"""Inertia and friction of what stands on boards beside the arms of `trocar.procs.tables.arm_types`, and of instruments.

Viscous and Coulomb friction of the wrist are from the recording of a real PSM; its inertia was too small to be seen
there, and is as little as keeps the stock gains stable at a 1 ms hold: armature >= 2 · Kd · period on every axis.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from trocar.procs.tables.arm_types import ARM_TYPES, ArmInertia, JointInertia

Array = NDArray[np.float64]

DISC = JointInertia(4.0e-4, 0.004, 0.004)  # of a PSM without instrument
WRIST_FRICTION = (  # viscous, Coulomb of roll, wrist pitch, wrist yaw, jaw: at the joints, behind the coupling
    (0.0009, 0.0027),
    (0.0088, 0.0071),
    (0.0090, 0.0069),
    (0.0088, 0.0110),
)
LOOSE = JointInertia(1.0e-3, 0.01, 0.002)  # an axis of a robot that no arm describes: grippers, sensors
LOOSE_SLIDE = JointInertia(1.0, 10.0, 2.0)
GRIPPER_RANGE = (-0.2, 1.1)  # rad, of a master's gripper; its file has no limits
GRIPPER_INITIAL = 0.5

SET_UP_SLIDE = JointInertia(30.0, 200.0, 40.0)  # the column of a setup arm; brakes and balance are in the friction
SET_UP_HINGE = JointInertia(2.0, 10.0, 8.0)

LINK_MASS = 0.05  # kg, of links whose file gives none; counter-balanced, so only a trace in the inertia
LINK_INERTIA = 1.0e-5  # kg·m², about every axis of such a link

SET_UP_ARMS = {
    "Classic": ArmInertia(
        joints=(SET_UP_SLIDE, *(SET_UP_HINGE,) * 5),
        initial=(0.05, -0.6, 1.2, -0.4, 0.2, 0.2),
    ),
    "Si": ArmInertia(
        joints=(SET_UP_SLIDE, *(SET_UP_HINGE,) * 6),
        initial=(0.2, -0.3, 1.2, 0.8, 0.0, 0.0, 0.0),
    ),
}


def wrist_inertia(actuator_to_joint: Array) -> tuple[JointInertia, ...]:
    """Rows for an instrument's roll, wrist and jaw, from its coupling (4, 4).

    A motor must feel no less through the instrument than its bare disc, or gains that hold the disc shake the wrist:
    Aᵀ·D·A >= I·1 for the diagonal D wanted here, that is D >= I·(A·Aᵀ)⁻¹. Sums along the rows make sure of it.
    """
    inverse = np.linalg.inv(actuator_to_joint @ actuator_to_joint.T)
    armature = DISC.armature * np.abs(inverse).sum(axis=1)
    return tuple(JointInertia(float(a), *friction) for a, friction in zip(armature, WRIST_FRICTION, strict=True))


def arm_inertia(arm_type: str, generation: str, joints: int) -> ArmInertia | None:
    """The row of an arm type with so many joints; None for types without one (their axes are loose).

    MTML and MTMR count as MTM; setup arms have more or fewer joints.
    """
    if arm_type.startswith("SUJ"):
        row = SET_UP_ARMS.get(generation, SET_UP_ARMS["Classic"])
        return ArmInertia(row.joints[:joints], row.initial[:joints])
    known = ARM_TYPES.get("MTM" if arm_type.startswith("MTM") else arm_type)
    return (known.plant.get(generation) or known.plant.get("Classic")) if known is not None else None
