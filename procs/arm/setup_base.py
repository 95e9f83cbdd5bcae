"""The arm's base frame from the setup joints: their newest record, as long as it is fresh.

A record that is too old is ignored: setup joints whose process has died may have been moved since.
"""

from __future__ import annotations

import math
from collections import deque
from typing import Any, Final

import numpy as np

from trocar.procs.kinematics.poses import Array, PoseError, matrix_from_pose, unit_quaternion
from trocar.procs.node.inputs import Input

STEP_NS: Final = 30_000_000
MAX_STEP: Final = 0.005  # m
MAX_TURN: Final = 0.1  # rad


class BaseSteps:
    """Motion of a base frame within 30 ms: a camera moves it smoothly, a program sets it in steps."""

    def __init__(self) -> None:
        self._past: deque[tuple[int, Array]] = deque()

    def step(self, base: Array | None, now_ns: int) -> str:
        """Set the base to (4, 4), None: unknown. Returns why that is a step that ends streams, or ""."""
        if base is None:
            return ""
        past = self._past
        while len(past) > 1 and past[1][0] <= now_ns - STEP_NS:
            past.popleft()
        why = next(filter(None, (_step(before, base) for _, before in (past[0], past[-1]))), "") if past else ""
        past.append((now_ns, base.copy()))
        return why


def _step(before: Array, now: Array) -> str:
    far = float(np.linalg.norm(now[:3, 3] - before[:3, 3]))
    turn = math.acos(min(1.0, max(-1.0, 0.5 * (float((before[:3, :3] * now[:3, :3]).sum()) - 1.0))))
    if far <= MAX_STEP and turn <= MAX_TURN:
        return ""
    return f"the base frame moved by {far * 1e3:.1f} mm and {math.degrees(turn):.1f}° in one step"


class SetupBase:
    """The base frame of one arm. After `update`: `base` (4, 4), None while it is unknown, and its `frame`."""

    def __init__(self, record: Input, place: int) -> None:
        """`place` is the index of the setup arm in the record."""
        self._record = record
        self._valid = record.field("base_valid")[place : place + 1].reshape(())
        self._frame = record.field("reference_frame")[place : place + 1].reshape(())
        self._pose: Array = record.field("measured_cp")[place]
        self._kept: list[float] = []  # comparison in Python takes a tenth of numpy's time
        self._kept_frame = b""
        self._good = False
        self.base: Array | None = None
        self.frame = ""

    def update(self, now_ns: int) -> bool:
        """Read the newest record; True when `base` or `frame` have changed."""
        if self._record.look(now_ns):
            self._good = bool(self._valid.item())
        if not (self._good and self._record.fresh):
            return self._forget()
        if not self._record.whole:  # torn: the previous one stays in force, and ages
            return False
        if self.base is not None and self._frame.item() == self._kept_frame and self._pose.tolist() == self._kept:
            return False
        return self._take()

    def _forget(self) -> bool:
        changed = self.base is not None
        self.base, self.frame = None, ""
        return changed

    def _take(self) -> bool:
        """Accept the record's pose if it is valid."""
        pose, frame = self._pose.copy(), bytes(self._frame.item())
        try:
            pose[3:] = unit_quaternion(pose[3:])
        except PoseError:
            return self._forget()
        if not np.isfinite(pose).all():
            return self._forget()
        self._kept, self._kept_frame = self._pose.tolist(), frame
        self.base, self.frame = matrix_from_pose(pose), frame.decode(errors="replace")
        return True


def place_of(info: dict[str, Any], name: str) -> int:
    """The index of a setup arm in its process's record, from the header's info; ValueError lists the existing ones."""
    known = list(info.get("setups", {}))
    if name not in known:
        raise ValueError(f"no setup arm {name}; there are {', '.join(known) or 'none'}")
    return known.index(name)
