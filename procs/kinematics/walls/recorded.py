"""Walls as an arm's record has them."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from trocar.procs.document.walls import SHAPES, SIZES, Wall
from trocar.procs.kinematics.poses import PoseError, normalised

NEAR_M: Final = 0.02
TEXTS: Final = ("name", "shape", "keep", "of", "frame")


@dataclass(frozen=True, slots=True)
class RecordedWall:
    """One wall that has a shape of its own. `distance` of the setpoint from it, m; NaN if it is not active."""

    wall: Wall
    by_command: bool
    active: bool
    distance: float

    @property
    def nearness(self) -> float | None:
        """How near the setpoint is: 0 from NEAR_M on, 1 at the wall or beyond; None: the wall is off."""
        if not self.active or math.isnan(self.distance):
            return None
        return min(max(1.0 - self.distance / NEAR_M, 0.0), 1.0)


def recorded_walls(field: Callable[[str], NDArray[Any]]) -> list[RecordedWall]:
    """All walls with a shape and a place; `field` gives the arrays of the record."""
    found = []
    for place in range(min(int(field("count").item()), len(field("name")))):
        texts: dict[str, Any] = {name: bytes(field(name)[place]).rstrip(b"\0").decode(errors="replace")
                                 for name in TEXTS}
        if texts["shape"] not in SHAPES:
            continue
        size = field("size")[place, : SIZES[texts["shape"]]]
        try:
            pose = normalised(field("pose")[place])
        except PoseError:
            continue
        if not np.isfinite(size).all():
            continue
        wall = Wall(**texts, position=tuple(pose[:3].tolist()), orientation=tuple(pose[3:].tolist()),
                    size=tuple(size.tolist()), margin=float(field("margin")[place]))
        found.append(RecordedWall(wall, bool(field("by_command")[place]), bool(field("active")[place]),
                                  float(field("distance")[place])))
    return found
