"""The walls of an arm that move with other arms: where they are in this cycle, and whether that is known."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

import numpy as np

from trocar.procs.arm.cartesian import Cartesian
from trocar.procs.arm.other_arm import MeasuredBy, OtherArm
from trocar.procs.document.walls import ARMS, FRAMES, Wall
from trocar.procs.kinematics.poses import Array
from trocar.procs.kinematics.walls.body import PART_BITS, ArmBody
from trocar.procs.kinematics.walls.moved import MovedWalls
from trocar.procs.kinematics.walls.walls import MOST, ArmWalls
from trocar.procs.native.library import address_of
from trocar.procs.node.inputs import LATE_NS

SEGMENTS: Final = 8
"""Room for those of one arm."""
LARGEST: Final = 0.25
"""m: an arm whose joints are measured no more may be anywhere within this distance of where it was."""
PAUSE_NS: Final = 5_000_000
FIXED, BY_TIP, OWN_TIP = range(3)
"""The relation of two bases: constant; through the other arm's tip; through this arm's tip."""


class Neighbour:
    """Walls of one arm that move with one other: its body, or a wall at its tip.

    `why`: why they are not where they should be, so that they do not count; "": they do. `late`: they are larger than
    they should be, and why. `places`: those among the arm's walls.
    """

    def __init__(self, wall: Wall, other: OtherArm, first: int, limits: ArmWalls, pose: Array | None) -> None:
        """`pose` (4, 4): the wall's in the frame of the tip; None: it is the body. `first`: of its places."""
        self.wall, self.other = wall, other
        self._limits, self._pose, self._first = limits, pose, first
        self._moved: MovedWalls | None = None
        self._body: ArmBody | None = None
        self._how, self._base, self._changes = FIXED, np.eye(4), -1
        self.sampled_ns = 0
        self._speed, self._known, self._has_moved = 0.0, False, False
        self.grown = 0.0
        """m: how much larger than they should be."""
        self.places = slice(first, first)
        self.is_related = False
        """How the bases of both arms are related is known, and has not changed."""
        self.why, self.late = "not looked at yet", ""
        self.has_gone = False
        """The other arm was near, and has no instrument now."""

    def follow(self, now_ns: int, own: Cartesian, local: str) -> bool:
        """Move the walls to where the other arm is now; returns whether `why` has changed. `local`: our own name."""
        if self._changes != self.other.changes:
            if self._changes < 0 or self._body is not self.other.body:
                self._fill()
            self._changes = self.other.changes
            self.is_related = False
        if not self.is_related:
            self.is_related = True
            self._relate(own, local)
        before, self.why = self.why, self._follow(now_ns, own, local)
        if before == self.why:
            return False
        self._limits.guards[self.places] = 0 if self.why else PART_BITS[self.wall.of]
        return True

    def _fill(self) -> None:
        other, limits = self.other, self._limits
        limits.guards[self.places] = 0
        self.has_gone = other.body is None and float(limits.value[self.places].min(initial=np.inf)) < limits.NEAR
        self._body, self._moved, self.sampled_ns, self.why = other.body, None, 0, "not looked at yet"
        if other.space is None or other.body is None or other.space.kinematics is None:
            self.places = slice(self._first, self._first)
            return
        count = int(other.body.solid.sum()) if self._pose is None else 1
        self.places = slice(self._first, self._first + count)
        self._moved = MovedWalls(other.space.kinematics, other.body, other.to_joint, other.position, other.biased,
                                 other.age_ns)
        self._moved.fill(limits.frames[self.places], limits.size[self.places], self._pose)
        limits.group[self.places] = self._first if self._pose is None else -1
        n = other.space.count
        self._speed = float(other.space.servo_speed[:n] @ other.body.reach)
        self._grow(0)

    def _relate(self, own: Cartesian, local: str) -> None:
        """Find how the bases of both arms are related."""
        other, moved = self.other, self._moved
        ours = {own.local_frame: np.eye(4)} | ({own.frame: own.to_base} if own.base_known and own.frame else {})
        theirs = {other.local_frame: np.eye(4)} | ({other.frame: other.base} if other.base is not None else {})
        self._how, base = FIXED, None
        for frame in ours.keys() & theirs.keys():
            base = ours[frame] @ theirs[frame]
        if base is None and other.name in ours:
            self._how, base = BY_TIP, ours[other.name]
        elif base is None and local in theirs:
            self._how, base = OWN_TIP, theirs[local]
        self._known = base is not None
        if base is not None:
            self._base, self._has_moved = base, True
            if moved is not None:
                moved.relation[...], moved.by_tip[...] = base[:3], self._how == BY_TIP

    def _follow(self, now_ns: int, own: Cartesian, local: str) -> str:
        other, moved = self.other, self._moved
        if moved is None:
            return "" if self._pose is None else f"{other.name} has no instrument"
        if self._pose is not None and not other.is_known:
            return f"the instrument of {other.name} is not known"
        if not self._known:
            return f"the base frame of {other.name} is not known here"
        sampled_ns = other.measured_ns()
        if not sampled_ns:
            return f"the joints of {other.name} are not known"
        if self._how == OWN_TIP:
            if not own.valid:
                return f"the tip of {local} is not known"
            np.matmul(own.tip[:3], self._base, out=moved.relation)
        if sampled_ns != self.sampled_ns or self._how == OWN_TIP or self._has_moved:
            if moved.follow():
                self.sampled_ns, self._has_moved = sampled_ns, False
            elif not self.sampled_ns:
                return f"the joints of {other.name} are not known"
        age_ns = abs(now_ns - self.sampled_ns)
        if age_ns > LATE_NS or self.late:
            self._grow(age_ns if age_ns > LATE_NS else 0)
        return ""

    @property
    def plain(self) -> MovedWalls | None:
        """What follows by itself, if nothing changes but the joints of the other arm; None: nothing."""
        return None if self.why or self.late or self._how == OWN_TIP else self._moved

    def _grow(self, age_ns: int) -> None:
        """An arm that was not measured for a while may have moved."""
        self.grown = min(self._speed * max(age_ns - LATE_NS, 0) * 1e-9, LARGEST)
        self._limits.margin[self.places] = self.wall.margin + self.grown
        self.late = f", not measured for {age_ns * 1e-9:.2f} s" if age_ns else ""


