"""Which solver belongs to which arm."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from procs.lib.document import Chain, Tool
from procs.lib.inverse.endoscope import EndoscopeInverse
from procs.lib.inverse.master import Master
from procs.lib.inverse.snake import Snake
from procs.lib.inverse.solver import Inverse
from procs.lib.inverse.wrist import Wrist
from procs.lib.kinematics import Kinematics

Array = NDArray[np.float64]

ECM_JOINTS, PSM_JOINTS, MTM_JOINTS, SNAKE_JOINTS = 4, 6, 7, 8
BENDS: Final = np.eye(SNAKE_JOINTS)[:, :PSM_JOINTS]  # the last two joints bend as the two before them, in reverse
BENDS[7, 4] = BENDS[6, 5] = 1.0


def inverse_of(arm_type: str, chain: Chain, tool: Tool | None = None, tip: Array | None = None) -> Inverse:
    """The solver of a PSM (with its tool), ECM (with its endoscope's `tip` (4, 4)) or MTM.

    ValueError for arms or chains that none of them fits.
    """
    joints = len(chain.links) + (len(tool.links) if tool is not None else 0)
    if arm_type == "PSM" and tool is not None and joints == PSM_JOINTS:
        return Inverse(Kinematics(chain, tool), Wrist(chain, tool))
    if arm_type == "PSM" and tool is not None and tool.snake and joints == SNAKE_JOINTS:
        return Inverse(Kinematics(chain, tool), Snake(chain, tool), free=BENDS)
    if arm_type == "ECM" and tool is None and joints == ECM_JOINTS:
        return EndoscopeInverse(chain, np.eye(4) if tip is None else tip)
    if arm_type == "MTM" and tool is None and joints == MTM_JOINTS:
        return Inverse(Kinematics(chain), Master(chain))
    raise ValueError(f"{chain.source or 'chain'}: no inverse kinematics for {arm_type} of {joints} joints")
