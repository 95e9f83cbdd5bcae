"""Inverse of an MTM: all arm positions, and the best platforms."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np

from trocar.procs.document.system import Chain
from trocar.procs.kinematics import frames
from trocar.procs.kinematics.forward import split_row
from trocar.procs.kinematics.inverse.shaft import frame_of
from trocar.procs.kinematics.inverse.turns import Turn, back, product, turn_of, turned
from trocar.procs.kinematics.poses import Array, inverse

YAW_ROOM: Final = 1e-5  # rad: Newton's method must not end beyond the limit


class Master:
    """MTM: three joints place the point where the wrist's four axes meet; the platform is free within limits.

    Standard Denavit-Hartenberg rows: outer yaw about the vertical, shoulder and elbow in the plane it turns; platform,
    pitch, yaw and roll. With the platform given, pitch, yaw and roll are Euler angles (z y z).
    """

    def __init__(self, chain: Chain) -> None:
        """The seven rows of a master."""
        links = chain.links
        self._from_base = frame_of(inverse(np.array(chain.base)) if chain.base is not None else np.eye(4))
        rows = (split_row(chain.convention, link) for link in links)
        self._turns = [(turn_of(frame_of(before)), turn_of(frame_of(after))) for before, after in rows]
        self._offsets = [link.theta + link.offset for link in links]
        self._upper_arm = links[1].a
        self._forearm = math.hypot(links[2].a, links[3].d)
        self._elbow = math.atan2(links[3].d, links[2].a)
        self._platform, self._yaw = (links[3].lower, links[3].upper), min(-links[5].lower, links[5].upper) - YAW_ROOM

    def solutions(self, goal: Array, seed: Array) -> Iterator[list[float]]:
        """The platform as near to the seed's as the yaw's limits allow, and the one where the yaw is 0."""
        frame = frames.product(self._from_base, frame_of(goal))
        rotation, middle = turn_of(frame), float(seed[3])
        for q in self._places(frame[3], frame[7], frame[11]):
            rest = product(back(self._forearm_axes(q)), rotation)
            for platform in self._platforms(rest, middle):
                yield self._wrist(q, rest, platform)

    def facing(self, rotation: Array, q: Array, seed: Array) -> Array | None:
        """Joints (7,) with the first three from `q` and the tip's axes at `rotation` (3, 3) in the base frame.

        The platform is as near to the seed's as the yaw's limits allow; the other angles are within half a turn of the
        seed's; pitch and roll may exceed their limits. None: no platform is suitable.
        """
        arm: list[float] = q.tolist()
        tip = product(turn_of(self._from_base), rotation.ravel().tolist())
        rest = product(back(self._forearm_axes(arm)), tip)
        platforms = list(self._platforms(rest, float(seed[3])))
        if not platforms:
            return None
        found = np.array(self._wrist(arm, rest, min(platforms, key=lambda angle: abs(angle - seed[3]))))
        turn = 2.0 * math.pi
        found[4:] += turn * np.round((seed[4:] - found[4:]) / turn)
        return found

    def _forearm_axes(self, q: list[float]) -> Turn:
        """The frame after the first three joints, in which the platform turns."""
        axes: Turn = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
        for (before, after), angle in zip(self._turns[:3], q, strict=False):
            axes = product(turned(product(axes, before), angle), after)
        return axes

    def _places(self, x: float, y: float, z: float) -> Iterator[list[float]]:
        """Outer yaw, shoulder and elbow: forward and backward, elbow down and up."""
        out = math.hypot(x, y)
        upper, fore = self._upper_arm, self._forearm
        bend = (out * out + z * z - upper * upper - fore * fore) / (2.0 * upper * fore)
        if abs(bend) > 1.0:
            return
        for way, elbow in itertools.product((1.0, -1.0), (math.acos(bend), -math.acos(bend))):
            turn = math.atan2(way * y, way * x)
            lift = math.atan2(z, way * out) - math.atan2(fore * math.sin(elbow), upper + fore * math.cos(elbow))
            angles = (turn, lift, elbow - self._elbow)
            yield [*self._less_offsets(angles, 0), *(math.nan,) * 4]

    def _less_offsets(self, angles: Sequence[float], first: int) -> list[float]:
        """Positions, next to 0, of the joints from `first` on."""
        offsets = self._offsets[first : first + len(angles)]
        return [math.remainder(angle - offset, 2.0 * math.pi) for angle, offset in zip(angles, offsets, strict=True)]

    def _platforms(self, rest: Turn, seed: float) -> Iterator[float]:
        """Platform positions for which the yaw, with sin(yaw) = size · sin(angle − middle), stays within its limits."""
        x, y = rest[2], rest[5]
        size, middle = math.hypot(x, y), math.atan2(y, x)
        most = math.sin(self._yaw)
        half = math.asin(most / size) if size > most else 0.5 * math.pi
        low, high = self._platform
        for turn in range(-2, 3):
            best = middle + turn * math.pi - self._offsets[3]
            first, last = max(low, best - half), min(high, best + half)
            if first <= last:
                yield min(max(seed, first), last)
                if first <= best <= last:
                    yield best

    def _wrist(self, arm: list[float], rest: Turn, platform: float) -> list[float]:
        before, after = self._turns[3]
        _, _, c, _, _, f, g, h, i = product(back(product(turned(before, platform), after)), rest)
        # the wrist yaw without its offset is between -π and 0: there its sine is negative
        angles = math.atan2(-f, -c), -math.acos(max(-1.0, min(1.0, i))), math.atan2(-h, g)
        return [*arm[:3], platform, *self._less_offsets(angles, 4)]
