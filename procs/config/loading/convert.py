"""Converts models of files into values of the document: by name, with exceptions where files differ."""

from __future__ import annotations

import dataclasses
import functools
import typing
from collections.abc import Collection
from typing import Any, TypeVar

import numpy as np

from trocar.procs.config.loading.context import Opened
from trocar.procs.config.models.io_file import RobotKeys
from trocar.procs.config.models.kinematic_file import DhKeys, LinkKeys
from trocar.procs.config.read.sections import Section
from trocar.procs.document import system as document
from trocar.procs.document.cart import SETUP_BRAKE
from trocar.procs.document.decoding import hints_of

T = TypeVar("T")


def by_name(kind: type[T], *sections: object, **others: Any) -> T:
    """A value of the document: each field from the key of the same name, in upper or lower case, except `others`.

    If several sections (or values of the document) have a key, the first one is used. Nested sections are converted.
    """
    for section in sections:
        for key, name, hint in _shared(typing.cast(Any, kind), typing.cast(Any, type(section))):
            if name not in others:
                others[name] = _value(hint, getattr(section, key))
    return kind(**others)


@functools.cache
def _shared(kind: Any, section: Any) -> list[tuple[str, str, Any]]:
    """Key, field and type of what a section and a value of the document share."""
    hints = hints_of(kind)
    keys = section.model_fields if issubclass(section, Section) else hints_of(section)
    return [(key, key.lower(), hints[key.lower()]) for key in keys if key.lower() in hints]


def _value(hint: Any, given: Any) -> Any:
    if isinstance(given, Section):
        kinds: list[Any] = [kind for kind in (hint, *typing.get_args(hint)) if dataclasses.is_dataclass(kind)]
        return by_name(kinds[0], given)
    if isinstance(given, tuple):
        return tuple(_value(typing.get_args(hint)[0], item) for item in given)
    return given


def robot(part: Opened[RobotKeys], lookup: str = "") -> document.Robot:
    """One robot of an IO file; `lookup`: the table of its potentiometers, if they need one."""
    keys, pots = part.content, part.content.potentiometers
    return by_name(
        document.Robot, keys,
        potentiometers=pots.potentiometers_type if pots else "UNDEFINED", tolerances=pots.tolerances if pots else (),
        joint_to_actuator_position=pots.coupling.JointToActuatorPosition if pots and pots.coupling else None,
        lookup=lookup, source=str(part.source.path))


def digital_output(row: document.DigitalOutput, robots: Collection[str]) -> document.DigitalOutput:
    """One digital output; io itself sets those for brakes of setup joints under one of its `robots`."""
    robot = row.name.removesuffix(f"_{SETUP_BRAKE}")
    is_brake = robot != row.name and robot in robots
    return dataclasses.replace(row, set_by="setup_brake", robot=robot) if is_brake else row


def links(keys: DhKeys) -> tuple[document.DhLink, ...]:
    """The rows of a chain."""
    return tuple(by_name(document.DhLink, row, com=(row.cx, row.cy, row.cz), inertia=_inertia(row),
                         passive=row.mode == "passive")
                 for row in keys.joints or keys.links)


def _inertia(keys: LinkKeys) -> document.Matrix:
    """The inertia tensor in the axes of the link; files have it in its own axes, of which x1..x3 is the first."""
    own = np.array(
        [[keys.Ixx, keys.Ixy, keys.Ixz], [keys.Ixy, keys.Iyy, keys.Iyz], [keys.Ixz, keys.Iyz, keys.Izz]], dtype=float
    )
    axes = np.array([[keys.x1, keys.y1, keys.z1], [keys.x2, keys.y2, keys.z2], [keys.x3, keys.y3, keys.z3]])
    return tuple(tuple(float(value) for value in row) for row in axes @ own @ axes.T)
