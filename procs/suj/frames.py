"""Base frames of the carried arms: their poses in the cart, expressed in the tip frame of the reference arm.

    C = (local of the reference setup arm · tip of the arm it carries)⁻¹       base of the others = C · local

The base of the reference arm itself is given in the cart, frame "Cart"; so are all bases if the reference setup arm
carries no arm.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from trocar.procs.kinematics.poses import Array, inverse, matrix_from_pose, normalised, pose_from_matrix
from trocar.procs.node.inputs import Fields, Input
from trocar.procs.suj.setups import Setups

CART: Final = "Cart"


class CarriedTip:
    """The tip of an arm on a setup arm, in its base, from its own record."""

    def __init__(self, name: str, record: Input) -> None:
        """`name` of the arm is also that of its tip's frame."""
        self.name, self._record = name, record
        self._valid, self._pose = record.field("cartesian_valid"), record.field("local_measured_cp")
        self._kept: Array | None = None

    def pose(self, now_ns: int) -> Array | None:
        """The newest pose (4, 4); None if it is invalid or too old."""
        if self._record.look(now_ns):
            self._kept = self._read()
        return self._kept if self._record.fresh else None

    def _read(self) -> Array | None:
        if not self._valid.item():
            return None
        try:
            return matrix_from_pose(normalised(self._pose))
        except ValueError:
            return None


class Frames:
    """Fills the base frames of the record; does nothing without changes."""

    def __init__(self, setups: Setups, field: Fields) -> None:
        """`field` gives the record's arrays."""
        self._setups = setups
        self._poses: Array = field("measured_cp")
        self._valid: NDArray[np.bool_] = field("base_valid")
        self._names: NDArray[np.bytes_] = field("reference_frame")
        self._seen = -1
        self.still = False
        """Whether the last update found no change."""
        self._known: tuple[int, str, bytes] | None = None

    def update(self, reference: int, frame: str, tip: Array | None) -> None:
        """`reference`: index of the reference setup arm, -1: none; `frame`: that of the tip of the arm it carries.

        `frame` "": it carries none. `tip` (4, 4): in that arm's base, None: unknown.
        """
        known = (reference, frame, tip.tobytes() if tip is not None else b"")
        self.still = known == self._known and self._setups.changes == self._seen
        if self.still:
            return
        self._known, self._seen = known, self._setups.changes
        valid, local = self._setups.valid, self._setups.local
        if reference < 0 or not frame:
            self._show(local, valid, CART, reference)
        elif tip is None or not valid[reference]:
            self._show(None, np.zeros(len(valid), dtype=bool), frame, reference)
        else:
            self._show(inverse(local[reference] @ tip) @ local, valid, frame, reference)

    def _show(self, bases: Array | None, valid: NDArray[np.bool_], frame: str, reference: int) -> None:
        for place in range(len(self._valid)):
            own = place == reference
            pose = self._setups.local[place] if own else bases[place] if bases is not None else None
            self._valid[place] = self._setups.valid[place] if own else valid[place]
            self._names[place] = (CART if own else frame).encode()
            if pose is not None:
                pose_from_matrix(pose, self._poses[place])
