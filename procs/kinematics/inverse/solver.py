"""Inverse kinematics: joints for a pose, in bounded time, within limits, or a reason why not. Never a silent clip.

Newton's method on the error twist e = log(T(q)⁻¹ · goal), which the body Jacobian maps to joint steps, converges
quadratically from a seed close by: what servoing needs. Where that fails, the geometry of the arm gives every solution
there is, and Newton only removes the last millionths, which come from files that write 1.5708 for a right angle.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Final, Protocol

import eigenpy
import numpy as np
import pinocchio
from numpy.typing import NDArray

from procs.kinematics.forward import Kinematics
from procs.kinematics.inverse.shaft import TINY

Array = NDArray[np.float64]

CONVERGED: Final = 1e-10  # m and rad: quadratic convergence leaves nothing to gain below
ACCEPTED: Final = 1e-8  # m and rad, where rounding keeps it from the former
CLOSE: Final = 0.2  # m and rad: from further away the geometry is quicker, and knows which solution it finds
STEPS: Final = 8
MAX_STEPS: Final = 12  # of all ways together: the geometry's solutions need one or two each
SLOW: Final = 0.5  # a step that leaves more of the error than this leads nowhere soon
LAST_STEP: Final = 1e-5  # rad and m: the error left is about its square, which needs no look
MAX_STEP: Final = 0.6  # rad or m: further, the error twist says little about the joints
DAMPING: Final = 1e-12
FURTHEST_SEEN: Final = (0.01, 0.1)  # m, rad: of a goal that is further, this much of the way is looked at
TURN_WEIGHT: Final = 0.01  # m: where place and turn cannot both be had, a radian counts as much as this
NEAREST_DAMPING: Final = 1e-9  # m²
LIMIT_ROOM: Final = 1e-9  # rad or m: rounding at a limit is no reason to refuse
GUESS_ROOM: Final = 1e-4  # the same for what the geometry says
MAX_TILT: Final = 0.5 * math.pi
PLACE_AND_ROLL: Final = [0, 1, 2, 5]  # rows of the twist that an ECM's four joints can have
ECM_JOINTS, PSM_JOINTS, MTM_JOINTS, SNAKE_JOINTS = 4, 6, 7, 8
BENDS: Final = np.eye(SNAKE_JOINTS)[:, :PSM_JOINTS]  # the last two joints bend as the two before them, in reverse
BENDS[7, 4] = BENDS[6, 5] = 1.0


class Geometry(Protocol):
    """What the shape of an arm says about its solutions."""

    def solutions(self, goal: Array, seed: Array) -> Iterable[Array]:
        """Joints (n,) that bring the tip next to `goal` (4, 4), for every way there is to reach it.

        Where the first joints are beyond their limits the others may be NaN.
        """


class InverseSolver:
    """Solves for one chain; `q` (n,) holds the last result, `reason` why there is none, `axis` which joint is to blame.

    `free` (n, m) maps m independent coordinates to the n joints (snakes bend twice by the same angle); None: all are
    independent. `rows` are those of the twist (6,) that can be had at all.
    """

    def __init__(self, kinematics: Kinematics, geometry: Geometry, free: Array | None = None,
                 rows: slice | list[int] = slice(None)) -> None:
        self.kinematics = kinematics
        n = kinematics.n
        self.q: Array = np.zeros(n)
        self.reason, self.axis = "", -1
        self._partial = rows != slice(None)
        self.steps = 0  # Newton steps that the last solution took
        self._longest = 0.0  # change of a coordinate in the last one
        self._geometry, self._free, self._rows = geometry, free, rows
        self._lower, self._upper = kinematics.lower, kinematics.upper
        self._lu, self._ldlt = eigenpy.PartialPivLU(np.eye(6)), eigenpy.LDLT(np.eye(6))  # a third of numpy's overhead
        self._damping = DAMPING * np.eye(len(range(6)[rows] if isinstance(rows, slice) else rows))
        self._turns = [i for i in range(n) if not kinematics.is_prismatic[i]
                       and kinematics.upper[i] - kinematics.lower[i] > 2.0 * math.pi]

    def solve(self, goal: Array, seed: Array) -> bool:
        """Joints whose tip pose is `goal` (4, 4), close to `seed` (n,) where there is a choice.

        The goal is a rigid transform in the chain's base frame. False: `reason` says why, `q` is the seed.
        """
        self.reason, self.axis, self.steps = "", -1, 0
        place = goal.reshape(16)
        if not math.isfinite(place.dot(place) + seed.dot(seed)):
            np.copyto(self.q, seed)
            self.reason = "goal or seed is not finite"
            return False
        target = pinocchio.SE3(goal)
        q = self.q
        np.copyto(q, seed)
        if self._newton(target, CLOSE) and self._fits(seed, LIMIT_ROOM) == 0.0:
            return True
        best, why, axis = math.inf, "out of reach", -1
        candidates = []
        for start in self._geometry.solutions(goal, seed):
            np.copyto(q, start)
            beyond = self._fits(seed, GUESS_ROOM)
            if beyond == 0.0:
                candidates.append((float(np.abs(q - seed).sum()), q.copy()))
            elif beyond < best:
                best, why, axis = beyond, self.reason, self.axis
        for _, start in sorted(candidates, key=lambda each: each[0]):
            if self.steps >= MAX_STEPS:
                break
            np.copyto(q, start)
            if not self._newton(target, math.inf):
                continue
            if self._fits(seed, LIMIT_ROOM) == 0.0:
                self.reason, self.axis = "", -1
                return True
            why, axis = self.reason, self.axis
        np.copyto(q, seed)
        self.reason, self.axis = why, axis
        return False

    def approach(self, goal: Array, at: Array, most: Array) -> None:
        """`q` := joints (n,) with the tip nearer to a goal (4, 4) than at `at` (n,), or as near as it can come.

        Within limits (but `at` may be beyond them and stay there), no joint further from `at` than `most` (n,). The
        place of the tip comes first, then how it is turned. One linear step: for a stream of goals out of reach.
        """
        error, jacobian = self.kinematics.miss(at, pinocchio.SE3(goal))
        for part, furthest in zip((error[:3], error[3:]), FURTHEST_SEEN, strict=True):
            part *= min(1.0, furthest / max(math.sqrt(part.dot(part)), TINY))
        error[3:] *= TURN_WEIGHT
        jacobian[3:] *= TURN_WEIGHT
        error, jacobian = error[self._rows], jacobian[self._rows]
        free = np.eye(len(at)) if self._free is None else self._free
        first = slice(free.shape[1])  # the independent joints stand first
        change = _bounded(jacobian @ free, error, np.minimum(self._lower - at, 0.0)[first],
                          np.maximum(self._upper - at, 0.0)[first])
        change /= max(1.0, float((np.abs(change) / most[first]).max()))
        np.copyto(self.q, at)
        self.q += free @ change

    def _newton(self, target: pinocchio.SE3, furthest: float) -> bool:
        """Improve `q` until its tip is at the target; gives up further off than `furthest`, or where that is slow."""
        kinematics, q, free = self.kinematics, self.q, self._free
        before = 2.0 * furthest
        for _ in range(STEPS + 1):
            error, jacobian = kinematics.miss(q, target)
            if self._partial:
                error, jacobian = error[self._rows], jacobian[self._rows]
            size = math.sqrt(error.dot(error))
            if size < CONVERGED:
                return True
            if not size <= SLOW * before:
                break
            before = size
            change = self._step(jacobian if free is None else jacobian @ free, error)
            q += change if free is None else free @ change
            self.steps += 1
            if self._longest < LAST_STEP:
                return True
        return size < ACCEPTED

    def _step(self, jacobian: Array, error: Array) -> Array:
        """Change of the independent coordinates that takes the error away, shortened where it is too long."""
        square = jacobian.shape[0] == jacobian.shape[1]
        change = self._lu.compute(jacobian).solve(error) if square else self._damped(jacobian, error)
        self._longest = max(map(abs, change.tolist()))
        if not self._longest <= MAX_STEP:
            change = self._damped(jacobian, error)
            self._longest = max(map(abs, change.tolist()))
            if self._longest > MAX_STEP:
                change *= MAX_STEP / self._longest
        return change

    def _damped(self, jacobian: Array, error: Array) -> Array:
        """The shortest step where more than one does it, or none quite does."""
        step: Array = jacobian.T @ self._ldlt.compute(jacobian @ jacobian.T + self._damping).solve(error)
        return step

    def _fits(self, seed: Array, room: float) -> float:
        """How far joints are beyond their limits, 0: none is by more than `room`; then they are brought within.

        Joints that may turn further than once are brought next to the seed first.
        """
        q, lower, upper = self.q, self._lower, self._upper
        for i in self._turns:
            if math.isnan(q[i]):
                continue
            if not (abs(q.item(i) - seed.item(i)) <= math.pi and lower.item(i) <= q.item(i) <= upper.item(i)):
                q[i] += 2.0 * math.pi * round((seed[i] - q[i]) / (2.0 * math.pi))
                if q[i] > upper[i] + room:
                    q[i] -= 2.0 * math.pi
                elif q[i] < lower[i] - room:
                    q[i] += 2.0 * math.pi
        if np.minimum(np.maximum(q, lower), upper).tobytes() == q.tobytes() and math.isfinite(q.dot(q)):
            return 0.0
        beyond = np.maximum(lower - q, q - upper)
        most = float(beyond.max())
        if most <= room:
            np.minimum(np.maximum(q, lower), upper, out=q)
            return 0.0
        axis = int(np.nanargmax(beyond))
        most = float(beyond[axis])
        self.axis = axis
        side, limit = ("below", lower[axis]) if q[axis] < lower[axis] else ("above", upper[axis])
        self.reason = f"{self.kinematics.names[axis]} would be {q[axis]:.6g}, {side} its limit {limit:.6g}"
        return most


def _bounded(jacobian: Array, error: Array, lower: Array, upper: Array) -> Array:
    """The change (m,) between bounds with the least error left: what would go beyond a bound stays there."""
    change, left = np.zeros(len(lower)), np.ones(len(lower), dtype=np.bool_)
    damping = NEAREST_DAMPING * np.eye(len(error))
    while left.any():
        part = jacobian[:, left]
        rest = error - jacobian[:, ~left] @ change[~left]
        change[left] = part.T @ np.linalg.solve(part @ part.T + damping, rest)
        clipped = np.minimum(np.maximum(change, lower), upper)
        outside = left & (clipped != change)
        if not outside.any():
            break
        change[outside] = clipped[outside]
        left &= ~outside
    return change
