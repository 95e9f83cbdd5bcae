"""Joints for a stream of goals of the tip; for an unreachable goal, as near to it as the limits allow, without a jump.

Surgeons often work at limits, so limits do not stop a stream. The joints then differ from the goal's, and the answer to
the command gives the reason; the joints go there, and back, at a bounded velocity. Goals that begin at the tip and
follow each other closely are accepted; a distant goal counts as a jump, like one that the joints cannot reach in time
(procs/arm/governor.py).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

import numpy as np

from trocar.procs.arm.control import Control
from trocar.procs.arm.near import FURTHEST_TURN, Near
from trocar.procs.kinematics.inverse.solver import InverseSolver
from trocar.procs.kinematics.poses import Array, rotation_vector
from trocar.procs.node.requests import CommandRefused

Guard = Callable[[Array, Array], None]
"""Changes the joints (count,) found for a goal, in place, if it is not safe to go there from the second argument."""

QUICKEST: Final = math.pi  # rad/s at and from a limit, if the joint is that fast
BREAK_NS: Final = 30_000_000  # a goal after a longer gap begins a new stream, and may be reached at once
HELD_UP_NS: Final = 1_000_000_000  # but within this time a delayed stream continues on its way from a limit
FIRST_STEP_NS: Final = 5_000_000
FURTHEST: Final = 0.05  # m
SAME: Final = 1e-6  # rad or m
MIN_NS: Final = 1_000


class Reach:
    """Remembers whether the stream is at a limit, or on its way back from one."""

    def __init__(self, control: Control, guard: Guard | None) -> None:
        self._control, self._guard = control, guard
        self._served_ns = -BREAK_NS
        self._is_limited = False
        self._kept: Array = np.zeros(0)  # the joints after the last limited goal
        self._wanted: Array = np.eye(4)  # that goal
        self._near: Near | None = None

    def is_near(self, pose: Array, is_local: bool) -> bool:
        """Whether a pose (7,) of a command is near and within reach, as usual: then `goal` has its joints.

        Otherwise `find` decides.
        """
        control, inverse, near = self._control, self._control.joints.inverse, self._near
        at = control.take_goal()
        if near is None or near.solver is not inverse:
            if inverse is None or not inverse.is_direct:
                return False
            near = self._near = Near(inverse, control.cartesian, at[: control.joints.count])
        if self._is_limited or not near.find(pose, is_local) or self._keep_safe(near.joints, near.at):
            return False
        self._served_ns = control.now_ns
        near.at[...] = near.joints
        return True

    def find(self, name: str, inverse: InverseSolver, goal: Array, at: Array) -> tuple[Array, str]:
        """Joints (count,) for a goal (4, 4) in the arm's base, from the present `at`; and why they differ from the
        goal's, or "".

        CommandRefused if the goal of a command `name` is unreachable and far away.
        """
        passed_ns = self._control.now_ns - self._served_ns
        begins = passed_ns >= BREAK_NS and not (passed_ns < HELD_UP_NS and self._is_left_at(at))
        if begins:
            self._is_limited, passed_ns = False, FIRST_STEP_NS
        passed_ns = min(passed_ns, BREAK_NS)
        self._served_ns = self._control.now_ns
        found, why = inverse.q, self._unreachable(inverse, goal, at)
        if why:
            far = _far(self._wanted if self._is_limited else inverse.kinematics.fk(at, np.eye(4)), goal)
            if far:
                raise self._control.jump(name, f"{why}, and the tip is asked to {far}",
                                         "begin at the tip (setpoint_cp)")
            self._is_limited = True
            inverse.approach(goal, at, self._most(len(at), passed_ns))
        why = self._keep_safe(found, at) or why
        if not self._is_limited and (begins or not why):
            return found, why
        change = found - at
        too_far = float((np.abs(change) / self._most(len(at), passed_ns)).max())
        self._is_limited = bool(why) or too_far > 1.0
        if too_far > 1.0:
            found[...] = at + change / too_far
        if self._is_limited:
            self._kept, self._wanted = found.copy(), goal.copy()
        return found, why or ("returning from the limit" if self._is_limited else "")

    def _is_left_at(self, at: Array) -> bool:
        """Whether the stream was limited and the joints have not moved otherwise since."""
        return bool(self._is_limited and len(at) == len(self._kept) and np.abs(at - self._kept).max() <= SAME)

    def _most(self, count: int, passed_ns: int) -> Array:
        """Largest motion of each joint in that time."""
        return np.minimum(self._control.joints.v_max[:count], QUICKEST) * (max(passed_ns, MIN_NS) * 1e-9)

    def _unreachable(self, inverse: InverseSolver, goal: Array, at: Array) -> str:
        """Why the joints of the goal cannot be reached from here, "": they are in `inverse.q`."""
        if not inverse.solve(goal, at):
            return inverse.reason
        turns = [abs(x) for x in (inverse.q - at).tolist()]  # a prismatic joint never moves this many m
        most = max(turns)
        if most <= FURTHEST_TURN:
            return ""
        return f"{inverse.kinematics.names[turns.index(most)]} would have to turn {math.degrees(most):.0f}° in one step"

    def _keep_safe(self, found: Array, at: Array) -> str:
        """Keep out of the cannula."""
        if self._guard is None:
            return ""
        wanted = found.tobytes()
        try:
            self._guard(found, at)
        except CommandRefused as reason:
            found[...] = at
            return str(reason)
        return "" if found.tobytes() == wanted else "it would bend in the cannula"


def _far(before: Array, goal: Array) -> str:
    """How much too far it is from one pose (4, 4) to another; "": it is not."""
    way = float(np.linalg.norm(goal[:3, 3] - before[:3, 3]))
    if way > FURTHEST:
        return f"go {way * 1e3:.0f} mm at once; {FURTHEST * 1e3:.0f} mm is allowed"
    turn = float(np.linalg.norm(rotation_vector(before[:3, :3].T @ goal[:3, :3])))
    if turn > FURTHEST_TURN:
        return f"turn by {math.degrees(turn):.0f}° at once; {math.degrees(FURTHEST_TURN):.0f}° is allowed"
    return ""
