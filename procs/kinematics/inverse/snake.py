"""Solutions of a PSM with a snake-like wrist."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final

import numpy as np
from numpy.typing import NDArray

from procs.document.system import Chain, Tool
from procs.kinematics.inverse.shaft import ROOM, TINY, Shaft, about_x, about_y, about_z
from procs.kinematics.poses import renormalised

Array = NDArray[np.float64]

ROUNDS: Final = 6  # of a snake's shaft towards the remote centre; each leaves a tenth to a third of the error before
SETTLED: Final = 1.0 - 1e-9
ASIDE: Final = 1e-5  # m
NUDGE: Final = 1e-6  # rad
WIDEST: Final = 0.5  # rad


class Snake:
    """PSM whose wrist bends twice, each time by the same pitch and yaw: roll, pitch, yaw, yaw, pitch.

    Seen from the shaft the last frame is turned by Rz(roll) · Ry(p) · Rx(2y) · Ry(p), up to fixed turns: its bottom row
    gives p and y. Where the shaft ends follows from them, and the shaft's direction from that; it is found by going
    round, from a wrist that is straight. With the shaft's end within the wrist's length of the remote centre (where no
    arm may be sent to poses) it may be missed.
    """

    def __init__(self, chain: Chain, tool: Tool) -> None:
        """`chain` is yaw, pitch, insertion; `tool` roll and the four bends."""
        links = chain.links + tool.links
        self._shaft = Shaft(chain, links, renormalised(np.array(tool.tip)))
        pitch, yaw, again, back = (before[:3, :3] for before in self._shaft.befores[4:])
        self._straight: Array = pitch @ yaw @ again @ back
        self._length = sum(link.a for link in links[4:])
        self._bends = min(link.upper for link in links[4:]) + ROOM
        self._pitches, self._yaws = float(pitch[1, 2]), float((pitch @ yaw)[0, 2])
        """1 or -1: bends are about +y and +x of the shaft, or the other way."""

    def solutions(self, goal: Array, seed: Array) -> Iterator[Array]:
        """From three directions: as inserted to the goal, backwards, and along the tip, for next to the centre."""
        end = self._shaft.last_frame(goal)
        tip = (end[:3, :3] @ self._straight.T)[:, 2]
        away = end[:3, 3] - 0.5 * self._length * tip
        size = math.sqrt(away.dot(away))
        for along in (away / max(size, TINY), away / -max(size, TINY), tip):
            settled = self._settle(end, along)
            q = self._joints(end, settled)
            yield q
            aside = self._wrist(end, settled)
            aside = aside - aside.dot(settled) * settled
            if aside.dot(aside) < ASIDE * ASIDE and self._shaft.within(q) and max(abs(q[4:6])) <= self._bends:
                return

    def _settle(self, end: Array, along: Array) -> Array:
        """Direction of the shaft: that of the place where it ends, which depends on it."""
        first = along
        for _ in range(ROUNDS):
            wrist = self._wrist(end, along)
            depth = math.copysign(math.sqrt(wrist.dot(wrist)), wrist.dot(along))
            if abs(depth) < TINY:
                break
            before, along = along, wrist / depth
            if along.dot(before) > SETTLED:
                return along
        along = first
        # Next to the remote centre going round leads away: there the direction is sought whose end lies beside it.
        for _ in range(ROUNDS):
            one, other = across(along)
            aside = np.array([(w.dot(one), w.dot(other)) for w in (
                self._wrist(end, a) for a in (along, along + NUDGE * one, along + NUDGE * other))])
            slope = (aside[1:] - aside[0]).T / NUDGE
            depth = float(self._wrist(end, along).dot(along))
            slope -= depth * np.eye(2)  # the basis turns with the direction
            if abs(np.linalg.det(slope)) < TINY:
                break
            step = np.linalg.solve(slope, -aside[0])
            size = math.sqrt(step.dot(step))
            step *= min(1.0, WIDEST / max(size, TINY))
            along = along + step[0] * one + step[1] * other
            along /= math.sqrt(along.dot(along))
            if size < NUDGE:
                break
        return along

    def _bend(self, end: Array, along: Array) -> tuple[Array, Array, float, float]:
        """Joints with the shaft's first three, the turn after them, pitch and twice the yaw."""
        shaft = self._shaft
        x, y, z = along.tolist()
        q = shaft.joints((x, y, z), 0.0)
        bend = shaft.rotation(q).T @ end[:3, :3] @ self._straight.T  # Rz(roll) times the two bends
        row = bend[2].tolist()
        pitch = math.atan2(-row[0], 1.0 + row[2])
        sine, cosine = math.sin(pitch), math.cos(pitch)
        twice = math.atan2(row[1] / cosine, (row[2] + sine * sine) / (cosine * cosine))
        return q, bend, pitch, twice

    def _wrist(self, end: Array, along: Array) -> Array:
        """Where a shaft along `along` must end."""
        _, _, pitch, twice = self._bend(end, along)
        return self._end_of_shaft(end, self._pitches * pitch, self._yaws * 0.5 * twice)

    def _end_of_shaft(self, end: Array, pitch: float, yaw: float) -> Array:
        rotation, place = end[:3, :3], end[:3, 3]
        for before, angle in zip(reversed(self._shaft.befores[4:]), (pitch, yaw, yaw, pitch), strict=True):
            rotation = rotation @ about_z(angle).T @ before[:3, :3].T
            place = place - rotation @ before[:3, 3]
        return place

    def _joints(self, end: Array, along: Array) -> Array:
        """All joints for a shaft along `along`."""
        q, bend, pitch, twice = self._bend(end, along)
        q[4] = q[7] = self._pitches * pitch
        q[5] = q[6] = self._yaws * 0.5 * twice
        depth = float(self._end_of_shaft(end, q[4], q[5]).dot(along))
        q[2] = self._shaft.joints((0.0, 0.0, -1.0), depth)[2]
        rolled = bend @ (about_y(pitch) @ about_x(twice) @ about_y(pitch)).T
        q[3] = math.atan2(rolled[1, 0] - rolled[0, 1], rolled[0, 0] + rolled[1, 1])
        return q


def across(along: Array) -> tuple[Array, Array]:
    """Two unit vectors at right angles to `along` and to each other."""
    least = np.zeros(3)
    least[int(np.argmin(np.abs(along)))] = 1.0
    one = np.cross(along, least)
    one /= math.sqrt(one.dot(one))
    return one, np.cross(along, one)
