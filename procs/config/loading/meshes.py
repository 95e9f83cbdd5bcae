"""Meshes of arms from a checkout of dvrk_model on the search path: its links, in the frames of our joints.

Its xacro files are read as they are: literal numbers and PI, no other macros. A link is left out when the axis of its
joint has another direction than that of the chain, so that no mesh is shown in a wrong place.
"""

from __future__ import annotations

import ast
import math
import operator
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from trocar.procs.config.read.search import SearchPath
from trocar.procs.document.arms import Mesh, MeshLink
from trocar.procs.document.system import Chain
from trocar.procs.kinematics.forward import Kinematics
from trocar.procs.machine.paths import exists, is_folder

Array = NDArray[np.float64]
FILES: Final = {"PSM": "urdf/{generation}/PSM_base.urdf.xacro", "ECM": "urdf/{generation}/ECM_base.urdf.xacro",
                "MTM": "urdf/{generation}/MTM.urdf.xacro"}
PACKAGE: Final = "package://dvrk_model/"
CONSTANTS: Final = {"PI": math.pi, "PI_2": math.pi / 2, "PI_4": math.pi / 4}
OPERATIONS: Final[dict[type, Callable[[float, float], float]]] = {
    ast.Add: operator.add, ast.Sub: operator.sub, ast.Mult: operator.mul, ast.Div: operator.truediv}
MAX_BYTES: Final = 1_000_000
"""Of a xacro file."""
POINTER: Final = b"version https://git-lfs"
NOWHERE: Final = "?"
CENTRE: Final = "RCM_link"
"""Of arms that turn about a point in the patient's wall, where our first two axes meet."""
NEAR: Final = 2e-3
"""Their angles have four digits."""


@dataclass(frozen=True, slots=True)
class ModelJoint:
    """The joint that leads to a link of the model; `turn` (4, 4) turns z to its axis."""

    name: str
    parent: str
    pose: Array
    turn: Array
    follows: str
    times: float


def checkout(search: SearchPath) -> Path | None:
    """The folder of dvrk_model on the search path, itself or in one of its folders."""
    for folder in search.folders:
        for place in (folder, folder / "dvrk_model"):
            if is_folder(place / "urdf") and is_folder(place / "meshes") and exists(place / "package.xml"):
                return place.resolve()
    return None


def mesh_links(folder: Path, family: str, generation: str, chain: Chain) -> tuple[tuple[MeshLink, ...], str]:
    """The links of an arm with their meshes, parents first, and what is missing in words; none if nothing fits."""
    path = folder / FILES.get(family, "-").format(generation=generation)
    try:
        if not path.is_file() or path.stat().st_size > MAX_BYTES:
            return (), ""
        root = ElementTree.fromstring(path.read_bytes())
        joints = _joints(root)
        visuals = {_word(link.get("name", "")): link for link in root.iter("link")}
        return _Model(folder, joints, visuals, Kinematics(chain)).links()
    except (OSError, ValueError, KeyError, ArithmeticError, SyntaxError, RecursionError) as error:
        return (), f"{path}: no meshes: {error}"


