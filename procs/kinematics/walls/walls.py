"""Keeps a setpoint where its arm may be: the joints next to a goal from which no part of the arm enters a wall.

The distance of each pair of a wall and a segment of the arm (`value`) must not become less than 0; a pair that is
inside already must not go deeper. Among the joints that keep this, those count as nearest to the goal whose tip is
nearest to it (the metric H = Jᵀ·J of the tip, in which a radian weighs like `TURN` metres). They are found by a few
steps of sequential quadratic programming, each of which takes walls for planes:

    least (x - x*)ᵀ · H · (x - x*)   with   value + slope · (x - present) >= least value,   joints within limits,
    x*: the joints that would take the tip to its goal

by Hildreth's method. At the end the whole straight way to the joints found is checked; a part of it is taken where a
wall is in it, so that an error of the approximation costs reach and never safety.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from typing import Final

import numpy as np

from trocar.procs.document.walls import (
    ARMS,
    BOX,
    CAPSULE,
    CONE,
    CYLINDER,
    FARTHEST,
    IN,
    JAW,
    NAMED,
    PARTS,
    SHAFT,
    SHAPES,
    SIDES,
    SIZES,
    WIDEST,
    Wall,
)
from trocar.procs.kinematics.forward import Kinematics
from trocar.procs.kinematics.frames import Frame, body_jacobian, twist_between
from trocar.procs.kinematics.poses import Array, matrix_from_pose, normalised
from trocar.procs.kinematics.walls import shapes
from trocar.procs.kinematics.walls.body import PART_BITS, ArmBody
from trocar.procs.kinematics.walls.shapes import Nearest
from trocar.procs.native.library import chosen, native
from trocar.procs.native.walls_fields import WALLS
from trocar.procs.tables.arm_types import ARM_TYPES

MOST: Final = 16
"""Walls of one arm."""
MAX_OTHERS: Final = 8
"""Other arms that one arm keeps away from, counted once for each wall."""
SLOWING_S: Final = 0.05
"""The distance of a setpoint from a wall shrinks with this time constant at most: it slows down, and does not hit."""


class ArmWalls:
    """Walls of one arm with its instrument, all in the arm's base: MOST of its own, then the segments of other arms.

    `before`, `goal` (n,): the present joints and those to go to; `step` (2, n): least and largest change in one cycle.
    `value` (w, s): see above; inf where a wall does not concern a segment.
    """

    HALVINGS, SWEEPS, STEPS = shapes.HALVINGS, 40, 6
    GRAIN = 5e-4
    """m: a way is checked at least so finely, unless `samples` are not enough."""
    NEAR = 0.1
    """m: walls farther away do not slow down."""
    SAFE = 1e-7
    """m: aim of the approximation, so that the result is inside the allowed space."""
    TINY, SMALL, FLAT = 1e-12, 1e-9, 1e-9
    TURN = 0.02
    OVER = 1.0 + 1e-6
    SPARE = 2.0
    """A way that is so many times shorter than the distance from all walls need not be looked at."""
    ALONG = 1e-3
    """Share of the way of a move that leads deeper along another arm, and still counts as one along it."""
    APEX = shapes.APEX
    ZONE, SPRING, DAMPER, LARGEST = 0.01, 500.0, 20.0, 10.0
    """Before a wall in effort mode: m, N/m, N·s/m, N."""

    def __init__(self, kinematics: Kinematics, body: ArmBody, lower: Array, upper: Array, free: Array | None,
                 segments: int = 0) -> None:
        """`lower`, `upper` (n,): limits of the joints; `free` (n, m): joints from independent coordinates; `segments`
        of other arms.
        """
        n = kinematics.n
        self.kinematics, self.body = kinematics, body
        self.samples = 400 if native().library is not None else 40  # numpy takes a millisecond for each
        self.thickest = float(body.radius.max())
        self.free = np.eye(n) if free is None else np.ascontiguousarray(free)
        self.gather = np.ascontiguousarray(np.linalg.pinv(self.free))
        self.m, self.w, self.p, self.s = self.free.shape[1], MOST + segments, len(body.of), len(body.starts)
        self.lower, self.upper = np.ascontiguousarray(lower), np.ascontiguousarray(upper)
        self.before, self.goal, self.rates, self.efforts = np.zeros((4, n))
        self.step = np.zeros((2, n))
        self.kind, self.keeps_in, self.guards = np.zeros((3, self.w), dtype=np.int64)
        self.frames, self.size, self.margin = np.zeros((self.w, 3, 4)), np.zeros((self.w, 3)), np.zeros(self.w)
        self.pace = np.ones(self.w)
        """The share of the usual slowing: of two arms that approach each other, each uses half of the room."""
        self.pace[MOST:] = 0.5
        self.kind[MOST:] = SHAPES.index(CAPSULE)
        self.group = np.full(self.w, -1, dtype=np.int64)
        """Of the segments of one other arm: a number; -1: a wall by itself."""
        self.value, self.share = np.full((self.w, self.s), np.inf), np.zeros(1)
        self.keep: Callable[[float, int], int]
        self.way: Callable[[], int]
        self.look: Callable[[], int]
        self.push: Callable[[], int]
        self.slow: Callable[[float], int]
        self.meets: Callable[[float], int]
        self.keep, self.way, self.look, self.push, self.slow, self.meets = chosen(WALLS, self, "by_numpy_")

    def put(self, place: int, wall: Wall, frame: Array) -> None:
        """Set the wall at `place`, whose pose in the arm's base is `frame` (4, 4)."""
        self.kind[place], self.keeps_in[place] = SHAPES.index(wall.shape), wall.keep == IN
        self.guards[place], self.margin[place] = PART_BITS[wall.of], wall.margin
        self.size[place] = size_of(wall)
        self.move(place, frame)

    def move(self, place: int, frame: Array) -> None:
        """A wall is elsewhere now."""
        self.frames[place] = frame[:3]

    def drop(self, place: int) -> None:
        """No wall is at `place`."""
        self.guards[place] = 0

    # the reference of the native library

    def by_numpy_look(self) -> int:
        """Fill `value` for the joints `goal`."""
        self.value[...] = _View(self, self.goal, math.inf).values
        return 0

    def by_numpy_push(self) -> int:
        """Fill `efforts` with those of springs and dampers before walls, for joints `goal` that move at `rates`."""
        view = _View(self, self.goal, self.ZONE)
        self.efforts[...] = 0.0
        pairs = [pair for pair in np.flatnonzero(view.values < self.ZONE).tolist()
                 if self._is_nearest(view.values, pair)]
        for pair in pairs:
            slope = view.slope(pair)
            force = self.SPRING * (self.ZONE - view.values.flat[pair]) - self.DAMPER * float(slope @ self.rates)
            self.efforts += max(min(force, self.LARGEST), 0.0) * slope
        return int(bool(pairs))

    def by_numpy_way(self) -> int:
        """Whether the straight way from `before` to `goal` is free, or only leads out: 0; else the first pair in it,
        plus 1, and in `share` how far along it is.
        """
        view = _View(self, self.before)
        return self._blocked(self.goal, self._grouped(np.minimum(view.values, 0.0)), self.samples, view,
                             along=self.ALONG)[0]

    def by_numpy_slow(self, share: float) -> int:
        """How much of the step of a move from `before` to `goal` brings it nearer to other arms by this `share` of the
        distance at most, into `share`; returns the pair that asks for it, plus 1, 0: none.
        """
        value, then = _View(self, self.before).values, _View(self, self.goal).values
        least = self._allowed(value, share, 1)
        why, self.share[0] = 0, 1.0
        for pair in np.flatnonzero((self.group[:, None] >= 0) & (value > 0.0) & (value < self.NEAR)).tolist():
            most, nearer = value.flat[pair] - least.flat[pair], value.flat[pair] - then.flat[pair]
            if most < self.share.item() * nearer:
                why, self.share[0] = pair + 1, most / nearer
        return why

    def by_numpy_keep(self, share: float, is_step: int) -> int:
        """Change `goal` to the nearest joints that are allowed; returns the pair that prevents more, plus 1, 0: none.

        `is_step`: for one cycle, in which each distance may shrink by this `share`, and each joint move by its `step`.
        """
        why, least, view = self._met(share, is_step)
        samples = 0.25 * self.samples
        if not why:
            return 0
        low, high = np.minimum(self.lower, self.before), np.maximum(self.upper, self.before)
        if is_step:
            low, high = np.maximum(low, self.before + self.step[0]), np.minimum(high, self.before + self.step[1])
        x, tip = self.before.copy(), _View(self, self.goal).tip
        for _ in range(self.STEPS):
            rows, bounds, of = self._bounds(view, x, least, low, high)
            u, strongest = _bounded(rows, bounds, *view.towards(tip, self.goal - x), self)
            why = of[strongest] + 1 if of[strongest] >= 0 else why
            moved = self.free @ u
            x += moved
            view = _View(self, x)
            if np.abs(moved).max() < self.SMALL:
                break
        scale = 1.0  # the sweeps do not always end within the bounds of the joints
        for moved, least_step, largest in zip(x - self.before, low - self.before, high - self.before, strict=True):
            most = largest if moved > 0.0 else least_step
            if is_step and abs(moved) > self.OVER * abs(most):
                scale = min(scale, most / moved)
        x = np.clip(self.before + scale * (x - self.before), low, high)
        stopped, free = self._blocked(x, least, samples, share=np.zeros(1))
        self.goal[...] = self.before + free * (x - self.before) if stopped and free < 1.0 else x
        return why

    def by_numpy_meets(self, share: float) -> int:
        """Whether `keep` would change the step of a cycle."""
        return self._met(share, 1)[0]

    def _met(self, share: float, is_step: int) -> tuple[int, Array, _View]:
        """The first pair that comes nearer than it may on the way to `goal`, plus 1, 0: none; how near each may come;
        and the view from the beginning.
        """
        view = _View(self, self.before)
        least = self._allowed(view.values, share, is_step)
        return self._blocked(self.goal, least, 0.25 * self.samples, view)[0], least, view

    def _allowed(self, value: Array, share: float, is_step: int) -> Array:
        """How near each pair may come."""
        slower = value * (1.0 - share * self.pace[:, None])
        slowed = np.where(value < self.NEAR, slower, 0.0) if is_step else 0.0
        return self._grouped(np.where(value <= 0.0, value, slowed))

    def _is_nearest(self, values: Array, pair: int) -> bool:
        """Whether a pair is the nearest of those of its segment with one other arm."""
        wall, segment = divmod(pair, self.s)
        group = self.group[wall]
        return group < 0 or int(np.where(self.group == group, values[:, segment], np.inf).argmin()) == wall

    def _grouped(self, least: Array) -> Array:
        """A segment that is too near to another arm already may be as near to any segment of it as to the nearest, so
        that it may leave along the other arm.
        """
        for group in set(self.group[self.group >= 0].tolist()):
            rows = self.group == group
            nearest = least[rows].min(axis=0)
            least[rows] = np.where(nearest < 0.0, np.minimum(least[rows], nearest), least[rows])
        return least

    def _bounds(self, view: _View, x: Array, least: Array, low: Array, high: Array
                ) -> tuple[list[Array], list[float], list[int]]:
        """Rows (m,) and their bounds for walls that are near and for limits of joints; the pair of each, -1: none."""
        rows, bounds, of = list[Array](), list[float](), list[int]()
        for pair in np.flatnonzero(view.values < self.NEAR).tolist():
            rows.append(view.slope(pair) @ self.free)
            aim = least.flat[pair] + (0.0 if least.flat[pair] < 0.0 else self.SAFE)  # inside, nothing is pushed out
            bounds.append(float(aim - view.values.flat[pair]))
            of.append(pair)
        for joint in range(len(x)):
            rows += [self.free[joint], -self.free[joint]]
            bounds += [float(low[joint] - x[joint]), float(x[joint] - high[joint])]
            of += [-1, -1]
        return rows, bounds, of

    def _blocked(self, to: Array, least: Array, samples: float, first: _View | None = None,
                 share: Array | None = None, along: float = 0.0) -> tuple[int, float]:
        """The first pair that comes nearer than `least` on the straight way from `before`, plus 1, 0: none; and how
        much of the way is free. `first`: the view from its beginning, if that is known.
        """
        change, free = to - self.before, 0.0
        way, at = float(np.abs(change) @ self.body.reach), 0.0
        grain = max(self.GRAIN, way / samples)
        slack = np.where((least < 0.0) & (self.group[:, None] >= 0), along * way, 0.0)
        while True:
            view = first if first is not None and at == 0.0 else None
            view = view or _View(self, self.before + at * change if at < 1.0 else to)
            spare = view.values - least
            found = np.flatnonzero(~(spare >= -(self.TINY + at * slack)))
            if len(found):
                (self.share if share is None else share)[0] = at
                return int(found[0]) + 1, free
            free = at
            room = float(spare.min())
            if at >= 1.0 or not way > 0.0 or self.SPARE * (1.0 - at) * way <= room:
                return 0, 1.0
            at = min(1.0, at + max(room, grain) / way)


