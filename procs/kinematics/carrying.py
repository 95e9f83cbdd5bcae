"""The chain of an arm with what it carries."""

from __future__ import annotations

from procs.arm_types import ARM_TYPES
from procs.document.arms import ArmConfig
from procs.kinematics.endoscopes import NAMES, NONE, endoscope
from procs.kinematics.forward import Kinematics


def carrying(arm: ArmConfig, carried: str) -> Kinematics:
    """From its base to its tip; without an instrument that we know, to where one would be."""
    if ARM_TYPES[arm.type].has_endoscope:
        return Kinematics(arm.chain, tip=endoscope(carried if carried in NAMES else NONE).tip)
    tools = (*arm.tools, *((arm.tool,) if arm.tool is not None else ()))
    return Kinematics(arm.chain, next((tool for tool in tools if carried and tool.name == carried), None))
