"""The walls of an arm as transparent shapes: orange and denser where its setpoint is near, grey where they are off."""

from __future__ import annotations

import math
from typing import Any, Final

from foxglove.messages import (
    Color,
    CubePrimitive,
    CylinderPrimitive,
    Pose,
    SceneEntity,
    SceneEntityDeletion,
    SceneEntityDeletionType,
    SpherePrimitive,
    Vector3,
)

from trocar.procs.document.walls import BASE, BOX, CONE, CYLINDER, PLANE, REFERENCE, SPHERE
from trocar.procs.foxglove.channels import pose_of as message_of
from trocar.procs.kinematics.poses import pose_from_matrix
from trocar.procs.kinematics.walls.recorded import RecordedWall, recorded_walls
from trocar.procs.kinematics.walls.walls import pose_of
from trocar.shm.ring.ring import RingReader

FAR_M: Final = 0.16
"""How far the endless shapes, plane and cone, are drawn."""
THIN_M: Final = 0.0005


class DrawnWalls:
    """The walls of one arm. An entity NAME/wall/WALL each."""

    def __init__(self, arm: str, ring: RingReader) -> None:
        """`ring`: its record `walls`."""
        self._arm, self._ring, self._sequence = arm, ring, 0
        self._ids: set[str] = set()

    def look(self, reference: str, *, again: bool) -> tuple[list[SceneEntity], list[SceneEntityDeletion]]:
        """The walls to draw, and those to delete, since the last look; `again`: draw all. `reference`: the frame of the
        arm's poses; "": it is not known.
        """
        if not self._ring.newest() or (self._ring.sequence == self._sequence and not again):
            return [], []
        self._sequence = self._ring.sequence
        frames = {BASE: f"{self._arm}_base", REFERENCE: reference}
        rows = [(f"{self._arm}/wall/{row.wall.name}", frames.get(row.wall.frame, row.wall.frame), row)
                for row in recorded_walls(self._ring.field)]
        made = {name: entity(name, frame, row) for name, frame, row in rows if frame}
        gone, self._ids = self._ids - made.keys(), set(made)
        return list(made.values()), [SceneEntityDeletion(type=SceneEntityDeletionType.MatchingId, id=name)
                                     for name in sorted(gone)]


def entity(name: str, frame: str, row: RecordedWall) -> SceneEntity:
    """A wall in a frame."""
    wall, near, shapes = row.wall, row.nearness, dict[str, Any]()
    colour = Color(r=0.54, g=0.58, b=0.61, a=0.1)
    if near is not None:
        red, green, blue = (1.0, 0.62, 0.11) if near > 0.0 else (0.31, 0.61, 0.94)
        colour = Color(r=red, g=green, b=blue, a=0.2 + 0.3 * near)

    def at(z: float) -> Pose:
        """Its pose, moved by z m along its z."""
        pose = pose_of(wall)
        pose[:3, 3] += z * pose[:3, 2]
        return message_of(pose_from_matrix(pose).tolist())

    def ball(radius: float, z: float) -> SpherePrimitive:
        return SpherePrimitive(pose=at(z), size=Vector3(x=2 * radius, y=2 * radius, z=2 * radius), color=colour)

    def round_one(radius: float, length: float, z: float, bottom: float = 1.0) -> CylinderPrimitive:
        return CylinderPrimitive(pose=at(z), size=Vector3(x=2 * radius, y=2 * radius, z=length), bottom_scale=bottom,
                                 top_scale=1.0, color=colour)

    if wall.shape in (PLANE, BOX):
        x, y, z = wall.size if wall.shape == BOX else (2 * FAR_M, 2 * FAR_M, THIN_M)
        shapes["cubes"] = [CubePrimitive(pose=at(0.0), size=Vector3(x=x, y=y, z=z), color=colour)]
    elif wall.shape == SPHERE:
        shapes["spheres"] = [ball(wall.size[0], 0.0)]
    elif wall.shape == CONE:
        radius, height = FAR_M * math.sin(wall.size[0]), FAR_M * math.cos(wall.size[0])
        shapes["cylinders"] = [round_one(radius, height, height / 2, bottom=0.0)]
    elif wall.shape == CYLINDER:
        radius, length = wall.size
        shapes["cylinders"] = [round_one(radius, length, 0.0)]
    else:
        radius, length = wall.size
        shapes |= {"cylinders": [round_one(radius, length, length / 2)],
                   "spheres": [ball(radius, z) for z in (0.0, length)]}
    return SceneEntity(frame_id=frame, id=name, frame_locked=True, **shapes)