class _View:
    """The arm at some joints (n,): the distances of all pairs; beyond `enough` they may be less than they are."""

    def __init__(self, walls: ArmWalls, q: Array, enough: float = ArmWalls.NEAR) -> None:
        self._walls, body = walls, walls.body
        self._frames: Sequence[Frame] = walls.kinematics.links.frames(q.tolist())
        spots = zip(body.of.tolist(), body.place.tolist(), strict=True)
        self._points = [self._point(joint, place) for joint, place in spots]
        self._found: dict[int, Nearest] = {}
        self.values = np.full((walls.w, walls.s), np.inf)
        radius = max(math.dist(point, self._points[0]) for point in self._points) + walls.thickest
        for wall in np.flatnonzero(walls.guards).tolist():
            there = self._points[0]
            all_at_least = self._nearest(wall, there, there).value - radius - walls.margin[wall]
            if all_at_least > enough:
                self.values[wall, body.parts & walls.guards[wall] != 0] = all_at_least
                continue
            for segment in np.flatnonzero(body.parts & walls.guards[wall]).tolist():
                ends = self._points[body.starts[segment]], self._points[body.stops[segment]]
                pair = self._nearest(wall, *ends)
                wide = 0.0 if SHAPES[walls.kind[wall]] == CONE else body.radius[segment]
                self._found[wall * walls.s + segment] = pair
                self.values[wall, segment] = pair.value - (walls.margin[wall] + wide)

    def _nearest(self, wall: int, a: list[float], b: list[float]) -> Nearest:
        walls = self._walls
        return shapes.nearest(int(walls.kind[wall]), bool(walls.keeps_in[wall]), walls.frames[wall].ravel().tolist(),
                              walls.size[wall].tolist(), a, b)

    def _point(self, joint: int, place: list[float]) -> list[float]:
        if joint < 0:
            return place
        f = self._frames[joint]
        return [f[r] * place[0] + f[r + 1] * place[1] + f[r + 2] * place[2] + f[r + 3] for r in (0, 4, 8)]

    def slope(self, pair: int) -> Array:
        """How the distance of a pair grows with each joint (n,)."""
        walls, found, segment = self._walls, self._found[pair], pair % self._walls.s
        slope = np.zeros(len(self._frames))
        for end, part in ((walls.body.starts[segment], 1.0 - found.along), (walls.body.stops[segment], found.along)):
            for joint in range(int(walls.body.of[end]) + 1):
                f = self._frames[joint]
                axis = np.array((f[2], f[6], f[10]))
                away = np.array(self._points[end]) - (f[3], f[7], f[11])
                moved = axis if walls.kinematics.is_prismatic[joint] else np.cross(axis, away)
                slope[joint] += part * float(moved @ found.normal)
        return slope

    @property
    def tip(self) -> Frame:
        """The frame of the tip."""
        return self._walls.kinematics.tip_after(self._frames)

    def towards(self, goal: Frame, way: Array) -> tuple[Array, Array]:
        """H (m, m), see the module, and the step (m,) that takes the tip to a goal that is a `way` (n,) of the joints.
        """
        walls, tip = self._walls, self.tip
        slides = walls.kinematics.is_prismatic.tolist()
        rows = np.array(body_jacobian(self._frames, slides, tip)).T @ walls.free
        rows[3:] *= walls.TURN
        h = rows.T @ rows + walls.FLAT * np.eye(walls.m)
        twist = np.array(twist_between(tip, goal)) * walls.TURN
        twist[:3] = shapes.turned_back(tip, [goal[i] - tip[i] for i in (3, 7, 11)])
        return h, np.asarray(np.linalg.solve(h, rows.T @ twist + walls.FLAT * (walls.gather @ way)))


