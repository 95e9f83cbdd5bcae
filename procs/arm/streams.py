"""Whether the next goal of a stream may be gone to at once: who sent it may have been held up, and be far on.

A goal that comes within 0.1 s of the one before belongs to a stream and is followed as it is. Any other one, the first
of a stream or the first after a gap, is followed if a joint at its largest velocity (that of moves at ratio 1, whatever
the ratio: it is about moves) could have come from the setpoint in the time since the last goal, 0.1 s at most: a
longer gap is no licence to go further. After a refusal that time is the stream's own period, so that its goals stay
refused until they are where the arm is.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from procs.arm.joints import JointSpace
from procs.arm.motion import STREAM_NS

Array = NDArray[np.float64]

MIN_NS: Final = 5_000_000  # goals of one cycle, or of a stream that is quicker than the arm, may go so far


class Stream:
    """The goals for the arm's joints, or those for the jaw."""

    def __init__(self) -> None:
        self._asked_ns = -STREAM_NS

    def objection(self, joints: JointSpace, goal: Array, here: Array, now_ns: int, *, is_streamed: bool) -> str:
        """Why a goal (size,) is not followed from `here` (size,), "": it may be; `is_streamed`: see `Motion`."""
        passed_ns = min(max(now_ns - self._asked_ns, MIN_NS), STREAM_NS)
        self._asked_ns = now_ns
        if is_streamed:
            return ""
        excess = np.abs(goal - here) - joints.v_max * (passed_ns * 1e-9)
        axis = int(excess.argmax())
        if excess[axis] <= 0.0:
            return ""
        far, unit = abs(goal[axis] - here[axis]), joints.unit(axis)
        return (f"{joints.name(axis)} is {far:.3g} {unit} from the setpoint; where a stream begins, or after a gap in "
                f"it, {far - excess[axis]:.3g} {unit} is allowed: move there first (move_jp, move_cp)")
