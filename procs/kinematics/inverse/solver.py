"""Inverse kinematics: joints for a pose, in bounded time, within limits, or the reason for a failure. Never a silent
clip.

Newton's method on the error twist e = log(T(q)⁻¹ · goal), which the body Jacobian maps to joint steps, converges
quadratically from a close seed: the case of servoing. If that fails, the arm's geometry gives all solutions, and Newton
only removes the last millionths, caused by files that write 1.5708 for a right angle.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Final, Protocol

import numpy as np

from trocar.procs.kinematics.forward import Kinematics
from trocar.procs.kinematics.frames import Rows, body_jacobian, dot, finite, shortest, solve, times, twist_between
from trocar.procs.kinematics.inverse.shaft import TINY
from trocar.procs.kinematics.poses import Array
from trocar.procs.native.arm_fields import INVERSE
from trocar.procs.native.library import address_of, chosen

CLOSE: Final = 0.2  # m and rad: from further away the geometry is faster, and knows which solution it finds
MAX_STEPS: Final = 12  # for all attempts together: the geometry's solutions need one or two each
LIMIT_ROOM: Final = 1e-9  # rad or m: rounding at a limit is no reason to refuse
GUESS_ROOM: Final = 1e-4  # the same for solutions of the geometry
FULL_TURN: Final = 2.0 * math.pi


class Geometry(Protocol):
    """Inverse kinematics in closed form, for an arm with ideal angles and lengths: start values for Newton's method."""

    def solutions(self, goal: Array, seed: Array) -> Iterable[list[float]]:
        """Joints (n) that bring the tip close to `goal` (4, 4): one list for each solution.

        If the first joints exceed their limits, the others may be NaN.
        """