def _bounded(rows: Sequence[Array], bounds: Sequence[float], h: Array, wanted: Array, walls: ArmWalls
             ) -> tuple[Array, int]:
    """The x (m,) next to `wanted` in the metric `h` with rows · x >= bounds, and the bound that pushes most."""
    moved = [np.linalg.solve(h, row) for row in rows]
    square = [float(row @ step) for row, step in zip(rows, moved, strict=True)]
    x, force = wanted.copy(), np.zeros(len(rows))
    for _ in range(walls.SWEEPS):
        for i, row in enumerate(rows):
            if square[i] > walls.FLAT:
                change = max(-float(force[i]), (bounds[i] - float(row @ x)) / square[i])
                force[i] += change
                x += change * moved[i]
    return x, int((force * np.sqrt(np.maximum(square, 0.0))).argmax())


def size_of(wall: Wall) -> tuple[float, float, float]:
    """The size as distances are computed with: half edges, radius and half length, radius and length, angle."""
    first, second, third = (*wall.size, 0.0, 0.0, 0.0)[:3]
    if wall.shape == BOX:
        return first / 2, second / 2, third / 2
    return first, second / 2 if wall.shape == CYLINDER else second, third


def pose_of(wall: Wall) -> Array:
    """Its pose (4, 4) in its own frame; ValueError for an orientation that is no quaternion."""
    return matrix_from_pose(normalised(np.array((*wall.position, *wall.orientation))))


