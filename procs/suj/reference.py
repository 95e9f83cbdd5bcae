"""The tip of the arm on the reference setup arm, from that arm's own record."""

from __future__ import annotations

from trocar.procs.kinematics.poses import matrix_from_pose, normalised
from trocar.procs.node.inputs import Input
from trocar.procs.suj.setups import Array


class CarriedTip:
    """The tip of one arm, in its base."""

    def __init__(self, name: str, record: Input) -> None:
        """`name` of the arm is that of its tip's frame, too."""
        self.name, self._record = name, record
        self._valid, self._pose = record.field("cartesian_valid"), record.field("local_measured_cp")
        self._kept: Array | None = None

    def pose(self, now_ns: int) -> Array | None:
        """The newest (4, 4); None when it is not valid or too old."""
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
