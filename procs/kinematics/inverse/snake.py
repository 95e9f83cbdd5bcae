"""Solutions of a PSM with a snake-like wrist."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final

import numpy as np

from trocar.procs.document.system import Chain, Tool
from trocar.procs.kinematics.frames import Frame, moved, product
from trocar.procs.kinematics.inverse.shaft import ROOM, TINY, Shaft, frame_of
from trocar.procs.kinematics.inverse.turns import (
    Triple,
    about_x,
    about_y,
    added,
    back,
    cross,
    inner,
    place_of,
    scaled,
    turned,
)
from trocar.procs.kinematics.poses import Array, renormalised

ROUNDS: Final = 6  # iterations for the shaft's direction; each leaves a tenth to a third of the previous error
SETTLED: Final = 1.0 - 1e-9
ASIDE: Final = 1e-5  # m
NUDGE: Final = 1e-6  # rad
WIDEST: Final = 0.5  # rad
FAR: Final = 4.0  # wrist lengths from the remote centre: further, the goal's position gives the shaft's direction


class Snake:
    """PSM whose wrist bends twice, each time by the same pitch and yaw: roll, pitch, yaw, yaw, pitch.

    Relative to the shaft the last frame is turned by Rz(roll) · Ry(p) · Rx(2y) · Ry(p), up to fixed turns: its bottom
    row gives p and y. These give the end of the shaft, and that gives the shaft's direction, found by iteration from a
    straight wrist. If the shaft's end is within the wrist's length of the remote centre (where no arm may be sent to
    poses), the solution may be missed.
    """

    def __init__(self, chain: Chain, tool: Tool) -> None:
        """`chain` is yaw, pitch, insertion; `tool` roll and the four bends."""
        links = chain.links + tool.links
        self._shaft = Shaft(chain, links, renormalised(np.array(tool.tip)))
        pitch, yaw, again, last = self._shaft.frames[4:]
        self._unbent = back(product(product(pitch, yaw), product(again, last)))
        self._length = sum(link.a for link in links[4:])
        self._bends = min(link.upper for link in links[4:]) + ROOM
        self._pitches, self._yaws = pitch[6], product(pitch, yaw)[2]
        """1 or -1: bends are about +y and +x of the shaft, or about -y and -x."""

    def solutions(self, goal: Array, seed: Array) -> Iterator[list[float]]:
        """Solutions from three directions: as inserted to the goal, backwards, and along the tip, for goals close to
        the centre.
        """
        end = self._shaft.last_frame(frame_of(goal))
        tip_frame = product(end, self._unbent)
        tip = (tip_frame[2], tip_frame[6], tip_frame[10])
        away = added(place_of(end), tip, -0.5 * self._length)
        size = max(math.sqrt(inner(away, away)), TINY)
        starts = (scaled(away, 1.0 / size), scaled(away, -1.0 / size), tip)
        for along in starts if size < FAR * self._length else starts[:2]:
            settled = self._settle(end, along)
            q = self._joints(end, settled)
            yield q
            aside = self._wrist(end, settled)
            aside = added(aside, settled, -inner(aside, settled))
            if (inner(aside, aside) < ASIDE * ASIDE and self._shaft.within(q)
                    and max(abs(q[4]), abs(q[5])) <= self._bends):
                return

    def _settle(self, end: Frame, along: Triple) -> Triple:
        """Direction of the shaft, from the position of its end, which depends on the direction."""
        first = along
        for _ in range(ROUNDS):
            wrist = self._wrist(end, along)
            depth = math.copysign(math.sqrt(inner(wrist, wrist)), inner(wrist, along))
            if abs(depth) < TINY:
                break
            before, along = along, scaled(wrist, 1.0 / depth)
            if inner(along, before) > SETTLED:
                return along
        along = first
        # Close to the remote centre the iteration diverges: search the direction without a lateral offset of the end.
        for _ in range(ROUNDS):
            one, other = across(along)
            wrist = self._wrist(end, along)
            (x, y), (xa, ya), (xb, yb) = ((inner(w, one), inner(w, other)) for w in (
                wrist, self._wrist(end, added(along, one, NUDGE)), self._wrist(end, added(along, other, NUDGE))))
            depth = inner(wrist, along)  # the basis turns with the direction
            a, b = (xa - x) / NUDGE - depth, (xb - x) / NUDGE
            c, d = (ya - y) / NUDGE, (yb - y) / NUDGE - depth
            determinant = a * d - b * c
            if not abs(determinant) >= TINY:
                break
            u, v = (b * y - d * x) / determinant, (c * x - a * y) / determinant
            size = math.sqrt(u * u + v * v)
            share = min(1.0, WIDEST / max(size, TINY))
            along = added(added(along, one, u * share), other, v * share)
            along = scaled(along, 1.0 / math.sqrt(inner(along, along)))
            if size < NUDGE:
                break
        return along

    def _bend(self, end: Frame, along: Triple) -> tuple[list[float], Frame, float, float]:
        """Joints with the shaft's first three, the rotation after them, pitch and twice the yaw."""
        shaft = self._shaft
        q = shaft.joints(along, 0.0)
        bend = product(product(back(shaft.rotation(q)), end), self._unbent)  # Rz(roll) times the two bends
        x, y, z = bend[8:11]
        pitch = math.atan2(-x, 1.0 + z)
        sine, cosine = math.sin(pitch), math.cos(pitch)
        twice = math.atan2(y / cosine, (z + sine * sine) / (cosine * cosine))
        return q, bend, pitch, twice

    def _wrist(self, end: Frame, along: Triple) -> Triple:
        """Required end of a shaft along `along`."""
        _, _, pitch, twice = self._bend(end, along)
        return self._end_of_shaft(end, self._pitches * pitch, self._yaws * 0.5 * twice)

    def _end_of_shaft(self, end: Frame, pitch: float, yaw: float) -> Triple:
        rotation, place = end, place_of(end)
        for joint, angle in ((7, pitch), (6, yaw), (5, yaw), (4, pitch)):
            before = self._shaft.frames[joint]
            rotation = product(moved(rotation, False, -angle), back(before))
            place = added(place, turned(rotation, place_of(before)), -1.0)
        return place

    def _joints(self, end: Frame, along: Triple) -> list[float]:
        """All joints for a shaft along `along`."""
        q, bend, pitch, twice = self._bend(end, along)
        q[4] = q[7] = self._pitches * pitch
        q[5] = q[6] = self._yaws * 0.5 * twice
        depth = inner(self._end_of_shaft(end, q[4], q[5]), along)
        q[2] = self._shaft.joints((0.0, 0.0, -1.0), depth)[2]
        half = about_y(pitch)
        a, b, _, _, d, e, *_ = product(bend, back(product(product(half, about_x(twice)), half)))
        q[3] = math.atan2(d - b, a + e)
        return q


def across(along: Triple) -> tuple[Triple, Triple]:
    """Two unit vectors at right angles to `along` and to each other."""
    x, y, z = (abs(part) for part in along)
    least = (1.0, 0.0, 0.0) if x <= y and x <= z else (0.0, 1.0, 0.0) if y <= z else (0.0, 0.0, 1.0)
    one = cross(along, least)
    one = scaled(one, 1.0 / math.sqrt(inner(one, one)))
    return one, cross(along, one)
