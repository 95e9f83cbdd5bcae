"""Loads the `walls` of the `trocar:` section into the arms that they are for."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Final

from trocar.procs.config.loading.buses import SystemFiles
from trocar.procs.config.read.problem import KeyPath
from trocar.procs.document.system import ArmConfig
from trocar.procs.document.walls import Wall
from trocar.procs.kinematics.walls.walls import MOST, objection_to

_WALLS: Final[KeyPath] = ("trocar", "walls")
_USUAL: Final = "PSM"


def with_walls(system: SystemFiles, arms: Sequence[ArmConfig]) -> tuple[ArmConfig, ...]:
    """The arms with their walls, all checked."""
    names = [arm.name for arm in arms]
    for index, wall in enumerate(system.options.walls):
        for place, name in enumerate(wall.arms):
            if name not in names:
                system.unlisted((*_WALLS, index, "arms", place), "no arm of this name", names, "this system has no arm")
    return tuple(dataclasses.replace(arm, walls=_of_arm(system, arm)) for arm in arms)


def _of_arm(system: SystemFiles, arm: ArmConfig) -> tuple[Wall, ...]:
    found = list[Wall]()
    for index, wall in enumerate(system.options.walls):
        if arm.name not in wall.arms and (wall.arms or arm.type != _USUAL):
            continue
        if why := objection_to(wall, arm.type):
            system.error((*_WALLS, index), f"{wall.name}: {why}")
        elif wall.name in [row.name for row in found]:
            system.error((*_WALLS, index, "name"), f"{arm.name} has two walls {wall.name}", "a name for each")
        elif len(found) == MOST:
            system.error((*_WALLS, index), f"{arm.name} has more than {MOST} walls", f"{MOST} at most")
        else:
            found.append(dataclasses.replace(wall, arms=()))
    return tuple(found)