class Neighbours:
    """All walls of one arm that move with others."""

    def __init__(self, local: str, other: Callable[[str], OtherArm]) -> None:
        """`local` is the arm's own name; `other` finds another arm by its name, ValueError: there is none."""
        self._local, self._other = local, other
        self._known: dict[str, OtherArm] = {}
        self._turn = self._followed_ns = 0
        self.rows: list[Neighbour] = []
        self._plain: list[MovedWalls] = []
        """If all rows follow by themselves: all that move."""
        self._addresses = np.zeros(0, dtype=np.int64)
        self._ios: list[MeasuredBy] = []
        self._at = self._measured_ns = 0

    def of(self, wall: Wall) -> list[OtherArm]:
        """The other arms that a wall moves with; ValueError: there is no such arm."""
        names = wall.arms if wall.shape == ARMS else (wall.frame,) if wall.frame not in FRAMES else ()
        for name in names:
            if name == self._local:
                raise ValueError(f"{name} is this arm itself")
            if name not in self._known:
                self._known[name] = self._other(name)
        return [self._known[name] for name in names]

    def arrange(self, walls: Sequence[tuple[Wall, Array]], limits: ArmWalls | None) -> list[list[Neighbour]]:
        """The walls of this arm have changed, with their poses; returns the neighbours of each."""
        found, first = list[list[Neighbour]](), MOST
        for place, (wall, pose) in enumerate(walls):
            rows = list[Neighbour]()
            for other in self.of(wall):
                if limits is None:  # without an instrument, an arm has no walls
                    break
                at, hung = (first, None) if wall.shape == ARMS else (place, pose)
                rows.append(Neighbour(wall, other, at, limits, hung))
                first += SEGMENTS if wall.shape == ARMS else 0
            found.append(rows)
        self.rows, self._turn, self._followed_ns = [row for rows in found for row in rows], 0, 0
        self._plain = []
        self._ios = [*{id(row.other.io): row.other.io for row in self.rows}.values()]
        return found

    def own_base_moved(self) -> None:
        """The base frame of this arm has changed."""
        for row in self.rows:
            row.is_related = False
        self._plain = []

    def follow(self, now_ns: int, own: Cartesian) -> bool:
        """Once a cycle; returns whether some wall has become known or unknown.

        Joints are read in every cycle; instrument and base frame, which change rarely, of one arm in each, and of all
        after a pause.
        """
        if not self.rows:
            return False
        before_ns, self._followed_ns = self._followed_ns, now_ns
        self._turn = (self._turn + 1) % len(self.rows)
        has_changed = False
        for row in self.rows if now_ns - before_ns > PAUSE_NS else (self.rows[self._turn],):
            has_changed |= row.other.look(now_ns)
        if self._plain and not has_changed:
            oldest_ns = min([io.stamp_ns for io in self._ios])
            if self._plain[0].follow_all(self._at, len(self._plain), LATE_NS - abs(now_ns - oldest_ns)):
                self._measured_ns = oldest_ns
                return False
            for row in self.rows:
                row.sampled_ns = max(row.sampled_ns, self._measured_ns)
        changed = [row.follow(now_ns, own, self._local) for row in self.rows]
        self._find_plain()
        return any(changed)

    def _find_plain(self) -> None:
        """Whether the native library can follow all arms at once from now on."""
        found = [row.plain for row in self.rows]
        plain = [each for each in found if each is not None]
        self._plain = plain if len(plain) == len(found) and all(address_of(each.follow) for each in plain) else []
        self._addresses = np.array([address_of(each.follow) for each in plain], dtype=np.int64)
        self._at = self._addresses.ctypes.data
