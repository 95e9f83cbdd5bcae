"""The chain of an arm with what it carries."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from trocar.procs.document.arms import ArmConfig
from trocar.procs.document.system import Tool
from trocar.procs.kinematics.endoscopes import NAMES, NONE, endoscope
from trocar.procs.kinematics.forward import Kinematics
from trocar.procs.kinematics.inverse.arms import inverse_of
from trocar.procs.kinematics.inverse.solver import InverseSolver
from trocar.procs.tables.arm_types import ARM_TYPES


def carrying(arm: ArmConfig, carried: str) -> Kinematics:
    """From its base to its tip; without an instrument that we know, to where one would be."""
    if ARM_TYPES[arm.type].has_endoscope:
        return Kinematics(arm.chain, tip=_tip(carried))
    return Kinematics(arm.chain, _tool(arm, carried))


def inverse_carrying(arm: ArmConfig, carried: str) -> InverseSolver:
    """Finds joints for a pose of that tip, as the arm itself does; ValueError where no tip is known."""
    if ARM_TYPES[arm.type].has_endoscope:
        return inverse_of(arm.type, arm.chain, tip=_tip(carried))
    return inverse_of(arm.type, arm.chain, _tool(arm, carried))


def _tip(carried: str) -> NDArray[np.float64]:
    """Of an endoscope (4, 4)."""
    return endoscope(carried if carried in NAMES else NONE).tip


def _tool(arm: ArmConfig, carried: str) -> Tool | None:
    tools = (*arm.tools, *((arm.tool,) if arm.tool is not None else ()))
    return next((tool for tool in tools if carried and tool.name == carried), None)
