"""Loads the `walls` of the `trocar:` section into the arms that they are for."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Final

from trocar.procs.config.loading.buses import SystemFiles
from trocar.procs.config.read.problem import KeyPath
from trocar.procs.document.system import ArmConfig
from trocar.procs.document.walls import ARMS, FRAMES, Wall
from trocar.procs.kinematics.walls.walls import MAX_OTHERS, MOST, objection_to
from trocar.procs.tables.arm_types import ARM_TYPES

_WALLS: Final[KeyPath] = ("trocar", "walls")
_USUAL: Final = "PSM"


def with_walls(system: SystemFiles, arms: Sequence[ArmConfig]) -> tuple[ArmConfig, ...]:
    """The arms with their walls, all checked."""
    names, moving = [arm.name for arm in arms], [arm.name for arm in arms if ARM_TYPES[arm.type].has_remote_centre]
    for index, wall in enumerate(system.options.walls):
        key = (*_WALLS, index)
        for place, name in enumerate(wall.arms):
            if name not in names:
                system.unlisted((*key, "arms", place), "no arm of this name", names, "this system has no arm")
            elif wall.shape == ARMS and name not in moving:
                system.error((*key, "arms", place), "no PSM or ECM", "PSMs and ECMs keep away from each other")
        if wall.shape == ARMS and len(set(wall.arms)) < 2:
            system.error((*key, "arms"), f"{wall.name}: two arms at least keep away from each other", "their names")
        if wall.frame not in (*FRAMES, *moving):
            system.unlisted((*key, "frame"), "no frame, and no PSM or ECM, of this name", (*FRAMES, *moving), "")
    return tuple(dataclasses.replace(arm, walls=_of_arm(system, arm)) for arm in arms)


def _of_arm(system: SystemFiles, arm: ArmConfig) -> tuple[Wall, ...]:
    found = list[Wall]()
    for index, wall in enumerate(system.options.walls):
        if arm.name not in wall.arms and (wall.arms or arm.type != _USUAL):
            continue
        others = tuple(name for name in dict.fromkeys(wall.arms) if name != arm.name) if wall.shape == ARMS else ()
        if why := objection_to(wall, arm.type):
            system.error((*_WALLS, index), f"{wall.name}: {why}")
        elif wall.frame == arm.name:
            system.error((*_WALLS, index, "frame"), f"{wall.name} would move with {arm.name} itself", "another frame")
        elif wall.name in [row.name for row in found]:
            system.error((*_WALLS, index, "name"), f"{arm.name} has two walls {wall.name}", "a name for each")
        elif len(found) == MOST:
            system.error((*_WALLS, index), f"{arm.name} has more than {MOST} walls", f"{MOST} at most")
        elif sum(len(row.arms) for row in found) + len(others) > MAX_OTHERS:
            system.error((*_WALLS, index), f"{arm.name} keeps away from more than {MAX_OTHERS} arms",
                         f"{MAX_OTHERS} at most, counted once for each wall")
        else:
            found.append(dataclasses.replace(wall, arms=others))
    return tuple(found)
