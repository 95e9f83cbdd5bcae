"""The robot in 3D: a frame for each joint of each arm, in which its link is drawn as a rod to the next one.

Frames of an arm: NAME_base, NAME_joint for each joint, NAME at the tip; with meshes, NAME_LINK for each link of the
model. The base is seen from the frame that the arm's record names, which may be the tip of another one (ECM) or the
cart.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Final

import numpy as np
from foxglove.channels import FrameTransformsChannel, SceneUpdateChannel
from foxglove.messages import (
    Color,
    CylinderPrimitive,
    FrameTransform,
    FrameTransforms,
    ModelPrimitive,
    Pose,
    Quaternion,
    SceneEntity,
    SceneEntityDeletion,
    SceneEntityDeletionType,
    SceneUpdate,
    SpherePrimitive,
    Timestamp,
    Vector3,
)
from numpy.typing import NDArray

from trocar.procs.crtk.plain import plain
from trocar.procs.crtk.views import Stamps
from trocar.procs.document.arms import ArmConfig, Mesh
from trocar.procs.foxglove.channels import pose_of, rotation_of, timestamp
from trocar.procs.foxglove.walls import DrawnWalls
from trocar.procs.kinematics.forward import Kinematics
from trocar.procs.kinematics.inverse.arms import carrying
from trocar.procs.kinematics.poses import pose_from_matrix, product, turned
from trocar.procs.machine.mesh_file import contents
from trocar.shm.ring.ring import RingReader

FRAMES: Final = "/tf"
SCENE: Final = "/scene"
ROD_M: Final = 0.012
"""Thickness of the links of an arm,"""
THIN_M: Final = 0.005
"""and of those of its instrument."""
JOINT_M: Final = 0.016
SHORT_M: Final = 1e-6
COLOURS: Final = ((0.16, 0.47, 0.84), (0.85, 0.45, 0.12), (0.22, 0.62, 0.35), (0.62, 0.32, 0.71), (0.75, 0.22, 0.25),
                  (0.13, 0.60, 0.65), (0.55, 0.50, 0.25))


class DrawnArm:
    """One arm: its frames from its joints, its rods from its chain and instrument."""

    def __init__(self, arm: ArmConfig, ring: RingReader, colour: tuple[float, float, float]) -> None:
        """`ring`: its state."""
        self.arm, self._colour = arm, Color(r=colour[0], g=colour[1], b=colour[2], a=1.0)
        self._ring = ring
        self._tool, self._position, self._count = ring.field("tool"), ring.field("position"), ring.field("count")
        self._valid, self._known = ring.field("valid"), ring.field("reference_valid")
        self._reference, self._base = ring.field("reference_frame"), ring.field("base_frame")
        self._carried = "?"
        self._mesh_poses = [pose_from_matrix(np.array(row.pose)).tolist() for row in arm.meshes]
        self.chain: Kinematics
        self.look()

    def look(self) -> bool:
        """Whether the carried instrument has changed, so that the arm must be drawn again."""
        carried = str(plain(self._tool.item())) if self._ring.newest() else ""
        if carried == self._carried:
            return False
        self._carried, self.chain = carried, carrying(self.arm, carried)
        placements = [np.vstack((each, (0.0, 0.0, 0.0, 1.0))) for each in (*self.chain.links.placements,
                                                                            self.chain.end)]
        self._placements = [pose_from_matrix(each).tolist() for each in placements]
        self._slides = self.chain.is_prismatic.tolist()
        self.names = [f"{self.arm.name}_{name}" for name in self.chain.names]
        return True

    @property
    def reference(self) -> str:
        """The frame of its poses; "": it is not known."""
        return str(plain(self._reference.item())) if bool(self._known) else ""

    def frames(self, stamps: Stamps) -> list[FrameTransform]:
        """The frames known now; an unmeasured instrument joint is shown at 0."""
        if not self._ring.newest() or not bool(self._valid):
            return []
        name, ns = self.arm.name, stamps.ns(self._ring.stamp_ns)
        positions: list[float] = self._position[: int(self._count[()])].tolist()
        positions += [0.0] * (self.chain.n - len(positions))
        found, parent, when = [], f"{name}_base", timestamp(ns)
        reference = self.reference
        if reference and reference != parent:
            x, y, z, *turn = self._base.tolist()
            found.append(FrameTransform(timestamp=when, parent_frame_id=reference, child_frame_id=parent,
                                        translation=Vector3(x=x, y=y, z=z), rotation=rotation_of(turn)))
        for child, pose, slides, q in zip((*self.names, name), self._placements, (*self._slides, False),
                                          (*positions[: self.chain.n], 0.0), strict=True):
            place, turn = pose[:3], pose[3:]
            if slides:
                along = turned(turn, (0.0, 0.0, q))
                place = [a + b for a, b in zip(place, along, strict=True)]
            elif math.isfinite(q):
                turn = product(turn, (0.0, 0.0, math.sin(q / 2.0), math.cos(q / 2.0)))
            x, y, z = place
            found.append(FrameTransform(timestamp=when, parent_frame_id=parent, child_frame_id=child,
                                        translation=Vector3(x=x, y=y, z=z), rotation=rotation_of(list(turn))))
            parent = child
        known = dict(zip(self.chain.names, positions, strict=False))
        return found + [self._mesh_frame(when, place, known) for place in range(len(self._mesh_poses))]

    def _mesh_frame(self, when: Timestamp, place: int, positions: Mapping[str, float]) -> FrameTransform:
        """The frame of a link with meshes; one that follows a joint turns about its z."""
        row, (x, y, z, *turn) = self.arm.meshes[place], self._mesh_poses[place]
        half = row.turn(positions) / 2.0
        turn = list(product(turn, (0.0, 0.0, math.sin(half), math.cos(half))))
        name = self.arm.name
        return FrameTransform(timestamp=when, parent_frame_id=f"{name}_{row.parent or 'base'}",
                              child_frame_id=f"{name}_{row.name}", translation=Vector3(x=x, y=y, z=z),
                              rotation=rotation_of(turn))

    def entities(self) -> list[SceneEntity]:
        """Its links."""
        chain, own = self.chain, len(self.arm.chain.links)
        ends = [*chain.links.placements[1:, :, 3], chain.end[:, 3]]
        starts = [(f"{self.arm.name}_base", chain.links.placements[0][:, 3]), *zip(self.names, ends, strict=True)]
        models = [(f"{self.arm.name}_{row.name}", list(filter(None, map(_model, row.meshes))))
                  for row in self.arm.meshes]
        meshes = [SceneEntity(frame_id=frame, id=frame, frame_locked=True, models=made)
                  for frame, made in models if made]
        rods = [SceneEntity(frame_id=frame, id=frame, frame_locked=True,
                            cylinders=self._rods(to, THIN_M if place > own else ROD_M),
                            spheres=[SpherePrimitive(pose=AT_ORIGIN, size=Vector3(x=JOINT_M, y=JOINT_M, z=JOINT_M),
                                                     color=self._colour)] if 0 < place <= own else [])
                for place, (frame, to) in enumerate(starts)]
        return rods + meshes

    def _rods(self, to: NDArray[np.float64], thickness: float) -> list[CylinderPrimitive]:
        """A rod from the frame's origin to a point (3,), unless that is there."""
        length = float(np.linalg.norm(to))
        if length < SHORT_M:
            return []
        x, y, z = (to / length).tolist()
        # from z to the direction by the shorter way; straight down any does
        turn = np.array((-y, x, 0.0, 1.0 + z) if z > -1.0 + SHORT_M else (1.0, 0.0, 0.0, 0.0))
        x, y, z = (to / 2.0).tolist()
        pose = Pose(position=Vector3(x=x, y=y, z=z), orientation=rotation_of((turn / np.linalg.norm(turn)).tolist()))
        return [CylinderPrimitive(pose=pose, size=Vector3(x=thickness, y=thickness, z=length), bottom_scale=1.0,
                                  top_scale=1.0, color=self._colour)]


