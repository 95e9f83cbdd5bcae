"""Forward kinematics and Jacobians of a Denavit-Hartenberg chain: native code, else scalar Python.

The tip transform is converted to a unit quaternion and back, as when dVRK loads it, and belongs to the full chain only.
Jacobian rows: linear x y z, then angular x y z.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from trocar.procs.document.system import Chain, DhLink, Tool
from trocar.procs.kinematics.frames import Frame, body_jacobian, finite, moved, product, spatial_jacobian
from trocar.procs.kinematics.poses import Array, renormalised
from trocar.procs.native.arm_fields import CHAIN
from trocar.procs.native.library import chosen

QUARTER_TURN_AS_WRITTEN = 1.5708  # in alpha only, this spelling means a right angle


class Links:
    """The links of a chain as arrays, upper three rows of rigid transforms.

    `placements` (n, 3, 4): pose of each joint relative to the previous one, the first relative to the base; a joint
    moves along its z where it `slides` (n,), else about it. `ends` (n + 1, 3, 4): the frames after each number of
    links, relative to the last joint before them; without links that is the base, relative to the frame of published
    poses.
    """

    def __init__(self, chain: Chain, links: tuple[DhLink, ...]) -> None:
        self.n, self.ends_count = len(links), len(links) + 1
        self.slides = np.array([link.joint_type == "prismatic" for link in links])
        self.placements, self.ends = np.zeros((self.n, 3, 4)), np.zeros((self.ends_count, 3, 4))
        end = np.array(chain.base) if chain.base is not None else np.eye(4)
        self.ends[0] = end[:3]
        for index, link in enumerate(links):
            before, after = split_row(chain.convention, link)
            self.placements[index] = np.einsum("ij,jk->ik", end, before)[:3]
            self.ends[index + 1], end = after[:3], after
        self._placements: Sequence[Frame] = self.placements.reshape(self.n, 12).tolist()
        self._slides: list[bool] = self.slides.tolist()

    def frames(self, q: Sequence[float]) -> list[Frame]:
        """Frames of the joints after their motion."""
        frames: list[Frame] = []
        for placement, slides, position in zip(self._placements, self._slides, q, strict=True):
            frames.append(moved(product(frames[-1], placement) if frames else placement, slides, position))
        return frames


class Kinematics:
    """A chain with an optional tool: joints in file order, poses in the chain's base frame (with its base offset).

    `update(q)` computes the tip pose and both Jacobians once; `tip`, `body`, `spatial` are preallocated arrays that the
    next call overwrites. q: (n,) float64, rad or m.
    """

    def __init__(self, chain: Chain, tool: Tool | None = None, tip: Array | None = None) -> None:
        """`tip` (4, 4) replaces the tool's tip transform (for endoscopes, whose tips are in no file)."""
        links = chain.links + (tool.links if tool is not None else ())
        if not links:
            raise ValueError(f"{chain.source or 'chain'}: a chain needs at least one joint")
        if tip is None:
            tip = renormalised(np.array(tool.tip)) if tool is not None else np.eye(4)
        self.n = len(links)
        self.names = tuple(link.name for link in links)
        self.lower = np.array([link.lower for link in links])
        self.upper = np.array([link.upper for link in links])
        self.effort_max = np.array([link.effort_max for link in links])
        self.links = Links(chain, links)
        self.is_prismatic = self.links.slides
        last = np.vstack((self.links.ends[-1], (0.0, 0.0, 0.0, 1.0)))
        self.end = np.einsum("ij,jk->ik", last, tip)[:3]
        """The tip (3, 4), relative to the last joint."""
        self._end: Frame = self.end.reshape(12).tolist()
        self._ends: Sequence[Frame] = self.links.ends.reshape(-1, 12).tolist()
        self.q = np.zeros(self.n)
        self.tip, self.frame = np.eye(4), np.eye(4)
        self.body_columns, self.spatial_columns = np.zeros((self.n, 6)), np.zeros((self.n, 6))
        self.body: Array = self.body_columns.T
        self.spatial: Array = self.spatial_columns.T
        self._updated = b""  # joints for which `tip`, `body` and `spatial` were computed
        self._update, self._frame = chosen(CHAIN, self, "by_numpy_")

    def update(self, q: Array) -> None:
        """Tip pose and Jacobians at q into `tip`, `body`, `spatial`."""
        raw = q.tobytes()
        if raw == self._updated:  # a kinematic robot is exactly at its setpoint
            return
        self._updated = raw
        self.q[...] = q
        self._update()

    def forget(self) -> None:
        """`tip`, `body` and `spatial` are overwritten by other code: compute them at the next update."""
        self._updated = b""

    def fk(self, q: Array, out: Array | None = None) -> Array:
        """Pose of the tip (4, 4); written to `out` when given, else to `tip`."""
        self.q[...] = q
        self._frame(-1)
        if out is None:
            self._updated = b""
            out = self.tip
        out[...] = self.frame
        return out

    def fk_to(self, q: Array, link: int) -> Array:
        """Pose (4, 4) of the frame after `link` joints, without the tip (0: the base, n: the last link). New array."""
        if not 0 <= link <= self.n:
            raise IndexError(f"link {link}: this chain has frames 0 to {self.n}")
        self.q[...] = q
        self._frame(link)
        return self.frame.copy()

    def body_jacobian(self, q: Array) -> Array:
        """Jacobian (6, n) of the tip's twist, at the tip in tip axes; the array `body`."""
        self.update(q)
        return self.body

    def spatial_jacobian(self, q: Array) -> Array:
        """Jacobian (6, n) of the spatial twist, at the base's origin in base axes; the array `spatial`."""
        self.update(q)
        return self.spatial

    # the reference of the native library

    def tip_after(self, frames: Sequence[Frame]) -> Frame:
        """The tip, from the frames of all joints."""
        return product(frames[-1], self._end)

    def by_numpy_update(self) -> int:
        """The reference of `update`."""
        frames = self.links.frames(finite(self.q.tolist()))
        tip = self.tip_after(frames)
        slides = self.is_prismatic.tolist()
        self.body_columns[...] = body_jacobian(frames, slides, tip)
        self.spatial_columns[...] = spatial_jacobian(frames, slides)
        self.tip[:3].reshape(12)[...] = tip
        return 0

    def by_numpy_frame(self, link: int) -> int:
        """`frame` after this many links, -1: the tip."""
        frames = self.links.frames(finite(self.q.tolist()))
        if link < 0:
            frame = self.tip_after(frames)
        else:
            frame = product(frames[link - 1], self._ends[link]) if link else self._ends[0]
        self.frame[:3].reshape(12)[...] = frame
        return 0


