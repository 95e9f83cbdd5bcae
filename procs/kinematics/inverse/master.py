"""Inverse of an MTM: its platform, on which the tip's place does not depend, moves only as far as the yaw needs.

The platform stays where it is while the yaw is at least YAW_MARGIN from its limits. Beyond, it moves by as much as
keeps the yaw there; a yaw that is closer to a limit already goes no closer. So joints are continuous along continuous
goals.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np

from trocar.procs.document.system import Chain
from trocar.procs.kinematics.forward import Kinematics, split_row
from trocar.procs.kinematics.frames import Frame, moved, product
from trocar.procs.kinematics.inverse.shaft import frame_of
from trocar.procs.kinematics.inverse.solver import InverseSolver
from trocar.procs.kinematics.inverse.turns import back
from trocar.procs.kinematics.poses import Array, inverse

ROOM: Final = 1e-5  # rad: Newton's method must not end beyond a limit
YAW_MARGIN: Final = 0.1  # rad
AWAY: Final = 3.0  # a radian of yaw inside its margin counts as this many radians of the platform's way
PLATFORM, PITCH, YAW = 3, 4, 5
PLATFORM_AT_REST: Final = np.delete(np.eye(7), PLATFORM, axis=1)


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
        self._turns = [(frame_of(before), frame_of(after)) for before, after in rows]
        self._offsets = [link.theta + link.offset for link in links]
        self._upper_arm = links[1].a
        self._forearm = math.hypot(links[2].a, links[3].d)
        self._elbow = math.atan2(links[3].d, links[2].a)
        self._platform, self._yaw = (links[3].lower, links[3].upper), min(-links[5].lower, links[5].upper) - ROOM
        self._pitches = links[4].lower + ROOM, links[4].upper - ROOM

    def solutions(self, goal: Array, seed: Array) -> Iterator[list[float]]:
        """The platforms as near to the seed's as yaw and pitch allow, and those where the yaw is 0."""
        frame = product(self._from_base, frame_of(goal))
        for q in self._places(frame[3], frame[7], frame[11]):
            rest = product(back(self._forearm_axes(q)), frame)
            for platform in itertools.chain(self._platforms(rest, seed), self._at_pitch_limits(rest)):
                yield self._wrist(q, rest, platform)

    def most_yaw(self, seed: Array) -> float:
        """The largest yaw for which the platform need not move."""
        return min(max(self._yaw - YAW_MARGIN, abs(float(seed[YAW]))), self._yaw)

    def facing(self, rotation: Array, q: Array, seed: Array) -> Array | None:
        """Joints (7,) with the first three from `q` and the tip's axes at `rotation` (3, 3) in the base frame.

        The platform is as near to the seed's as the yaw's limits allow; the other angles are within half a turn of the
        seed's; pitch and roll may exceed their limits. None: no platform is suitable.
        """
        arm: list[float] = q.tolist()
        tip = product(self._from_base, np.column_stack((rotation, np.zeros(3))).ravel().tolist())
        rest = product(back(self._forearm_axes(arm)), tip)
        platforms = list(self._platforms(rest, seed))
        if not platforms:
            return None
        found = np.array(self._wrist(arm, rest, min(platforms, key=lambda angle: abs(angle - seed[3]))))
        turn = 2.0 * math.pi
        found[4:] += turn * np.round((seed[4:] - found[4:]) / turn)
        return found

    def _forearm_axes(self, q: list[float]) -> Frame:
        """The frame after the first three joints, in which the platform turns."""
        axes: Frame = (1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0)
        for (before, after), angle in zip(self._turns[:3], q, strict=False):
            axes = product(moved(product(axes, before), False, angle), after)
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

    def _platforms(self, rest: Frame, seed: Array) -> Iterator[float]:
        """Platform positions for which the yaw, with sin(yaw) = size · sin(angle − middle), stays within its limits."""
        x, y = rest[2], rest[6]
        size, middle = math.hypot(x, y), math.atan2(y, x)
        half, wanted_half = (_half(size, yaw) for yaw in (self._yaw, self.most_yaw(seed)))
        low, high = self._platform
        for turn in range(-2, 3):
            best = middle + turn * math.pi - self._offsets[PLATFORM]
            first, last = max(low, best - half), min(high, best + half)
            if first <= last:
                wanted = min(max(float(seed[PLATFORM]), best - wanted_half), best + wanted_half)
                yield min(max(wanted, first), last)
                if first <= best <= last:
                    yield best

    def _at_pitch_limits(self, rest: Frame) -> Iterator[float]:
        """Platform positions where the pitch is at a limit, and the yaw within its own."""
        size, middle = math.hypot(rest[2], rest[6]), math.atan2(rest[6], rest[2])
        height, most = self._turns[PLATFORM][1][9] * rest[10], math.sin(self._yaw)
        for limit in self._pitches:
            sine, cosine = math.sin(limit + self._offsets[PITCH]), math.cos(limit + self._offsets[PITCH])
            if height * sine >= 0.0 or abs(along := height * cosine / sine) >= size:
                continue
            half = math.acos(along / size)
            if size * math.sin(half) > most:
                continue
            for angle, turn in itertools.product((middle + half, middle - half), (-1, 0, 1)):
                platform = angle - self._offsets[PLATFORM] + turn * 2.0 * math.pi
                if self._platform[0] <= platform <= self._platform[1]:
                    yield platform

    def _wrist(self, arm: list[float], rest: Frame, platform: float) -> list[float]:
        before, after = self._turns[3]
        _, _, c, _, _, _, f, _, g, h, i, _ = product(back(product(moved(before, False, platform), after)), rest)
        # the wrist yaw without its offset is between -π and 0: there its sine is negative
        angles = math.atan2(-f, -c), -math.acos(max(-1.0, min(1.0, i))), math.atan2(-h, g)
        pitch, yaw, roll = self._less_offsets(angles, PITCH)
        middle = 0.5 * sum(self._pitches)  # its upper limit is beyond half a turn
        return [*arm[:3], platform, middle + math.remainder(pitch - middle, 2.0 * math.pi), yaw, roll]


def _half(size: float, yaw: float) -> float:
    """How far the platform may be from where the yaw is 0."""
    most = math.sin(yaw)
    return math.asin(most / size) if size > most else 0.5 * math.pi


class _WristInverse(InverseSolver):
    """Solves for six joints, with the platform at one of the positions of the geometry."""

    _geometry: Master

    def _suits(self) -> bool:
        return abs(float(self.q[YAW])) <= self._geometry.most_yaw(self.seed)

    def _distance(self, q: Array) -> float:
        way = float(np.abs(q - self.seed)[: PLATFORM + 1].sum())
        return way + AWAY * max(0.0, abs(float(q[YAW])) - self._geometry.most_yaw(self.seed))


class MasterInverse(InverseSolver):
    """Solver of an MTM, see above; an unreachable goal is approached with all seven joints."""

    is_direct = False

    def __init__(self, chain: Chain) -> None:
        geometry = Master(chain)
        super().__init__(Kinematics(chain), geometry)
        self._wrist = _WristInverse(self.kinematics, geometry, free=PLATFORM_AT_REST)

    def solve(self, goal: Array, seed: Array) -> bool:
        """See InverseSolver."""
        wrist = self._wrist
        is_found = wrist.solve(goal, seed)
        self.q[...] = wrist.q
        self.reason, self.axis, self.steps = wrist.reason, wrist.axis, wrist.steps
        return is_found
