"""Joints of all arms within their ranges: measured, setpoint, and the goal of a move that is under way."""

from __future__ import annotations

import contextlib
from typing import Any, Final

import numpy as np

from trocar.procs.crtk.plain import plain
from trocar.procs.document.arms import ArmConfig
from trocar.procs.document.system import SystemConfig
from trocar.procs.kinematics.inverse.arms import carrying
from trocar.shm.commands import COMMANDS
from trocar.shm.mailbox.command_row import SETTING
from trocar.shm.memory.segment import SegmentError
from trocar.shm.system import directory

LATE_NS: Final = 1_000_000_000
DIGITS: Final = 4
"""Of rad and m: finer than a bar shows."""
MOVES: Final = frozenset({b"move_jp"})
"""Commands whose values are the goal, in joints."""
MOVELESS: Final = frozenset(row.name.encode() for row in COMMANDS["arm"] if row.effect <= SETTING)
"""Commands that leave a move as it is; all others end it, with its goal."""
CARRIED_OUT: Final = frozenset({b"accepted", b"done"})
TRAJECTORY: Final = 2
"""`control_mode` of a move."""


class LimitsArm:
    """One arm."""

    def __init__(self, document: SystemConfig, arm: ArmConfig) -> None:
        """Attach; SegmentError when its records cannot be read."""
        self._arm = arm
        self._reader = directory.reader(document.name, arm.name, "state", "arm", often=False)
        self._audit = directory.reader(document.name, arm.name, "audit", often=False)
        self._cells = {name: self._reader.field(name) for name in (
            "position", "setpoint_position", "count", "tool", "valid", "control_mode", "names")}
        self._tool, self._kinematics = "", carrying(arm, arm.endoscope)
        self._sequence, self._seen_ns = 0, 0
        self._goal: list[float] = []
        self._moved = False
        while self._audit.next():
            self._note()

    def read(self, now_ns: int) -> dict[str, Any]:
        """`lower`, `upper`, `q` (measured), `setpoint`, and `goal`, which is empty while there is no move."""
        while self._audit.next():
            self._note()
        if not self._reader.newest():
            return {"names": [], "late": True}
        if self._reader.sequence != self._sequence:
            self._sequence, self._seen_ns = self._reader.sequence, now_ns
        cells = self._cells
        tool = cells["tool"].item().decode(errors="replace") or self._arm.endoscope
        if tool != self._tool:
            self._tool, self._kinematics = tool, carrying(self._arm, tool)
        kinematics, n = self._kinematics, min(self._kinematics.n, int(cells["count"]))
        moves = int(cells["control_mode"]) == TRAJECTORY and len(self._goal) == n
        self._goal = self._goal if moves or not self._moved else []  # it has ended: another one has another goal
        self._moved = moves
        return {"names": plain(cells["names"][:n]), "slides": plain(np.array(kinematics.is_prismatic, bool)[:n]),
                "lower": plain(kinematics.lower[:n]), "upper": plain(kinematics.upper[:n]),
                "q": plain(np.round(cells["position"][:n], DIGITS)),
                "setpoint": plain(np.round(cells["setpoint_position"][:n], DIGITS)),
                "goal": self._goal if moves else [], "valid": bool(cells["valid"]),
                "late": now_ns - self._seen_ns > LATE_NS}

    def _note(self) -> None:
        """The goal of a move that was accepted, until it is done, or another command is."""
        field = self._audit.field
        command, outcome = field("command").item(), field("outcome").item()
        if outcome in CARRIED_OUT and command not in MOVELESS:
            is_begin = command in MOVES and outcome == b"accepted"
            self._goal = [round(float(v), DIGITS) for v in field("values")[:int(field("count"))]] if is_begin else []

    def close(self) -> None:
        """Unmap."""
        self._reader.close()
        self._audit.close()


class LimitsSource:
    """All arms."""

    def __init__(self, document: SystemConfig) -> None:
        self._arms: dict[str, LimitsArm] = {}
        for arm in document.arms:
            with contextlib.suppress(SegmentError):
                self._arms[arm.name] = LimitsArm(document, arm)

    def read(self, now_ns: int) -> dict[str, Any]:
        """`arms` by name."""
        return {"age": 0.0, "arms": {name: arm.read(now_ns) for name, arm in self._arms.items()}}

    def close(self) -> None:
        """Unmap."""
        for arm in self._arms.values():
            arm.close()