def split_row(convention: str, link: DhLink) -> tuple[Array, Array]:
    """(before, after): the link's transform is before · joint motion about or along z · after, each (4, 4).

    An alpha of exactly ±1.5708 means ±π/2, while offsets of 1.5708 are used as written: the difference shows in the
    sixth digit of every pose, and files and calibrations were made with it.
    """
    alpha = math.copysign(math.pi / 2, link.alpha) if abs(link.alpha) == QUARTER_TURN_AS_WRITTEN else link.alpha
    prismatic = link.joint_type == "prismatic"
    about_z = _screw_z(link.theta + (0.0 if prismatic else link.offset), link.d + (link.offset if prismatic else 0.0))
    about_x = _screw_x(alpha, link.a)
    if convention == "standard":
        return about_z, about_x
    if convention == "modified":
        return about_x @ about_z, np.eye(4)
    raise ValueError(f"DH convention {convention!r}: must be standard or modified")


def _screw_z(angle: float, distance: float) -> Array:
    """Turn about z by `angle` and shift along z by `distance` (they commute), (4, 4)."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array(((c, -s, 0.0, 0.0), (s, c, 0.0, 0.0), (0.0, 0.0, 1.0, distance), (0.0, 0.0, 0.0, 1.0)))


def _screw_x(angle: float, distance: float) -> Array:
    quarter = abs(angle) == math.pi / 2  # cos would give 6e-17, and the zero is exact in the files' meaning
    c, s = (0.0 if quarter else math.cos(angle)), math.sin(angle)
    return np.array(((1.0, 0.0, 0.0, distance), (0.0, c, -s, 0.0), (0.0, s, c, 0.0), (0.0, 0.0, 0.0, 1.0)))
