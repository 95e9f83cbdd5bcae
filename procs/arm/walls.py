"""The walls of an arm: kept in every setpoint of the homed arm, changed by commands, and shown in a record.

Walls of the system file come with the document, those of commands from the last record, so that a new process has both.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from trocar.procs.arm.cartesian import Cartesian
from trocar.procs.arm.context import ArmContext
from trocar.procs.arm.given_wall import WORDS, wall_of
from trocar.procs.arm.governor import Governor
from trocar.procs.arm.joints import JointSpace, body_of
from trocar.procs.arm.neighbours import SEGMENTS, Neighbour, Neighbours
from trocar.procs.arm.reports import REPORT_NS, ArmReports
from trocar.procs.document.system import ArmConfig
from trocar.procs.document.walls import ARMS, BASE, HOLD, REFERENCE, Wall
from trocar.procs.kinematics.poses import Array, pose_from_matrix
from trocar.procs.kinematics.walls.recorded import recorded_walls
from trocar.procs.kinematics.walls.walls import MOST, SLOWING_S, ArmWalls, objection_to, pose_of
from trocar.procs.native.library import native
from trocar.procs.node.inputs import Fields
from trocar.procs.node.requests import ANSWERED, CommandRefused
from trocar.procs.tables import codes
from trocar.shm.mailbox.received import Request

GAP_NS: Final = 30_000_000  # between goals of a stream
SHOWN_NS: Final = 33_000_000
NEAR_S: Final = 0.02
"""A stream that was stopped by a wall has caught up when its goal is so near, in s at the largest speed."""
MAX_FRAME: Final = 24
"""Bytes: of the name of a frame in the record, from which a restarted process has the wall."""


@dataclass(slots=True)
class KeptWall:
    """One wall, and whether a command added it."""

    wall: Wall
    pose: Array
    by_command: bool = False
    active: bool = False
    unknown: str = ""
    """Why it is not known where it is; "": it is known."""
    others: Sequence[Neighbour] = ()
    """The other arms that it moves with."""


class Walls:
    """Keeps setpoints of an arm's joints where its walls allow them."""

    def __init__(self, arm: ArmConfig, around: ArmContext, reports: ArmReports, cartesian: Cartesian,
                 is_on: Callable[[], bool]) -> None:
        """`is_on`: the arm is homed. ValueError if the arm has walls, and this machine is too slow for them."""
        self._arm, self._reports, self._cartesian, self._is_on = arm, reports, cartesian, is_on
        self._field = field = around.walls
        self._simulated = around.simulated
        if arm.walls and self._too_slow():
            raise ValueError(f"{arm.name}: {self._too_slow()}")
        self._neighbours = Neighbours(arm.name, around.other)
        self._kept = [KeptWall(wall, pose_of(wall)) for wall in arm.walls]
        if field is not None:
            for kept in _added_before(field, arm):
                if kept.wall.name not in self.names and len(self._kept) < MOST and self._has_frame(kept.wall):
                    self._kept.append(kept)
        self._limits: ArmWalls | None = None
        self._is_arranged = self._is_placed = self._keeps = self._is_followed = False
        self._held = self._reported = self._slowed_by = ""
        """The wall of unknown place that holds the arm; the unknown ones that were reported; what slows a move now."""
        self._count = self._now_ns = self._allowed_ns = 0
        self._wanted: Array | None = None
        """The joints (count,) of the last goal of a stream from which a wall keeps the arm."""
        self.stopped_by = ""
        """The wall that changed the setpoint of the last cycle, or the last goal."""
        self._shown_ns, self._shown = 0, ("", b"")
        self.is_news = True
        """The record has changed."""
        self._unanswered: list[Request] = []

    def use(self, joints: JointSpace) -> None:
        """Use another joint space."""
        self._count, self._limits, self._wanted, self.stopped_by = joints.count, None, None, ""
        self._is_arranged = False
        self._speed, self._calm = joints.servo_speed[: joints.count], joints.v_max[: joints.count]
        if joints.kinematics is not None:
            body = body_of(self._arm, joints)
            n = joints.count
            self._limits = ArmWalls(joints.kinematics, body, joints.lower[:n], joints.upper[:n], joints.free,
                                    SEGMENTS * sum(len(wall.arms) for wall in self._arm.walls))

    def place(self, governor: Governor) -> None:
        """Put all walls where they are now: they have changed, or the base frame has."""
        governor.clip, governor.meets = self.clip if self._kept else None, self.meets
        if not self._kept and not self._is_placed:
            return
        self._is_placed = bool(self._kept)
        limits, own = self._limits, self._cartesian
        if not self._is_arranged:
            self._is_arranged = True
            if limits is not None:
                limits.guards[...] = 0
            rows = self._neighbours.arrange([(kept.wall, kept.pose) for kept in self._kept], limits)
            for place, (kept, others) in enumerate(zip(self._kept, rows, strict=True)):
                kept.others = others
                if limits is not None and kept.wall.shape != ARMS:
                    limits.put(place, kept.wall, kept.pose)
                if limits is not None and kept.wall.frame != BASE:
                    limits.drop(place)
        for place, kept in enumerate(self._kept):
            if limits is not None and kept.wall.frame == REFERENCE:
                limits.put(place, kept.wall, own.to_base @ kept.pose)
                if not own.base_known:
                    limits.drop(place)
        self._neighbours.own_base_moved()
        governor.slow = self.slow if self._neighbours.rows else None
        self._is_followed = False
        self._settle()

    def begin(self, now_ns: int) -> None:
        """A new cycle: other arms may have moved."""
        self._now_ns, self._is_followed, self._slowed_by = now_ns, False, ""

    def _follow(self) -> None:
        """Before anything in a cycle that needs the walls: those that move with other arms are where these are now."""
        if not self._is_followed:
            self._is_followed = True
            if self._neighbours.follow(self._now_ns, self._cartesian):
                self._settle()

    def _settle(self) -> None:
        """Some wall, or where it is, has become known or unknown."""
        limits, own, held = self._limits, self._cartesian, ""
        for kept in self._kept:
            kept.unknown = "; ".join(row.why for row in kept.others if row.why)
            if kept.wall.frame == REFERENCE and not own.base_known:
                kept.unknown = f"{own.frame} is not known"
            concerns = limits is not None and limits.body.has(kept.wall.of)
            kept.active = concerns and not kept.unknown
            if concerns and kept.unknown and kept.wall.unknown == HOLD and not held:
                held = f"{kept.wall.name} ({kept.unknown})"
        self._held = held
        self._keeps = bool(held) or (limits is not None and bool(limits.guards.any()))
        self.is_news = True

    def _report_unknown(self) -> None:
        unknown = ", ".join(f"{kept.wall.name}: {kept.unknown}" for kept in self._kept if kept.unknown)
        if self._is_on() and unknown != self._reported:
            self._reported = unknown
            if unknown:
                self._reports.report(codes.WALL_OFF, unknown, REPORT_NS)

    def _report_gone(self) -> None:
        if gone := [row for row in self._neighbours.rows if row.has_gone and self._is_on()]:
            text = "; ".join(f"{row.wall.name}: {row.other.name} has no instrument now" for row in gone)
            self._reports.report(codes.OTHER_ARM_GONE, text, REPORT_NS)
        for row in gone:
            row.has_gone = False

    @property
    def names(self) -> list[str]:
        """Names of all walls."""
        return [kept.wall.name for kept in self._kept]

    @property
    def guards(self) -> bool:
        """Whether any wall is active, or holds the arm, on a homed arm."""
        if self._neighbours.rows:
            self._follow()
        return self._keeps and self._is_on()

    # setpoints

    def allow(self, here: Array, goal: Array, now_ns: int) -> str:
        """Change the `goal` of a stream (size,) to the nearest one that is allowed from `here`; returns the wall.

        Back from a wall, the goal is approached at the speeds of moves.
        """
        limits, n = self._limits, self._count
        passed_ns, self._allowed_ns = min(now_ns - self._allowed_ns, GAP_NS), now_ns
        if limits is None or not self.guards:
            self.forget()
            return ""
        limits.before[...], limits.goal[...] = here[:n], goal[:n]
        name = self._held or self._name_of(limits.keep(0.0, 0))
        if self._held:
            limits.goal[...] = here[:n]
        if name:
            self._wanted, self.stopped_by = goal[:n].copy(), name
            goal[:n] = limits.goal
        elif self._wanted is not None:
            self._wanted = goal[:n].copy()
            far = float((np.abs(goal[:n] - here[:n]) / self._calm).max()) / (max(passed_ns, 1) * 1e-9)
            if far > 1.0:
                goal[:n] = here[:n] + (goal[:n] - here[:n]) / far
        return name

    def forget(self) -> None:
        """No stream is kept from its goals."""
        self._wanted, self.stopped_by = None, ""

    def ways_from_last(self, here: Array, goal: Array) -> Array | None:
        """While a wall keeps a stream from its goals: distances (count,) of a new goal from the last one, in s at the
        largest speeds; None: it is to be judged from the setpoint, as usual.
        """
        if self._wanted is None:
            return None
        n = self._count
        if (np.abs(goal[:n] - here[:n]) <= NEAR_S * self._speed).all():
            self.forget()
            return None
        return np.asarray(np.abs(goal[:n] - self._wanted) / self._speed)

    def meets(self, before: Array, goal: Array, seconds: float) -> bool:
        """Whether `clip` may change this setpoint."""
        limits, n = self._limits, self._count
        if limits is not None and self.guards and not self._held:
            limits.before[...], limits.goal[...] = before[:n], goal[:n]
            if not limits.meets(min(1.0, seconds / SLOWING_S)):
                self.stopped_by = "" if self._wanted is None else self.stopped_by
                return False
        return True

    def clip(self, before: Array, goal: Array, step: Array, seconds: float) -> bool:
        """Bound the setpoint `goal` (size,) of a cycle of so many seconds, in which joints change by `step` (2, size)
        at least and at most; returns whether it changed. 0 seconds: a point of a move, which only stops.
        """
        limits, n = self._limits, self._count
        if limits is None or not self.guards:
            self.stopped_by = ""
            return False
        limits.before[...], limits.goal[...] = before[:n], goal[:n]
        if self._held or not seconds:
            name = self._held or self._name_of(limits.way())
            limits.goal[...] = before[:n]
        else:
            limits.step[...] = step[:, :n]
            name = self._name_of(limits.keep(min(1.0, seconds / SLOWING_S), 1))
        if name:
            goal[:n] = limits.goal
        self.stopped_by = name or self._slowed_by or ("" if self._wanted is None else self.stopped_by)
        return bool(name)

    def slow(self, before: Array, goal: Array, seconds: float) -> float:
        """How much of the step of a move, of so many seconds, is slow enough before other arms."""
        limits, n = self._limits, self._count
        if limits is None or self._held or not self.guards:
            return 1.0
        limits.before[...], limits.goal[...] = before[:n], goal[:n]
        self.stopped_by = self._slowed_by = self._name_of(limits.slow(min(1.0, seconds / SLOWING_S)))
        return limits.share.item()

    def objection(self, here: Array, goal: Array) -> str:
        """Why a move from `here` to `goal` (size,) would cross a wall; "": it does not."""
        limits, n = self._limits, self._count
        if limits is None or not self.guards:
            return ""
        if self._held:
            return f"wall {self._held}"
        limits.before[...], limits.goal[...] = here[:n], goal[:n]
        pair = limits.way()
        if not pair:
            self.forget()
            return ""
        limits.look()
        beyond = limits.value.ravel().item(pair - 1)
        end = f"; the goal is {-1e3 * beyond:.1f} mm beyond it" if beyond < 0.0 else ""
        return f"wall {self._name_of(pair)} is in the way, {100.0 * limits.share.item():.0f} % along the path{end}"

    def push(self, position: Array, velocity: Array, effort: Array) -> None:
        """Add the efforts of soft walls to those of the joints (size,), at measured positions and velocities (size,).
        """
        limits, n = self._limits, self._count
        if limits is None or not self.guards:
            return
        limits.goal[...], limits.rates[...] = position[:n], velocity[:n]
        late = [row for row in self._neighbours.rows if row.late]
        for row in late:  # where an arm may be, but need not, there is no spring: it would push this arm away
            limits.margin[row.places] -= row.grown
        if limits.push():
            effort[:n] += limits.efforts
        for row in late:
            limits.margin[row.places] += row.grown

    def _name_of(self, pair: int) -> str:
        """The wall of a pair plus 1, and the other arm that it is; 0: ""."""
        if not pair or self._limits is None:
            return ""
        place = (pair - 1) // self._limits.s
        for row in self._neighbours.rows:
            if row.places.start <= place < row.places.stop:
                return f"{row.wall.name}: {row.other.name}{row.late}"
        return self._kept[place].wall.name

    # commands

    def _too_slow(self) -> str:
        """Why walls cannot be kept here: numpy takes up to 0.1 s, in which the arm would count as stalled."""
        lacks = native().library is None and not self._simulated
        return f"walls in real time need the native library: {native().why}" if lacks else ""

    def _has_frame(self, wall: Wall) -> bool:
        """Whether there is the frame that a wall is given in."""
        try:
            self._neighbours.of(wall)
        except ValueError:
            return False
        return True

    def add(self, request: Request) -> None:
        """A wall from now on, see `wall_of`."""
        wall = wall_of(request.text, request.values)
        if not self._has_frame(wall) or len(wall.frame.encode()) > MAX_FRAME:
            raise CommandRefused(f"{wall.frame}: allowed are {', '.join(WORDS)}, and the name of another PSM or ECM")
        names = {*self.names, *(each.name for each in self._arm.walls)}  # those of the file come back
        if wall.name in names:
            raise CommandRefused(f"there is a wall {wall.name}, here or in the system file; take another name")
        if len(names) >= MOST:
            raise CommandRefused(f"{MOST} walls are the most, with all of the system file")
        if why := objection_to(wall, self._arm.type) or self._too_slow():
            raise CommandRefused(why)
        self._kept.append(KeptWall(wall, pose_of(wall), by_command=True))
        self._is_arranged = False

    def remove(self, request: Request) -> None:
        """Without the wall of this name."""
        name = request.text.strip()
        there = [kept for kept in self._kept if kept.wall.name != name]
        if len(there) == len(self._kept):
            raise CommandRefused(f"no wall {name}; there are: {', '.join(self.names) or 'none'}")
        self._kept, self._is_arranged = there, False
        self.forget()

    def answer_later(self, request: Request) -> str:
        """A change is answered when the record that outlives this process has it."""
        self._unanswered.append(request)
        return ANSWERED

    def answer(self) -> None:
        """The record is published."""
        for request in self._unanswered:
            request.done()
        self._unanswered.clear()

    # the record

    def show(self, here: Array, now_ns: int) -> bool:
        """Fill the record for the setpoint `here` (size,); returns whether it is to be published."""
        field, limits = self._field, self._limits
        if field is None or (not self.is_news and (not self._kept or now_ns - self._shown_ns < SHOWN_NS)):
            return False
        self._shown_ns = now_ns
        self._follow()
        self._report_unknown()
        self._report_gone()
        least: Array = np.full(MOST, math.nan)
        if limits is not None:
            limits.goal[...] = here[: self._count]
            limits.look()
            of_each = limits.value.min(axis=1)
            least = of_each[:MOST]
            for place, kept in enumerate(self._kept):
                if kept.wall.shape == ARMS:
                    least[place] = min((of_each[row.places].min(initial=math.inf) for row in kept.others),
                                       default=math.inf)
        shown = (self.stopped_by, least.tobytes())
        if not self.is_news and shown == self._shown:
            return False
        self._shown = shown
        field("stopped_by")[...] = self.stopped_by.encode()
        active = np.array([kept.active for kept in self._kept] + [False] * (MOST - len(self._kept)))
        field("distance")[...] = np.where(active & np.isfinite(least), least, math.nan)
        if self.is_news:
            self.is_news = False
            self._show_all(field)
        return True

    def _show_all(self, field: Fields) -> None:
        field("count")[...] = len(self._kept)
        for name in ("name", "shape", "keep", "of", "frame", "pose", "size", "margin", "by_command", "active"):
            field(name)[...] = np.zeros_like(field(name))
        for place, kept in enumerate(self._kept):
            wall = kept.wall
            for name in ("name", "shape", "keep", "of", "frame"):
                field(name)[place] = getattr(wall, name).encode()
            pose_from_matrix(kept.pose, field("pose")[place])
            field("size")[place, : len(wall.size)] = wall.size
            field("margin")[place] = wall.margin
            field("by_command")[place], field("active")[place] = kept.by_command, kept.active


def _added_before(field: Fields, arm: ArmConfig) -> list[KeptWall]:
    """Walls that commands added, from the record of the previous process; none if there was none."""
    return [KeptWall(row.wall, pose_of(row.wall), by_command=True) for row in recorded_walls(field)
            if row.by_command and not objection_to(row.wall, arm.type)]