def objection_to(wall: Wall, arm_type: str) -> str:
    """Why a wall cannot be one of an arm of this type; "": it can."""
    if not re.fullmatch(NAMED, wall.name):
        return f"name {wall.name}: letters, digits, _ and -, at most 24"
    for word, allowed in ((wall.shape, (*SHAPES, ARMS)), (wall.keep, SIDES), (wall.of, PARTS)):
        if word not in allowed:
            return f"{word}: allowed are {', '.join(allowed)}"
    if wall.shape == ARMS and wall != Wall(wall.name, ARMS, of=wall.of, margin=wall.margin, unknown=wall.unknown,
                                           arms=wall.arms):
        return "other arms are where they are: only of, margin, unknown and arms go with this shape"
    row, needed = ARM_TYPES[arm_type], SIZES.get(wall.shape, 0)
    if not all(abs(number) <= FARTHEST for number in (*wall.position, *wall.size)) or not 0.0 <= wall.margin <= WIDEST:
        return f"places and sizes are at most {FARTHEST:g} m, a margin at most {WIDEST:g} m"
    if len(wall.size) != needed:
        return f"a {wall.shape} has {needed} numbers in its size, not {len(wall.size)}"
    if any(not number > 0.0 for number in wall.size):
        return f"the size of a {wall.shape} must be above 0"
    if wall.shape == CONE and not wall.size[0] < math.pi / 2:
        return "half of a cone's angle is below π/2"
    if wall.of in (JAW, SHAFT) and (not row.has_remote_centre or (row.has_endoscope and wall.of == JAW)):
        return f"walls of an {arm_type} are for its tip or instrument, not its {wall.of}"
    try:
        pose_of(wall)
    except ValueError as error:
        return str(error)
    return ""
