"""Drawing of a robot and its task: balls, rods and boxes, from the chains of the arms. Pure numbers."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from trocar.procs.kinematics.poses import Array, rotation_from_vector
from trocar.procs.rl.model import ArmModel
from trocar.procs.tables.arm_types import ARM_TYPES

Colour = tuple[float, float, float, float]

BALL, ROD, TUBE, BOX = "ball", "rod", "tube", "box"
GREEN: Final[Colour] = (0.16, 0.72, 0.30, 0.55)
STEEL: Final[Colour] = (0.74, 0.76, 0.80, 1.0)
DARK: Final[Colour] = (0.16, 0.17, 0.20, 1.0)
CANNULA: Final[Colour] = (0.55, 0.58, 0.64, 1.0)
GLASS: Final[Colour] = (0.25, 0.45, 0.75, 1.0)
HOUSINGS: Final[tuple[Colour, ...]] = ((0.20, 0.42, 0.78, 1.0), (0.84, 0.47, 0.13, 1.0))
"""A colour for each arm."""
SHAFT_M, SHAFT_LENGTH_M = 0.0042, 0.42
SCOPE_M, LENS_M = 0.0060, 0.0045
CANNULA_M, CANNULA_FROM_M, CANNULA_TO_M = 0.0072, -0.07, 0.015
WRIST_M, JAW_M, JAW_LENGTH_M = 0.0031, 0.0016, 0.0105
HOUSING_M: Final = (0.024, 0.030, 0.035)
WRIST_FRAME: Final = 5
"""Of an instrument's chain: where its shaft ends."""


@dataclass(frozen=True, slots=True)
class Drawn:
    """One thing: its middle (3,), m, its axes (3, 3), its half sizes, m (of rods and tubes: radius, half length
    along z), and a colour with its opacity."""

    kind: str
    middle: Array
    axes: Array
    size: tuple[float, float, float]
    colour: Colour


def ball(middle: Array, radius: float, colour: Colour) -> Drawn:
    """A ball."""
    return Drawn(BALL, middle, np.eye(3), (radius, radius, radius), colour)


def rod(start: Array, end: Array, radius: float, colour: Colour, *, flat: bool = False) -> Drawn:
    """A rod with round ends between two points (3,); `flat`: its ends are cut off there."""
    along = end - start
    length = float(np.linalg.norm(along))
    axes = _along(along / length) if length > 0.0 else np.eye(3)
    return Drawn(TUBE if flat else ROD, 0.5 * (start + end), axes, (radius, 0.5 * length, 0.0), colour)


def _along(z: Array) -> Array:
    """Axes (3, 3) with this unit vector as the last one."""
    other = np.array((1.0, 0.0, 0.0)) if abs(z[0]) < 0.9 else np.array((0.0, 1.0, 0.0))
    x = np.cross(other, z)
    x /= np.linalg.norm(x)
    return np.column_stack((x, np.cross(z, x), z))


def scene_of(arms: Iterable[tuple[ArmModel, Array, float]], things: Sequence[Drawn]) -> list[Drawn]:
    """Arms, each with its joints (count,) and jaw, and objects beside them."""
    found: list[Drawn] = []
    for number, (model, at, jaw) in enumerate(arms):
        draw = _endoscope if ARM_TYPES[model.type].has_endoscope else _instrument
        found += draw(model, at, jaw, HOUSINGS[number % len(HOUSINGS)])
    return [*found, *things]


def _outside(model: ArmModel, end: Array, radius: float, colour: Colour) -> list[Drawn]:
    """The shaft from the remote centre's far side to `end` (3,), its cannula and its drive."""
    centre = model.base[:3, 3]
    along = end - centre
    along = along / max(float(np.linalg.norm(along)), 1e-9)
    back = end - SHAFT_LENGTH_M * along
    return [rod(back, end, radius, DARK, flat=True),
            rod(centre + CANNULA_FROM_M * along, centre + CANNULA_TO_M * along, CANNULA_M, CANNULA, flat=True),
            rod(centre + CANNULA_FROM_M * along, centre + (CANNULA_FROM_M + 0.012) * along, 2.0 * CANNULA_M, CANNULA,
                flat=True),
            Drawn(BOX, back, _along(along), HOUSING_M, colour)]


def _instrument(model: ArmModel, at: Array, jaw: float, colour: Colour) -> list[Drawn]:
    """A PSM: shaft, wrist and two fingers."""
    return [*_outside(model, _wrist(model, at), SHAFT_M, colour), *touching(model, at, jaw)]


def _wrist(model: ArmModel, at: Array) -> Array:
    """Where the shaft of an instrument ends (3,)."""
    chain = model.kinematics
    return np.asarray((model.base @ chain.fk_to(at, min(WRIST_FRAME, chain.n)))[:3, 3])


def touching(model: ArmModel, at: Array, jaw: float) -> list[Drawn]:
    """Parts of a PSM that touch objects: rods of constant size, its wrist and two fingers."""
    wrist, last, tip = _wrist(model, at), model.base @ model.kinematics.fk_to(at, model.kinematics.n), model.tip(at)
    found = [rod(wrist, last[:3, 3], WRIST_M, STEEL)]
    hinge, forward, axis = last[:3, 3], tip[:3, 2], last[:3, 2]
    for side in (-0.5, 0.5):
        turn = rotation_from_vector(side * max(jaw, 0.0) * axis)
        beside = np.cross(axis, forward) * (side * 1.6 * JAW_M)
        found.append(rod(hinge + beside, hinge + beside + turn @ forward * JAW_LENGTH_M, JAW_M, STEEL))
    return found


def _endoscope(model: ArmModel, at: Array, jaw: float, colour: Colour) -> list[Drawn]:
    """An ECM: a thick shaft with a lens."""
    tip = model.tip(at)
    end, forward = tip[:3, 3], tip[:3, 2]
    return [*_outside(model, end, SCOPE_M, colour), rod(end, end + 0.0008 * forward, LENS_M, GLASS, flat=True)]
