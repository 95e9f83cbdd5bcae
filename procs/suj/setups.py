"""The setup arms of one cart: their joint positions, and the resulting base poses of the arms they carry."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from trocar.procs.document.cart import Cart, CartArm
from trocar.procs.kinematics.forward import Kinematics
from trocar.procs.kinematics.poses import Array, matrix_from_pose, normalised, pose_from_matrix
from trocar.procs.node.inputs import Fields
from trocar.shm.system.events import Events


class Setups:
    """All setup arms, by index; positions and flags are those of the record.

    `local` (n, 4, 4) are the poses of the carried arms' bases in the cart, `valid` (n,) marks those that count.
    `changes` counts changes of either.
    """

    def __init__(self, cart: Cart, field: Fields) -> None:
        """`field` gives the record's arrays."""
        self.arms = cart.arms
        self.names = tuple(arm.name for arm in cart.arms)
        self.position: Array = field("position")
        self.valid: NDArray[np.bool_] = field("setup_valid")
        self.clutched: NDArray[np.bool_] = field("clutched")
        self._poses: Array = field("local_measured_cp")
        self.local: Array = np.tile(np.eye(4), (len(self.arms), 1, 1))
        self._kinematics = [Kinematics(arm.chain) if arm.chain is not None else None for arm in cart.arms]
        self._computed: list[Array | None] = [None for _ in cart.arms]  # joints for which the pose was computed
        self.changes = 0

    def place(self, name: str) -> int:
        """The index of a setup arm; ValueError lists the existing ones."""
        if name not in self.names:
            raise ValueError(f"no setup arm {name or 'without a name'}; there are {', '.join(self.names)}")
        return self.names.index(name)

    def set_joints(self, place: int, joints: Array) -> None:
        """Set the joints, and the pose of the carried arm from them."""
        arm = self.arms[place]
        self.position[place, : arm.joints] = joints
        self._computed[place] = np.array(joints, dtype=np.float64)
        self.put(place, self._pose(arm, place, joints))

    def measure(self, place: int, joints: Array) -> float:
        """Take joints measured at rest. The first measurement after a motion sets the carried arm's pose.

        Returns the largest difference to that one, relative to the limit for a motion; from 1 on the pose is computed
        again.
        """
        computed = self._computed[place]
        if computed is None:
            self.set_joints(place, joints)
            return 0.0
        self.position[place, : self.arms[place].joints] = joints
        moved = float(np.max(np.abs(joints - computed) / moved_limits(len(joints))))
        if moved >= 1.0:
            self.set_joints(place, joints)
        elif not self.valid[place]:
            self.valid[place] = True
            self.changes += 1
        return moved

    def put(self, place: int, pose: Array) -> None:
        """Set the pose (4, 4) of the carried arm's base in the cart."""
        self.local[place] = pose
        pose_from_matrix(pose, self._poses[place])
        self.valid[place] = True
        self.changes += 1

    def lose(self, place: int, *, moved: bool) -> None:
        """The pose is unknown; `moved`: it may have changed when it is known again."""
        if moved:
            self._computed[place] = None
        if self.valid[place]:
            self.valid[place] = False
            self.changes += 1

    def clutch(self, held: NDArray[np.bool_], reports: Events) -> None:
        """Show which arms are clutched, and report changes."""
        for place in np.flatnonzero(held != self.clutched).tolist():
            name = self.names[place]
            reports.status(f"{name}: {'clutched' if held[place] else 'not clutched'}", name)
        self.clutched[...] = held

    def take_over(self, place: int) -> bool:
        """Take over the previous process's record: joints, or the pose of an arm without joints. False if there is
        none.
        """
        arm = self.arms[place]
        if not self.valid[place]:
            return False
        try:
            pose = matrix_from_pose(normalised(self._poses[place]))
        except ValueError:
            return False
        if arm.chain is None:
            self.put(place, pose)
            return True
        joints = self.position[place, : arm.joints].copy()
        if np.isfinite(joints).all():
            self.set_joints(place, joints)
        return bool(np.isfinite(joints).all())

    def _pose(self, arm: CartArm, place: int, joints: Array) -> Array:
        """world · FK(q) · tip; joints without potentiometers count as 0."""
        kinematics = self._kinematics[place]
        if kinematics is None or arm.world is None or arm.tip is None:
            raise ValueError(f"{arm.name} has no joints")
        q = np.zeros(kinematics.n)
        q[: arm.joints] = joints
        pose: Array = np.array(arm.world) @ kinematics.fk(q) @ np.array(arm.tip)
        return pose


def moved_limits(joints: int) -> Array:
    """Limits of a motion: 2 mm and 1°, the first joint being the prismatic one."""
    return np.array([0.002] + [np.radians(1.0)] * (joints - 1))
