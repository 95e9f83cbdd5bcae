"""A chain as URDF, the robot description for ROS tools: joints at ours, thin rods between them."""

from __future__ import annotations

import math
from collections.abc import Iterable
from pathlib import Path
from typing import Final
from xml.etree import ElementTree

import numpy as np

from trocar.procs.document.arms import MeshLink
from trocar.procs.kinematics.forward import Kinematics
from trocar.procs.kinematics.poses import Array

ROD_M: Final = 0.004
"""Radius of the rods."""
SHORT_M: Final = 1e-6
VELOCITY: Final = 1.0
"""URDF requires a velocity limit; the arm's own limit is not in it."""


def urdf(name: str, kinematics: Kinematics, meshes: Iterable[MeshLink] = ()) -> str:
    """The robot `name` from NAME_base to NAME_tip, a link behind each joint with the joint's name: NAME_yaw …

    Joints have the chain's own names, positions and limits (rad, m). `meshes` are further links on them, parents first.
    """
    robot = ElementTree.Element("robot", name=name)
    parent = _link(robot, f"{name}_base", kinematics.links.placements[0][:, 3])
    for number, joint in enumerate(kinematics.names):
        last = number + 1 == kinematics.n
        after = kinematics.end if last else kinematics.links.placements[number + 1]
        child = _link(robot, f"{name}_{joint}", after[:, 3])
        kind = "prismatic" if kinematics.is_prismatic[number] else "revolute"
        made = _joint(robot, joint, kind, parent, child, kinematics.links.placements[number])
        ElementTree.SubElement(made, "axis", xyz="0 0 1")
        ElementTree.SubElement(made, "limit", lower=repr(float(kinematics.lower[number])),
                               upper=repr(float(kinematics.upper[number])),
                               effort=repr(float(kinematics.effort_max[number])), velocity=repr(VELOCITY))
        parent = child
    _joint(robot, f"{name}_to_tip", "fixed", parent, _link(robot, f"{name}_tip", np.zeros(3)), kinematics.end)
    for row in meshes:
        _add_meshes(robot, name, row)
    return ElementTree.tostring(robot, encoding="unicode")


def _add_meshes(robot: ElementTree.Element, name: str, row: MeshLink) -> None:
    """A link with its meshes, fixed or behind a joint that follows one of the chain."""
    link, pose = ElementTree.SubElement(robot, "link", name=f"{name}_{row.name}"), np.array(row.pose)
    for mesh in row.meshes:
        visual, placed = ElementTree.SubElement(link, "visual"), np.array(mesh.pose)
        _origin(visual, placed[:3, 3], _angles(placed[:3, :3]))
        ElementTree.SubElement(ElementTree.SubElement(visual, "geometry"), "mesh", filename=Path(mesh.file).as_uri(),
                               scale=" ".join(map(repr, mesh.scale)))
    made = _joint(robot, f"{name}_to_{row.name}", "continuous" if row.follows else "fixed",
                  f"{name}_{row.parent or 'base'}", link.get("name", ""), pose[:3])
    if row.follows:
        ElementTree.SubElement(made, "axis", xyz="0 0 1")
        ElementTree.SubElement(made, "mimic", joint=row.follows, multiplier=repr(row.times))


def _link(robot: ElementTree.Element, name: str, to: Array) -> str:
    """A link, with a rod from its joint to the next one at `to` (3,)."""
    link = ElementTree.SubElement(robot, "link", name=name)
    length = float(np.linalg.norm(to))
    if length > SHORT_M:
        visual = ElementTree.SubElement(link, "visual")
        x, y, z = (to / length).tolist()
        rpy = 0.0, math.acos(max(-1.0, min(1.0, z))), math.atan2(y, x)  # turns z into the direction
        _origin(visual, to / 2.0, rpy)
        geometry = ElementTree.SubElement(visual, "geometry")
        ElementTree.SubElement(geometry, "cylinder", radius=repr(ROD_M), length=repr(length))
    return name


def _joint(robot: ElementTree.Element, name: str, kind: str, parent: str, child: str,
           placement: Array) -> ElementTree.Element:
    """A joint at `placement` (3, 4), relative to the previous link."""
    joint = ElementTree.SubElement(robot, "joint", name=name, type=kind)
    _origin(joint, placement[:, 3], _angles(placement[:, :3]))
    ElementTree.SubElement(joint, "parent", link=parent)
    ElementTree.SubElement(joint, "child", link=child)
    return joint


def _origin(of: ElementTree.Element, xyz: Array, rpy: tuple[float, float, float]) -> None:
    ElementTree.SubElement(of, "origin", xyz=" ".join(map(repr, map(float, xyz))), rpy=" ".join(map(repr, rpy)))


def _angles(rotation: Array) -> tuple[float, float, float]:
    """Roll, pitch, yaw about fixed axes: R = Rz(yaw) · Ry(pitch) · Rx(roll)."""
    r = rotation.tolist()
    level = math.hypot(r[0][0], r[1][0])
    pitch = math.atan2(-r[2][0], level)
    if level < SHORT_M:  # vertical: only one turn is left to choose
        return math.atan2(-r[1][2], r[1][1]), pitch, 0.0
    return math.atan2(r[2][1], r[2][2]), pitch, math.atan2(r[1][0], r[0][0])