class InverseSolver:
    """Solves for one chain; `q` (n,) holds the last result, `reason` why there is none, `axis` the joint that prevents
    it.

    `free` (n, m) maps m independent coordinates to the n joints (snakes bend twice by the same angle); None: all are
    independent. `rows` are the controllable rows of the twist (6,).
    """

    CONVERGED: Final = 1e-10  # m and rad: smaller errors gain nothing under quadratic convergence
    ACCEPTED: Final = 1e-8  # m and rad, if rounding prevents the former
    STEPS: Final = 8
    SLOW: Final = 0.5  # a step that leaves more of the error than this converges too slowly
    LAST_STEP: Final = 1e-5  # rad and m: the remaining error is about its square, and needs no check
    LAST_ERROR: Final = 1e-4  # m and rad: with a larger error, the step was short because the error cannot be removed
    MAX_STEP: Final = 0.6  # rad or m: further, the error twist is a poor guide for the joints
    DAMPING: Final = 1e-12
    FURTHEST_PLACE: Final = 0.01  # m: for a goal that is further, only this much of the way is considered
    FURTHEST_TURN: Final = 0.1  # rad
    TURN_WEIGHT: Final = 0.01  # m: weight of a radian where position and rotation cannot both be reached
    NEAREST_DAMPING: Final = 1e-9  # m²
    is_direct = True
    """`solve` begins with `improve`."""

    def __init__(self, kinematics: Kinematics, geometry: Geometry, free: Array | None = None,
                 rows: tuple[int, ...] = (0, 1, 2, 3, 4, 5)) -> None:
        self.kinematics = kinematics
        n = kinematics.n
        self.q: Array = np.zeros(n)
        self.reason, self.axis = "", -1
        self.steps = 0  # Newton steps of the last solution
        self._geometry = geometry
        self.has_free = int(free is not None)
        self.free = np.eye(n) if free is None else np.ascontiguousarray(free)
        self.m = self.free.shape[1]
        self.rows, self.rows_count = np.array(rows), len(rows)
        self.lower, self.upper = kinematics.lower, kinematics.upper
        self.turns = ~kinematics.is_prismatic & (self.upper - self.lower > FULL_TURN)
        self.most, self.beyond = np.zeros(n), np.zeros(1)
        self._given = np.zeros(16 + n)
        self.goal, self.seed = self._given[:16].reshape(4, 4), self._given[16:]
        self._newton, self._fits, self._approach = chosen(INVERSE, self, "by_numpy_")
        self.address = address_of(self._newton)
        """Of the native library's struct, 0: none."""

    def solve(self, goal: Array, seed: Array) -> bool:
        """Joints whose tip pose is `goal` (4, 4), close to `seed` (n,) if there are several.

        The goal is a rigid transform in the chain's base frame. False: `reason` explains it, `q` is the seed.
        """
        if self.improve(goal, seed):
            return True
        if self.reason:
            return False
        q = self.q
        best, why, axis = math.inf, "out of reach", -1
        candidates = []
        for start in self._geometry.solutions(self.goal, self.seed):
            q[...] = start
            worst = self._fits(GUESS_ROOM)
            if worst < 0:
                candidates.append((self._distance(q), q.copy()))
            elif self.beyond.item() < best:
                best, why, axis = self.beyond.item(), self._blame(worst), worst
        for _, candidate in sorted(candidates, key=lambda each: each[0]):
            if self.steps >= MAX_STEPS:
                break
            q[...] = candidate
            if not self._improve(math.inf):
                continue
            worst = self._fits(LIMIT_ROOM)
            if worst < 0:
                return True
            why, axis = self._blame(worst), worst
        q[...] = self.seed
        self.reason, self.axis = why, axis
        return False

    def improve(self, goal: Array, seed: Array) -> bool:
        """The same without other solutions than that next to the seed; False without `reason`: there may be others."""
        self.reason, self.axis, self.steps = "", -1, 0
        self.goal[...] = goal
        self.seed[...] = seed
        self.q[...] = seed
        if not math.isfinite(self._given.dot(self._given)):
            self.reason = "goal or seed is not finite"
            return False
        return self._improve(CLOSE) and self._fits(LIMIT_ROOM) < 0 and self._suits()

    def approach(self, goal: Array, at: Array, most: Array) -> None:
        """`q` := joints (n,) with the tip nearer to a goal (4, 4) than at `at` (n,), or as near as possible.

        Within limits (but `at` may be beyond them and stay there), no joint further from `at` than `most` (n,). The
        tip's position has priority over its rotation. One linear step: for a stream of goals out of reach.
        """
        self.goal[...] = goal
        self.seed[...] = at
        np.maximum(most, TINY, out=self.most)
        self._approach()

    def _improve(self, furthest: float) -> bool:
        """Newton's method; stops if the error exceeds `furthest` or convergence is slow."""
        steps = self._newton(furthest)
        self.steps += steps if steps >= 0 else -1 - steps
        return steps >= 0

    def _suits(self) -> bool:
        """Whether the solution in `q` is to be preferred to others further from the seed."""
        return True

    def _distance(self, q: Array) -> float:
        """How far joints (n,) are from the seed: the nearest solution is taken."""
        return float(np.abs(q - self.seed).sum())

    def _blame(self, axis: int) -> str:
        value, lower, upper = self.q[axis], self.lower[axis], self.upper[axis]
        side, limit = ("below", lower) if value < lower else ("above", upper)
        return f"{self.kinematics.names[axis]} would be {value:.6g}, {side} its limit {limit:.6g}"

    # the reference of the native library

    def by_numpy_newton(self, furthest: float) -> int:
        """Improve `q` until its tip is at the goal: returns the number of steps, or -1 minus the steps of a failure."""
        q, before = self.q.tolist(), 2.0 * furthest
        size, steps = math.inf, 0
        for _ in range(self.STEPS + 1):
            error, rows = self._miss(q)
            size = math.sqrt(dot(error, error))
            if size < self.CONVERGED:
                break
            if not size <= self.SLOW * before:
                break
            before = size
            change, longest = self._step(rows, error)
            q = [x + dx for x, dx in zip(q, self._spread(change), strict=True)]
            steps += 1
            if longest < self.LAST_STEP and size < self.LAST_ERROR:
                size = 0.0
                break
        self.q[...] = q
        return steps if size < self.ACCEPTED else -1 - steps

    def by_numpy_fits(self, room: float) -> int:
        """The joint furthest beyond its limit, with the excess in `beyond`; -1: none by more than `room`.

        With -1, all joints are clipped to their limits. Joints with a range of more than a turn are brought close to
        the seed first.
        """
        q, most, axis, is_nan = self.q.tolist(), -math.inf, 0, False
        for i, (lower, upper, seed, turns) in enumerate(zip(
                self.lower.tolist(), self.upper.tolist(), self.seed.tolist(), self.turns.tolist(), strict=True)):
            if turns and math.isfinite(q[i]) and not (abs(q[i] - seed) <= math.pi and lower <= q[i] <= upper):
                q[i] += FULL_TURN * round((seed - q[i]) / FULL_TURN)
                if q[i] > upper + room:
                    q[i] -= FULL_TURN
                elif q[i] < lower - room:
                    q[i] += FULL_TURN
            over = lower - q[i] if lower - q[i] > q[i] - upper else q[i] - upper
            is_nan = is_nan or math.isnan(over)
            if over > most:
                most, axis = over, i
        self.q[...] = q
        if not is_nan and most <= room:
            np.minimum(np.maximum(self.q, self.lower), self.upper, out=self.q)
            return -1
        self.beyond[0] = most if most > room else math.inf
        return axis

    def by_numpy_approach(self) -> int:
        """See `approach`."""
        at = self.seed.tolist()
        error, rows = self._miss(at, self.TURN_WEIGHT)
        lower, upper = (self.lower - self.seed).tolist()[: self.m], (self.upper - self.seed).tolist()[: self.m]
        change = self._bounded(rows, error, [min(x, 0.0) for x in lower], [max(x, 0.0) for x in upper])
        share = 1.0
        for dx, most in zip(change, self.most.tolist(), strict=False):
            share = max(share, abs(dx) / most)
        q = [x + dx for x, dx in zip(at, self._spread([dx / share for dx in change]), strict=True)]
        self.q[...] = q if math.isfinite(dot(q, q)) else at
        return 0

    def _miss(self, q: list[float], turn_weight: float = 0.0) -> tuple[list[float], Rows]:
        """The controlled rows of the twist from the tip at q to the goal, in tip axes, and their Jacobian.

        With a weight of turns: limited to the part of the way that is considered, and weighted.
        """
        kinematics = self.kinematics
        frames = kinematics.links.frames(finite(q))
        tip = kinematics.tip_after(frames)
        error = twist_between(tip, self.goal.reshape(16).tolist()[:12])
        body = body_jacobian(frames, kinematics.is_prismatic.tolist(), tip)
        if turn_weight:
            for part, furthest, weight in ((0, self.FURTHEST_PLACE, 1.0), (3, self.FURTHEST_TURN, turn_weight)):
                size = math.sqrt(dot(error[part : part + 3], error[part : part + 3]))
                scale = (furthest / size if size > furthest else 1.0) * weight
                for i in range(part, part + 3):
                    error[i] *= scale
                    for column in body:
                        column[i] *= weight
        chosen = self.rows.tolist()
        rows = [[column[row] for column in body] for row in chosen]
        if self.has_free:
            columns = self.free.T.tolist()
            rows = [times(columns, row) for row in rows]
        return [error[row] for row in chosen], rows

    def _spread(self, change: list[float]) -> list[float]:
        """Change of the joints, from that of the independent coordinates."""
        return times(self.free.tolist(), change) if self.has_free else change

    def _step(self, rows: Rows, error: list[float]) -> tuple[list[float], float]:
        """Change of the independent coordinates that removes the error, shortened if it is too long."""
        change, longest = list(error), math.nan
        if len(rows) == self.m and solve([list(row) for row in rows], change):
            longest = _largest(change)
        if not longest <= self.MAX_STEP:
            change = shortest(rows, error, self.DAMPING)
            longest = _largest(change)
            if longest > self.MAX_STEP:
                change = [dx * (self.MAX_STEP / longest) for dx in change]
        return change, longest

    def _bounded(self, rows: Rows, error: list[float], lower: list[float], upper: list[float]) -> list[float]:
        """The change (m,) between bounds with the least remaining error: coordinates at a bound stay there."""
        change, left = [0.0] * self.m, [True] * self.m
        for _ in range(self.m):
            rest, part, outside = list(error), [list(row) for row in rows], False
            for c, is_left in enumerate(left):
                if not is_left:
                    for i, row in enumerate(part):
                        rest[i] -= row[c] * change[c]
                        row[c] = 0.0
            for j, dx in enumerate(shortest(part, rest, self.NEAREST_DAMPING)):
                if left[j]:
                    change[j] = lower[j] if dx < lower[j] else upper[j] if dx > upper[j] else dx
                    if change[j] != dx and not math.isnan(dx):
                        left[j], outside = False, True
            if not outside:
                break
        return change


def _largest(change: list[float]) -> float:
    """The largest magnitude; NaN if any is."""
    longest = 0.0
    for dx in change:
        if not abs(dx) <= longest and longest == longest:
            longest = abs(dx)
    return longest