def _model(mesh: Mesh) -> ModelPrimitive | None:
    """A mesh, with the contents of its file; None if it cannot be read, or has another format."""
    media, data = contents(Path(mesh.file))
    x, y, z = mesh.scale
    return ModelPrimitive(pose=pose_of(pose_from_matrix(np.array(mesh.pose)).tolist()), scale=Vector3(x=x, y=y, z=z),
                          media_type=media, data=data) if data else None


AT_ORIGIN: Final = Pose(position=Vector3(), orientation=Quaternion(w=1.0))


class RobotScene:
    """All arms."""

    def __init__(self, arms: Iterable[ArmConfig], reads: Callable[[str, str], RingReader]) -> None:
        """`reads(instance, topic)` returns the reading end of a ring."""
        self._frames, self._scene = FrameTransformsChannel(FRAMES), SceneUpdateChannel(SCENE)
        self._arms = [DrawnArm(arm, reads(arm.name, "state"), COLOURS[place % len(COLOURS)])
                      for place, arm in enumerate(arms)]
        self._walls = [DrawnWalls(arm.arm.name, reads(arm.arm.name, "walls")) for arm in self._arms]
        self._is_drawn = False

    def listens(self, name: str) -> None:
        """A channel has a new subscriber."""
        if name == SCENE:
            self._is_drawn = False

    def look(self, now_ns: int) -> None:
        """Draw the changes; `now_ns` is the time of the drawing, as clients name it."""
        if not self._scene.has_sinks():
            self._is_drawn = False
            return
        changed = [arm.look() for arm in self._arms]
        is_new = any(changed) or not self._is_drawn
        if is_new:
            self._is_drawn = True
            gone = [SceneEntityDeletion(type=SceneEntityDeletionType.All)]
            self._scene.log(SceneUpdate(deletions=gone,
                                        entities=[entity for arm in self._arms for entity in arm.entities()]),
                            log_time=now_ns)
        walls = [each.look(arm.reference, again=is_new) for each, arm in zip(self._walls, self._arms, strict=True)]
        made, gone = ([row for rows in part for row in rows] for part in zip(*walls, strict=True))
        if made or gone:
            self._scene.log(SceneUpdate(deletions=gone, entities=made), log_time=now_ns)

    def step(self, stamps: Stamps, now_ns: int) -> None:
        """Where all are now."""
        if self._frames.has_sinks():
            frames = [frame for arm in self._arms for frame in arm.frames(stamps)]
            if frames:
                self._frames.log(FrameTransforms(transforms=frames), log_time=now_ns)
