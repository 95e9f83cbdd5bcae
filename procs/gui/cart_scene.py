"""Patient carts in space: where the links of their setup arms are, from their joints and their kinematic chains."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from trocar.procs.document.cart import Cart, CartArm
from trocar.procs.kinematics.forward import Kinematics
from trocar.procs.kinematics.poses import pose_from_matrix
from trocar.shm.system import directory

Array = NDArray[np.float64]
LATE_NS: Final = 500_000_000


class SceneCart:
    """One cart."""

    def __init__(self, system: str, cart: Cart) -> None:
        """Attach; SegmentError when its record cannot be read."""
        self._reader = directory.reader(system, cart.name, "state", "suj", often=False)
        self._positions, self._valid = (self._reader.field(name) for name in ("position", "setup_valid"))
        self._arms = [(place, arm, Kinematics(arm.chain)) for place, arm in enumerate(cart.arms)
                      if arm.chain is not None and arm.world is not None and arm.tip is not None]
        self._sequence, self._seen_ns = 0, 0
        self._shown: dict[str, tuple[bytes, list[float]]] = {}

    def read(self, now_ns: int) -> dict[str, Any]:
        """Of each setup arm: `frames` in the cart, x y z and quaternion x y z w of its base, of each joint and of the
        base of the arm that it carries; whether its joints are known."""
        if not self._reader.newest():
            return {}
        if self._reader.sequence != self._sequence:
            self._sequence, self._seen_ns = self._reader.sequence, now_ns
        late = now_ns - self._seen_ns > LATE_NS
        return {arm.name: {"frames": self._frames(place, arm, kinematics), "late": late,
                           "valid": bool(self._valid[place])} for place, arm, kinematics in self._arms}

    def _frames(self, place: int, arm: CartArm, kinematics: Kinematics) -> list[float]:
        position = np.nan_to_num(self._positions[place, :arm.joints])
        key, before = position.tobytes(), self._shown.get(arm.name)
        if before is None or before[0] != key:  # setup arms stand nearly all the time
            before = self._shown[arm.name] = key, setup_frames(arm, kinematics, position)
        return before[1]

    def close(self) -> None:
        """Unmap."""
        self._reader.close()


def setup_frames(arm: CartArm, kinematics: Kinematics, position: Array) -> list[float]:
    """Poses of base, joints and carried base, 7 numbers each; joints without potentiometers stand at 0."""
    q = np.zeros(kinematics.n)
    q[:len(position)] = position
    world, matrix = np.array(arm.world), np.eye(4)
    poses = [pose_from_matrix(world)]
    for frame in kinematics.links.frames(q.tolist()):
        matrix[:3] = np.reshape(frame, (3, 4))
        poses.append(pose_from_matrix(world @ matrix))
    poses.append(pose_from_matrix(world @ kinematics.fk(q) @ np.array(arm.tip)))
    return [round(float(value), 5) for value in np.concatenate(poses)]