class _Model:
    """The tree of links of one arm, from its root on."""

    def __init__(self, folder: Path, joints: dict[str, ModelJoint], visuals: dict[str, ElementTree.Element],
                 kinematics: Kinematics) -> None:
        self._folder, self._joints, self._visuals, self._missing = folder, joints, visuals, set[str]()
        self._ours = {"": np.eye(4)}
        at = np.eye(4)
        for name, placement in zip(kinematics.names, kinematics.links.placements, strict=True):
            at = at @ np.vstack((placement, (0.0, 0.0, 0.0, 1.0)))
            self._ours[name] = at
        self._frames = dict(self._ours)
        self._slides = {name for name, slides in zip(kinematics.names, kinematics.is_prismatic, strict=True) if slides}
        self._rows: dict[str, MeshLink] = {}

    def links(self) -> tuple[tuple[MeshLink, ...], str]:
        """All links that lead to a mesh, and what is missing."""
        for root in [name for name in dict.fromkeys(joint.parent for joint in self._joints.values())
                     if name not in self._joints]:
            self._follow(root, self._root(), "")
        shown = [row for row in self._rows.values() if row.meshes]
        needed = {row.name for row in shown}
        for row in reversed(self._rows.values()):
            if row.name in needed:
                needed.add(row.parent)
        missing = f"{len(self._missing)} meshes of {self._folder} are not there (git lfs pull)" if self._missing else ""
        return tuple(row for row in self._rows.values() if row.name in needed), missing if needed else ""

    def _root(self) -> Array:
        """The model in our base, by its remote centre and the axes of its first joints: some roots are turned."""
        theirs = {name: self._at_zero(child) @ joint.turn for child, joint in self._joints.items()
                  if (name := self._known(joint.name))}
        first = [name for name in self._ours if name in theirs][:2]
        if len(first) < 2:
            raise ValueError("the first joints of the arm are missing")
        slide = next((name for name in self._ours if name in self._slides and name in theirs), "")
        hands = [np.linalg.det([frames[name][:3, 2] for name in (*first, slide)]) for frames in (self._ours, theirs)
                 ] if slide else [0.0, 0.0]
        if hands[0] * hands[1] < 0.0:  # one of them turns the other way; by the limits of its pitch, the yaw of the ECM
            theirs[first[0]] = theirs[first[0]] @ np.diag((1.0, -1.0, -1.0, 1.0))
        both = [_frame_of(frames[first[0]], frames[first[1]]) for frames in (self._ours, theirs)]
        if CENTRE in self._joints:  # the pivots of a parallelogram are elsewhere
            both[1][:3, 3] = self._at_zero(CENTRE)[:3, 3]
        made: Array = both[0] @ np.linalg.inv(both[1])
        return made

    def _at_zero(self, link: str) -> Array:
        """A link in its root when all joints are 0."""
        made = np.eye(4)
        for _ in self._joints:
            if link not in self._joints:
                break
            made, link = self._joints[link].pose @ made, self._joints[link].parent
        return made

    def _follow(self, link: str, pose: Array, anchor: str) -> None:
        """A link at `pose` when all joints are 0; `anchor`: the joint of the chain, or the row, that carries it."""
        for child, joint in self._joints.items():
            if joint.parent != link:
                continue
            there, name = pose @ joint.pose, self._known(joint.name)
            made = self._frames[child] = there @ joint.turn
            parent, follows, times = anchor, self._known(joint.follows), joint.times
            if name:
                parent, follows, times = self._carried(name, made, anchor)
                if parent == NOWHERE:
                    continue
            offset = np.linalg.inv(self._frames[parent]) @ made
            self._rows[child] = MeshLink(child, parent, _nested(offset), follows, times,
                                         self._meshes(child, joint.turn.T))
            self._follow(child, there, child)

    def _carried(self, name: str, frame: Array, anchor: str) -> tuple[str, str, float]:
        """Parent of a link behind a joint of the chain, and whom it follows: itself, as a pivot beside its axis."""
        offset = np.linalg.inv(self._ours[name]) @ frame
        is_near = bool(np.hypot(offset[0, 3], offset[1, 3]) < NEAR)
        if offset[2, 2] > 1.0 - NEAR and (is_near or name in self._slides):
            return name, "", 0.0
        if abs(offset[2, 2]) < 1.0 - NEAR or name in self._slides:
            return NOWHERE, "", 0.0
        return anchor, name, float(np.sign(offset[2, 2]))

    def _known(self, name: str) -> str:
        """The joint of the chain; empty: it has none."""
        return next((each for each in (name, name.removeprefix("outer_"), f"outer_{name}") if each in self._ours), "")

    def _meshes(self, link: str, turn: Array) -> tuple[Mesh, ...]:
        found = []
        for visual in self._visuals[link].iter("visual") if link in self._visuals else ():
            mesh = visual.find("geometry/mesh")
            name = mesh.get("filename", "") if mesh is not None else ""
            if mesh is None or not name.startswith(PACKAGE):
                continue
            file = (self._folder / name.removeprefix(PACKAGE)).resolve()
            if not file.is_relative_to(self._folder / "meshes"):
                raise ValueError(f"{name} is outside of its folder")
            if not file.is_file() or _is_pointer(file):
                self._missing.add(name)
                continue
            scale = tuple(_numbers(mesh.get("scale", "1 1 1")))
            found.append(Mesh(str(file), _nested(turn @ _pose(visual.find("origin"))), (scale[0], scale[1], scale[2])))
        return tuple(found)


