"""THE TABLE of what the stock files do not say: inertia and friction of every arm type, joint by joint.

PSM Classic, first three joints: fitted to 30 s of a real arm (efforts recorded while all joints were excited). Yaw
shows 0.073 kg·m² plus 0.12·cos²(pitch): a long body across the shaft, which pitch turns as well; so that share stands
as the shaft's inertia and the rest, the motors' share, as armature. Viscous and Coulomb friction of the wrist are from
the same recording; its inertia was too small to be seen there, and is as little as keeps the stock gains stable at a
1 ms hold: armature >= 2 · Kd · period on every axis. The other rows are chosen by that rule and an arm's size, not
measured.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class JointInertia:
    """Armature (kg·m² or kg), viscous friction (N·m·s/rad or N·s/m) and Coulomb friction (N·m or N)."""

    armature: float
    viscous: float
    coulomb: float


@dataclass(frozen=True, slots=True)
class ArmInertia:
    """One arm type: a row per joint of its kinematic file, and where it stands when the boards are switched on."""

    joints: tuple[JointInertia, ...]
    initial: tuple[float, ...]  # actuator positions, rad or m
    shaft: tuple[float, float, float] = (0.0, 0.0, 0.0)  # kg·m² about x y z of the insertion link, z along the shaft
    homed_at_stop: int = -1  # the joint that the host homes by its lower stop, which is where the file says


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

SET_UP_SLIDE = JointInertia(30.0, 200.0, 40.0)  # the column of a set-up arm; brakes and balance are in the friction
SET_UP_HINGE = JointInertia(2.0, 10.0, 8.0)

LINK_MASS = 0.05  # kg, of links whose file gives none; counter-balanced, so only a trace in the inertia
LINK_INERTIA = 1.0e-5  # kg·m², about every axis of such a link

PSM_INITIAL = (0.05, -0.08, 0.10, 0.2, 0.2, 0.2, 0.2)

ARMS = {
    ("PSM", "Classic"): ArmInertia(
        joints=(JointInertia(0.073, 0.11, 0.05), JointInertia(0.04, 0.21, 0.06), JointInertia(0.57, 1.5, 0.39)),
        initial=PSM_INITIAL,
        shaft=(0.12, 0.12, 0.002),
    ),
    ("PSM", "Si"): ArmInertia(
        joints=(JointInertia(0.20, 0.5, 0.2), JointInertia(0.20, 0.5, 0.2), JointInertia(0.80, 3.0, 1.0)),
        initial=PSM_INITIAL,
        shaft=(0.12, 0.12, 0.002),
    ),
    ("ECM", "Classic"): ArmInertia(
        joints=(
            JointInertia(0.60, 1.5, 1.0),
            JointInertia(0.60, 1.5, 1.0),
            JointInertia(4.0, 20.0, 5.0),
            JointInertia(0.004, 0.02, 0.02),
        ),
        initial=(0.05, -0.05, 0.08, 0.1),
        shaft=(0.15, 0.15, 0.004),
    ),
    ("ECM", "Si"): ArmInertia(
        joints=(
            JointInertia(0.60, 1.5, 1.0),
            JointInertia(0.60, 1.5, 1.0),
            JointInertia(3.0, 20.0, 5.0),
            JointInertia(0.012, 0.05, 0.05),
        ),
        initial=(0.05, -0.05, 0.08, 0.1),
        shaft=(0.15, 0.15, 0.004),
    ),
    ("MTM", "Classic"): ArmInertia(
        joints=(
            JointInertia(0.080, 0.10, 0.04),
            JointInertia(0.060, 0.10, 0.04),
            JointInertia(0.040, 0.06, 0.03),
            JointInertia(0.0050, 0.01, 0.01),
            JointInertia(0.0008, 0.002, 0.002),
            JointInertia(0.0006, 0.001, 0.002),
            JointInertia(0.0002, 0.0004, 0.001),
        ),
        initial=(0.05, 0.10, 0.05, 0.1, 0.1, 0.05, 0.2),
        homed_at_stop=6,
    ),
    ("SUJ", "Classic"): ArmInertia(
        joints=(SET_UP_SLIDE, *(SET_UP_HINGE,) * 5),
        initial=(0.05, -0.6, 1.2, -0.4, 0.2, 0.2),
    ),
    ("SUJ", "Si"): ArmInertia(
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

    MTML and MTMR count as MTM; set-up arms have more or fewer joints.
    """
    kind = next((k for k in ("MTM", "SUJ") if arm_type.startswith(k)), arm_type)
    row = ARMS.get((kind, generation)) or ARMS.get((kind, "Classic"))
    if row is not None and kind == "SUJ":
        return ArmInertia(row.joints[:joints], row.initial[:joints])
    return row
