"""Another arm, as this one has to know it: its instrument, its base frame, and where io measures its joints.

All of it stays known when the other arm's process dies: its last record has instrument and base frame, and io still
measures the joints.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Final, Protocol

import numpy as np

from trocar.procs.arm.joints import JointSpace, body_of, joints
from trocar.procs.arm.psm.attachment import AttachmentState
from trocar.procs.arm.setup_base import SetupBase
from trocar.procs.document.system import ArmConfig, Tool
from trocar.procs.kinematics.poses import Array, matrix_from_pose, normalised
from trocar.procs.kinematics.walls.body import THICK, ArmBody
from trocar.procs.node.inputs import Fields, Input
from trocar.procs.tables.arm_types import ARM_TYPES, base_name

LOOK_NS: Final = 10_000_000
"""Instruments, and base frames that commands set, change rarely."""


class MeasuredBy(Protocol):
    """The record of an io, as it was read in this cycle."""

    stamp_ns: int

    @property
    def field(self) -> Fields:
        """Gives the arrays of its fields."""


class OtherArm:
    """One other arm. `changes` counts those of its instrument and its base frame.

    `space` is the joint space with its instrument, None: it has none, and so no body. Of an unknown instrument it is
    that of the longest one, whose wrist is straight. `base` (4, 4) is the pose of its base in the frame named `frame`,
    None: unknown.
    """

    def __init__(self, arm: ArmConfig, record: Input, io: MeasuredBy, robot: int, first_axis: int,
                 setup: SetupBase | None = None) -> None:
        """`record` is its state; `io` measures it as the robot with this index, whose first axis is `first_axis`."""
        self.arm, self.name, self.local_frame = arm, arm.name, base_name(arm.name)
        self._record, self.io, self._setup = record, io, setup
        axes = slice(first_axis, first_axis + ARM_TYPES[arm.type].actuators)
        self.position = io.field("position")[axes]
        self.biased, self.age_ns = (io.field(name)[robot : robot + 1] for name in ("biased", "sample_age_ns"))
        self._shown = [record.field(name) for name in ("tool", "instrument", "reference_frame", "base_frame")]
        self._valid = [record.field(name) for name in ("cartesian_valid", "reference_valid")]
        self._seen = list[bytes]()
        self._knows_base = self._knew_base = True
        self._looked_ns = -LOOK_NS
        self.changes = 0
        self.space: JointSpace | None = None
        self.body: ArmBody | None = None
        self.to_joint: Array = np.zeros((0, 0))
        self.frame = ""
        self.base: Array | None = None
        self.is_known = False
        """Its instrument, or endoscope, is known."""
        self._tool: str | None = None
        self._carry(None if ARM_TYPES[arm.type].has_endoscope else _longest(arm), is_known=False)

    def look(self, now_ns: int) -> bool:
        """Read the newest record of the setup joints that carry it and, after LOOK_NS, that of its state.

        Returns whether anything has changed.
        """
        before = self.changes
        if self._setup is not None and self._setup.update(now_ns):
            self.frame, self.base = self._setup.frame, self._setup.base
            self.changes += 1
        if now_ns - self._looked_ns >= LOOK_NS and self._record.look(now_ns):
            self._looked_ns = now_ns
            if self._valid[0].item():
                self._knows_base = bool(self._valid[1].item())
            seen = [cell.tobytes() for cell in self._shown]
            if seen != self._seen or self._knows_base is not self._knew_base:
                self._seen, self._knew_base = seen, self._knows_base
                self._take()
        return self.changes != before

    def measured_ns(self) -> int:
        """When its joints were measured; 0: they are not known."""
        age_ns, stamp_ns = self.age_ns.item(), self.io.stamp_ns
        return stamp_ns - age_ns if stamp_ns > 0 and age_ns >= 0 and self.biased.item() else 0

    def _take(self) -> None:
        """The instrument, or the base frame, has changed."""
        tool, frame = (bytes(self._shown[i].item()).rstrip(b"\0").decode(errors="replace") for i in (0, 2))
        self.changes += 1
        if self._setup is None:
            self.frame, self.base = frame, _base_of(self._shown[3]) if self._knows_base else None
        if not ARM_TYPES[self.arm.type].has_endoscope:
            absent = self._shown[1].item() == AttachmentState.ABSENT
            self._carry_named("" if absent else tool or "?")

    def _carry_named(self, name: str) -> None:
        if name == self._tool:
            return
        self._tool = name
        longest = self._shown[0].dtype.itemsize
        tools = {tool.name.encode()[:longest].decode(errors="replace"): tool for tool in _tools(self.arm)}
        if not name:
            self.space, self.body, self.is_known = None, None, True
        else:
            self._carry(tools.get(name) or _longest(self.arm), is_known=name in tools)

    def _carry(self, tool: Tool | None, *, is_known: bool) -> None:
        arm = self.arm
        self.is_known = is_known or ARM_TYPES[arm.type].has_endoscope
        self.space = joints(arm, tool)
        if self.space.kinematics is None:  # no instrument is known at all
            self.space = self.body = None
            return
        self.body = body_of(arm, self.space)
        self.to_joint = self.space.to_joint[: self.space.count].copy()
        if not self.is_known:
            self.to_joint[ARM_TYPES[arm.type].joints :] = 0.0
            self.body.radius[:] = np.where(self.body.solid, THICK, 0.0)


def _tools(arm: ArmConfig) -> Iterable[Tool]:
    return arm.tools if arm.tool is None else (*arm.tools, arm.tool)


def _longest(arm: ArmConfig) -> Tool | None:
    """The longest of all instruments of an arm."""

    def length(tool: Tool) -> float:
        tip = math.hypot(*(row[3] for row in tool.tip[:3]))
        return sum(abs(link.a) + abs(link.d) for link in tool.links) + tip

    return max(_tools(arm), key=length, default=None)


def _base_of(pose: Array) -> Array | None:
    try:
        return matrix_from_pose(normalised(pose))
    except ValueError:
        return None
