"""An environment's prior knowledge of an arm: chain and limits, start poses, workspace of its tip."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Final

import numpy as np

from trocar.procs.arm.joints import JointSpace, joints
from trocar.procs.document.arms import ArmConfig
from trocar.procs.kinematics.poses import Array
from trocar.procs.tables.arm_types import ARM_TYPES

ROOM_M: Final = 0.05
"""Maximum distance of a tip's goal from the tip at the centre: no policy leads it further."""
STARTS: Final = 8
"""Start poses of episodes; the first is the centre."""
SPREAD: Final = (0.15, 0.15, 0.015, 0.3)
"""Maximum distances of the starts from the centre: yaw, pitch (rad), insertion (m), every further joint (rad)."""
INSERTION: Final = 2
SEED: Final = 23  # of the starts, which are the same in every environment


@dataclass(frozen=True, slots=True)
class StartPose:
    """Start pose of an arm: joints (count,) in rad and m, its jaw in rad (0 without a jaw)."""

    joints: Array
    jaw: float


class ArmModel:
    """One arm with its tool. Poses here are (4, 4), in the frame of `base` unless they are called local."""

    def __init__(self, arm: ArmConfig, carried: str, base: Array, jaw: float = 0.0) -> None:
        """`carried` is its instrument or endoscope, `base` (4, 4) its base in the frame of its poses.

        `jaw`: that of all starts, rad. ValueError if its tool has no tip.
        """
        self.name, self.type = arm.name, arm.type
        if ARM_TYPES[arm.type].has_endoscope:
            space = joints(dataclasses.replace(arm, endoscope=carried))
        else:
            tools = (*arm.tools, *((arm.tool,) if arm.tool is not None else ()))
            space = joints(arm, next((tool for tool in tools if carried and tool.name == carried), None))
        if space.kinematics is None or space.inverse is None:
            raise ValueError(f"{arm.name}: {space.lacks_inverse}; it carries {carried or 'nothing'}")
        self.space: JointSpace = space
        self.kinematics, self.inverse = space.kinematics, space.inverse
        self.count, self.has_jaw = space.count, space.has_jaw
        self.carried, self.base = carried, base
        self.v_max = space.v_max
        home = ARM_TYPES[arm.type].kinematic_home
        self.centre = np.zeros(self.count)
        self.centre[: min(self.count, len(home))] = home[: self.count]
        self.middle: Array = self.tip(self.centre)[:3, 3].copy()
        """Position of the tip at the centre (3,), m."""
        self.jaw = jaw

    def vector(self, at: Array, jaw: float) -> Array:
        """Joints (count,) and the jaw, if there is one, in one vector."""
        return np.append(at, jaw) if self.has_jaw else np.array(at)

    def tip(self, at: Array) -> Array:
        """The tip at joints (count,)."""
        return self.base @ self.local_tip(at)

    def local_tip(self, at: Array) -> Array:
        """The same in the arm's base."""
        return self.kinematics.fk(at, np.eye(4))

    def starts(self, count: int = STARTS) -> list[StartPose]:
        """Start poses, the centre first; the same at every call."""
        rng, spread = np.random.default_rng(SEED), np.full(self.count, SPREAD[-1])
        spread[: len(SPREAD) - 1] = SPREAD[:-1]
        offsets = rng.uniform(-1.0, 1.0, (count, self.count)) * spread
        offsets[0] = 0.0
        return [StartPose(np.clip(self.centre + offset, self.space.lower[: self.count],
                                  self.space.upper[: self.count]), self.jaw) for offset in offsets]
