"""Arms with `"simulation": "KINEMATIC"`: the robots that the process `io` plays for them, made from their chains.

There is no board, no motor and no gain: actuators go where their setpoints are. What is left of a robot is how many
actuators it has and how far they may go. The first ones are those of the chain, through its coupling where it has one;
what an instrument turns (the rest of a PSM's) goes as far as the discs of a PSM do.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from trocar.procs.config.loading.context import Context
from trocar.procs.config.read.source import SourceFile
from trocar.procs.document import system as document

KINEMATIC: Final = "KINEMATIC"
KINEMATIC_IO: Final = "io"  # the process that plays them all
DISC_RANGE: Final = math.radians(172.0)


def kinematic_robot(
    context: Context, source: SourceFile, name: str, place: int, chain: document.Chain, actuators: int
) -> tuple[document.Robot, document.PidConfig] | None:
    """The robot of the arm `name`, and a joint controller without gains; None with an error in its arm file `source`.

    `place` is that of the arm in the system: what has no board gets a number below 0, so that no two share one.
    """
    links = chain.links[:actuators]
    if chain.actuator_to_joint is not None and len(links) != len(chain.actuator_to_joint):
        allowed = f"{actuators} rows"
        context.error(source, ("kinematic",), f"chain of {len(chain.links)} rows for {actuators} actuators", allowed)
        return None
    discs = range(actuators - len(links))
    names = [link.name or f"joint_{place + 1}" for place, link in enumerate(links)]
    names += [f"disc_{place + 1}" for place in discs]
    types = [link.joint_type.upper() for link in links] + ["REVOLUTE" for _ in discs]
    ranges = _ranges(chain, links) + [(-DISC_RANGE, DISC_RANGE) for _ in discs]
    nothing = document.Linear()
    rows = tuple(
        document.Actuator(
            board_id=-1 - place,
            axis_id=axis,
            joint_type=joint_type,
            effort_to_current=0.0,
            current_to_bits=nothing,
            bits_to_current=nothing,
            maximum_current=0.0,
            encoder=document.Encoder(nothing, lower, upper, "SOFTWARE"),
        )
        for axis, (joint_type, (lower, upper)) in enumerate(zip(types, ranges, strict=True))
    )
    gains = tuple(document.PidAxis(*row, 0.0, 0.0, 0.0) for row in zip(names, types, strict=True))
    robot = document.Robot(name, "", KINEMATIC, rows, "NONE", source=str(source.path))
    return robot, document.PidConfig(name, name, gains)


def _ranges(chain: document.Chain, links: Sequence[document.DhLink]) -> list[tuple[float, float]]:
    """How far the actuators of the chain go: the box around all positions within the joint limits."""
    limits = np.array([(link.lower, link.upper) for link in links])
    if chain.actuator_to_joint is not None:
        parts = np.linalg.inv(np.array(chain.actuator_to_joint))[:, :, None] * limits
        limits = np.stack((parts.min(axis=2).sum(axis=1), parts.max(axis=2).sum(axis=1)), axis=1)
    return [(float(lower), float(upper)) for lower, upper in limits]
