"""The joint space of a PSM: what its axes are called and may do, with an instrument or without one.

Without an instrument there are seven joints (three of the arm, four bare discs), no coupling, no tip and no jaw. With
one there are its six kinematic joints and the jaw, which comes last in every vector here: (7,) float64, rad and m.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from procs.lib.arm_limits import KINEMATIC_HOME
from procs.lib.coupling import Coupling, coupling
from procs.lib.document import Arm, Tool
from procs.lib.kinematics import Kinematics

Array = NDArray[np.float64]

AXES = 7
BARE_NAMES = ("yaw", "pitch", "insertion", "disc_1", "disc_2", "disc_3", "disc_4")
DISC_RANGE = math.radians(172.0)
ARM_JOINTS = 3  # joints of the arm itself, the ones an instrument does not change


@dataclass(frozen=True, slots=True)
class Joints:
    """`count` joints are published as the arm's; with an instrument the last of the seven is the jaw."""

    tool: str
    names: tuple[str, ...]
    count: int
    lower: Array
    upper: Array
    coupling: Coupling
    kinematics: Kinematics | None

    @property
    def has_jaw(self) -> bool:
        """An instrument with a jaw is on."""
        return self.count < AXES

    def clip(self, values: Array) -> NDArray[np.bool_]:
        """Bring `values` (7,) into the limits, in place; returns which ones were outside."""
        outside: NDArray[np.bool_] = (values < self.lower) | (values > self.upper)
        if outside.any():
            np.clip(values, self.lower, self.upper, out=values)
        return outside

    def name(self, axis: int) -> str:
        """What a person calls an axis."""
        return self.names[axis] if axis < self.count else "jaw"


def joints(arm: Arm, tool: Tool | None) -> Joints:
    """The joint space of `arm` with `tool`; ValueError when this version cannot drive it."""
    if tool is None:
        if len(arm.chain.links) < ARM_JOINTS:
            has = f"{arm.chain.source} has {len(arm.chain.links)} joints"
            raise ValueError(f"{arm.name}: {has}; a PSM has {ARM_JOINTS}")
        discs = AXES - ARM_JOINTS
        lower = np.array([link.lower for link in arm.chain.links[:ARM_JOINTS]] + [-DISC_RANGE] * discs)
        upper = np.array([link.upper for link in arm.chain.links[:ARM_JOINTS]] + [DISC_RANGE] * discs)
        return Joints("", BARE_NAMES, AXES, lower, upper, Coupling(np.eye(AXES)), None)
    if tool.snake:
        raise ValueError(f"{arm.name}: snake-like instruments ({tool.name}) are not available in this version")
    kinematics = Kinematics(arm.chain, tool)
    if kinematics.n != AXES - 1:
        raise ValueError(f"{arm.name}: with {tool.name} there are {kinematics.n} joints; {AXES - 1} were expected")
    return Joints(
        tool.name,
        kinematics.names,
        kinematics.n,
        np.append(kinematics.lower, tool.jaw.lower),
        np.append(kinematics.upper, tool.jaw.upper),
        coupling(AXES, arm.chain, tool),
        kinematics,
    )


def homing_goal(arm: Arm, setpoint: Array, has_jaw: bool) -> Array:
    """Where homing takes the joints (7,): nowhere, to zero where the arm's file asks; a KINEMATIC arm is inserted."""
    if arm.simulation != "NONE":
        return np.array(KINEMATIC_HOME[arm.type])
    return np.zeros(AXES) if arm.homing_zero_position and not has_jaw else setpoint.copy()


def find_tool(arm: Arm, name: str) -> Tool | None:
    """The instrument called `name` (NAME:MODEL or as its file is called) among those this arm knows."""
    wanted = name.replace(":", "_").upper()
    known = arm.tools + ((arm.tool,) if arm.tool is not None else ())
    return next((tool for tool in known if wanted and tool.name.replace(":", "_").upper() == wanted), None)
