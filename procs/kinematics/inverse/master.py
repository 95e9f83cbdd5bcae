"""Every place, and the best platforms, of an MTM."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from typing import Final

import numpy as np
from numpy.typing import NDArray

from procs.document.system import Chain
from procs.kinematics.denavit import split_row
from procs.kinematics.inverse.shaft import about_z, rigid_inverse

Array = NDArray[np.float64]

YAW_ROOM: Final = 1e-5  # rad: Newton's method must not end beyond the limit


class Master:
    """MTM: three joints place the point where the wrist's four axes meet; the platform is free within limits.

    Standard Denavit-Hartenberg rows: outer yaw about the vertical, shoulder and elbow in the plane it turns; platform,
    pitch, yaw and roll. With the platform given, pitch, yaw and roll are Euler angles (z y z).
    """

    def __init__(self, chain: Chain) -> None:
        """The seven rows of a master."""
        links = chain.links
        self._from_base = rigid_inverse(np.array(chain.base)) if chain.base is not None else np.eye(4)
        self._rows = [split_row(chain.convention, link) for link in links]
        self._offsets = [link.theta + link.offset for link in links]
        self._upper_arm = links[1].a
        self._forearm = math.hypot(links[2].a, links[3].d)
        self._elbow = math.atan2(links[3].d, links[2].a)
        self._platform, self._yaw = (links[3].lower, links[3].upper), min(-links[5].lower, links[5].upper) - YAW_ROOM

    def solutions(self, goal: Array, seed: Array) -> Iterator[Array]:
        """Platform as near to the seed's as the yaw's limits allow, and where the yaw is 0."""
        frame = self._from_base @ goal
        for q in self._places(*frame[:3, 3].tolist()):
            rest = self._forearm_axes(q).T @ frame[:3, :3]
            for platform in self._platforms(rest, seed):
                yield self._wrist(q, rest, platform)

    def facing(self, rotation: Array, q: Array, seed: Array) -> Array | None:
        """Joints (7,) where the first three of `q` are and the tip has the axes `rotation` (3, 3) in the base frame.

        The platform stays as near to the seed's as the yaw's limits allow, the other angles come within half a turn of
        the seed's; those of pitch and roll may be beyond their limits. None: no platform will do.
        """
        rest = self._forearm_axes(q).T @ self._from_base[:3, :3] @ rotation
        platforms = list(self._platforms(rest, seed))
        if not platforms:
            return None
        found = self._wrist(q, rest, min(platforms, key=lambda angle: abs(angle - seed[3])))
        turn = 2.0 * math.pi
        found[4:] += turn * np.round((seed[4:] - found[4:]) / turn)
        return found

    def _forearm_axes(self, q: Array) -> Array:
        """What the platform turns in (3, 3): the frame after the first three joints."""
        rotation: Array = np.eye(3)
        for joint in range(3):
            before, after = self._rows[joint]
            rotation = rotation @ before[:3, :3] @ about_z(q[joint]) @ after[:3, :3]
        return rotation

    def _places(self, x: float, y: float, z: float) -> Iterator[Array]:
        """Outer yaw, shoulder and elbow: forward and backward, elbow down and up."""
        out = math.hypot(x, y)
        upper, fore = self._upper_arm, self._forearm
        bend = (out * out + z * z - upper * upper - fore * fore) / (2.0 * upper * fore)
        if abs(bend) > 1.0:
            return
        for way, elbow in itertools.product((1.0, -1.0), (math.acos(bend), -math.acos(bend))):
            turn = math.atan2(way * y, way * x)
            lift = math.atan2(z, way * out) - math.atan2(fore * math.sin(elbow), upper + fore * math.cos(elbow))
            q = np.full(7, np.nan)
            for joint, angle in enumerate((turn, lift, elbow - self._elbow)):
                q[joint] = math.remainder(angle - self._offsets[joint], 2.0 * math.pi)
            yield q

    def _platforms(self, rest: Array, seed: Array) -> Iterator[float]:
        """Platform positions: sin(yaw) = size · sin(angle − middle) must stay within the yaw's limits."""
        x, y = float(rest[0, 2]), float(rest[1, 2])
        size, middle = math.hypot(x, y), math.atan2(y, x)
        most = math.sin(self._yaw)
        half = math.asin(most / size) if size > most else 0.5 * math.pi
        low, high = self._platform
        for turn in range(-2, 3):
            best = middle + turn * math.pi - self._offsets[3]
            first, last = max(low, best - half), min(high, best + half)
            if first <= last:
                yield min(max(seed[3], first), last)
                if first <= best <= last:
                    yield best

    def _wrist(self, arm: Array, rest: Array, platform: float) -> Array:
        q = arm.copy()
        q[3] = platform
        before, after = self._rows[3]
        turn = (before[:3, :3] @ about_z(platform) @ after[:3, :3]).T @ rest
        # the wrist yaw, less its offset, lies between -π and 0: there its sine is negative
        angles = (math.atan2(-turn[1, 2], -turn[0, 2]), -math.acos(max(-1.0, min(1.0, turn[2, 2]))),
                  math.atan2(-turn[2, 1], turn[2, 0]))
        for joint, angle in enumerate(angles, 4):
            q[joint] = math.remainder(angle - self._offsets[joint], 2.0 * math.pi)
        return q