def _frame_of(first: Array, second: Array) -> Array:
    """A frame along two axes, z of both poses, at the point of the first one that is nearest to the second one."""
    along, other, between = first[:3, 2], second[:3, 2], second[:3, 3] - first[:3, 3]
    across = other - (other @ along) * along
    if (length := float(np.linalg.norm(across))) < NEAR:
        raise ValueError("its first two axes are parallel")
    made, shared = np.eye(4), other @ along
    made[:3, 0], made[:3, 1] = along, across / length
    made[:3, 2] = np.cross(made[:3, 0], made[:3, 1])
    made[:3, 3] = first[:3, 3] + along * (between @ along - shared * (between @ other)) / (1.0 - shared * shared)
    return made


def _joints(root: ElementTree.Element) -> dict[str, ModelJoint]:
    """By the link that each leads to; of links that are there twice, as left and right platforms, the first."""
    found: dict[str, ModelJoint] = {}
    for joint in root.iter("joint"):
        parent, child, mimic, axis = (joint.find(part) for part in ("parent", "child", "mimic", "axis"))
        if parent is None or child is None:
            continue
        along = [0.0, 0.0, 1.0] if axis is None else _numbers(axis.get("xyz", ""))
        follows, times = ("", "0") if mimic is None else (mimic.get("joint", ""), mimic.get("multiplier", "1"))
        found.setdefault(_word(child.get("link", "")), ModelJoint(
            _word(joint.get("name", "")), _word(parent.get("link", "")), _pose(joint.find("origin")), _turn_to(along),
            follows, float(times)))
    return found


def _turn_to(axis: list[float]) -> Array:
    """The rotation (4, 4) that turns z to this axis."""
    length = math.hypot(*axis)
    if length < NEAR:
        raise ValueError("a joint has no axis")
    made, z = np.eye(4), np.array(axis) / length
    x = np.cross((0.0, 1.0, 0.0) if abs(z[1]) < 0.9 else (0.0, 0.0, 1.0), z)
    x /= np.linalg.norm(x)
    made[:3, :3] = np.stack((x, np.cross(z, x), z), axis=1)
    return made


def _word(text: str) -> str:
    return text.replace("${prefix}", "")


def _is_pointer(file: Path) -> bool:
    with file.open("rb") as stream:
        return stream.read(len(POINTER)) == POINTER


def _numbers(text: str) -> list[float]:
    """Three numbers; an argument of the macro, where the arm stands, is 0."""
    if text in ("${xyz}", "${rpy}"):
        return [0.0, 0.0, 0.0]
    words = re.findall(r"-?\$\{[^}]*\}|\S+", text)
    values = [-_value(word[3:-1]) if word.startswith("-$") else _value(word[2:-1]) if word[0] == "$" else float(word)
              for word in words]
    if len(values) != 3 or not all(map(math.isfinite, values)):
        raise ValueError(f"{text!r} is not three numbers")
    return values


def _value(text: str) -> float:
    """The value of an expression with PI."""
    def of(node: ast.expr) -> float:
        if isinstance(node, ast.Constant) and isinstance(node.value, int | float):
            return float(node.value)
        if isinstance(node, ast.Name):
            return CONSTANTS[node.id]
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
            return -of(node.operand)
        if isinstance(node, ast.BinOp) and type(node.op) in OPERATIONS:
            return OPERATIONS[type(node.op)](of(node.left), of(node.right))
        raise ValueError(f"{text!r} is no number")

    return of(ast.parse(text, mode="eval").body)


def _pose(origin: ElementTree.Element | None) -> Array:
    """The (4, 4) of an origin: R = Rz(yaw) · Ry(pitch) · Rx(roll)."""
    made = np.eye(4)
    if origin is None:
        return made
    made[:3, 3] = _numbers(origin.get("xyz", "0 0 0"))
    (sr, sp, sy), (cr, cp, cy) = ([turn(angle) for angle in _numbers(origin.get("rpy", "0 0 0"))]
                                  for turn in (math.sin, math.cos))
    made[:3, :3] = ((cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr),
                    (sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr), (-sp, cp * sr, cp * cr))
    return made


def _nested(pose: Array) -> tuple[tuple[float, ...], ...]:
    return tuple(tuple(float(value) for value in row) for row in pose)
