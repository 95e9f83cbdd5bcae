"""Selection of the solver for an arm and its instrument or endoscope."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, cast

import numpy as np

from trocar.procs.document.arms import ArmConfig
from trocar.procs.document.system import Chain, Tool
from trocar.procs.kinematics.endoscopes import NAMES, NONE, endoscope
from trocar.procs.kinematics.forward import Kinematics
from trocar.procs.kinematics.inverse.endoscope import EndoscopeInverse
from trocar.procs.kinematics.inverse.master import MasterInverse
from trocar.procs.kinematics.inverse.snake import Snake
from trocar.procs.kinematics.inverse.solver import InverseSolver
from trocar.procs.kinematics.inverse.wrist import Wrist
from trocar.procs.kinematics.poses import Array
from trocar.procs.tables.arm_types import ARM_TYPES, found

ECM_JOINTS, PSM_JOINTS, MTM_JOINTS, SNAKE_JOINTS = 4, 6, 7, 8
BENDS: Final = np.eye(SNAKE_JOINTS)[:, :PSM_JOINTS]  # the last two joints bend like those before, in reverse order
BENDS[7, 4] = BENDS[6, 5] = 1.0
Solvers = Callable[[Chain, Tool | None, Array | None], InverseSolver | None]
"""Makes the solver for a chain, its tool and its tip, as named in the table of arm types; None: not suitable."""


def inverse_of(arm_type: str, chain: Chain, tool: Tool | None = None, tip: Array | None = None) -> InverseSolver:
    """The solver of an arm type: for a PSM with its tool, for an ECM with its endoscope's `tip` (4, 4).

    ValueError for arms or chains without a suitable solver.
    """
    row = ARM_TYPES.get(arm_type)
    make = cast(Solvers, found(row.inverse)) if row is not None and row.inverse else None
    solver = make(chain, tool, tip) if make is not None else None
    if solver is None:
        raise ValueError(f"{chain.source or 'chain'}: no inverse kinematics for {arm_type} of "
                         f"{_joints(chain, tool)} joints")
    return solver


def instrument_inverse(chain: Chain, tool: Tool | None, tip: Array | None) -> InverseSolver | None:
    """The solver of a PSM with an instrument."""
    if tool is not None and _joints(chain, tool) == PSM_JOINTS:
        return InverseSolver(Kinematics(chain, tool), Wrist(chain, tool))
    if tool is not None and tool.snake and _joints(chain, tool) == SNAKE_JOINTS:
        return InverseSolver(Kinematics(chain, tool), Snake(chain, tool), free=BENDS)
    return None


def endoscope_inverse(chain: Chain, tool: Tool | None, tip: Array | None) -> InverseSolver | None:
    """The solver of an ECM."""
    fits = tool is None and _joints(chain, tool) == ECM_JOINTS
    return EndoscopeInverse(chain, np.eye(4) if tip is None else tip) if fits else None


def master_inverse(chain: Chain, tool: Tool | None, tip: Array | None) -> InverseSolver | None:
    """The solver of an MTM."""
    fits = tool is None and _joints(chain, tool) == MTM_JOINTS
    return MasterInverse(chain) if fits else None


def _joints(chain: Chain, tool: Tool | None) -> int:
    return len(chain.links) + (len(tool.links) if tool is not None else 0)


def carrying(arm: ArmConfig, carried: str) -> Kinematics:
    """Kinematics from the arm's base to its tip; without a known instrument, to the instrument's place."""
    if ARM_TYPES[arm.type].has_endoscope:
        return Kinematics(arm.chain, tip=_tip(carried))
    return Kinematics(arm.chain, _tool(arm, carried))


def inverse_carrying(arm: ArmConfig, carried: str) -> InverseSolver:
    """The solver for a pose of that tip, as the arm itself uses it; ValueError if the tip is unknown."""
    if ARM_TYPES[arm.type].has_endoscope:
        return inverse_of(arm.type, arm.chain, tip=_tip(carried))
    return inverse_of(arm.type, arm.chain, _tool(arm, carried))


def _tip(carried: str) -> Array:
    """The tip of an endoscope (4, 4)."""
    return endoscope(carried if carried in NAMES else NONE).tip


def _tool(arm: ArmConfig, carried: str) -> Tool | None:
    tools = (*arm.tools, *((arm.tool,) if arm.tool is not None else ()))
    return next((tool for tool in tools if carried and tool.name == carried), None)
