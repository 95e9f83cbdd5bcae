"""Reads, checks and converts kinematic files, tools, and the data for gravity compensation of an arm.

Arms with `"simulation": "KINEMATIC"` have robots made from their chains, in the process `io`. They have no boards,
motors or gains: actuator positions follow the setpoints exactly. Such a robot consists of actuators and their ranges.
The first actuators are those of the chain, through its coupling, if any; those that drive an instrument (the rest of a
PSM's) have the range of a PSM's discs.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Final

import numpy as np

from trocar.procs.config.loading import convert
from trocar.procs.config.loading.context import Context, Opened
from trocar.procs.config.models.arm_file import ArmFile, MtmFile
from trocar.procs.config.models.gravity_file import load_master_gravity
from trocar.procs.config.models.kinematic_file import DhKeys, KinematicFile, ToolFile
from trocar.procs.config.read.matrices import check_invertible, check_rigid
from trocar.procs.config.read.problem import KeyPath
from trocar.procs.config.read.units import PRISMATIC, REVOLUTE, check_range, check_unit
from trocar.procs.document import system as document
from trocar.procs.document.arms import MasterGravityParameters
from trocar.procs.tables.arm_types import ARM_TYPES

ENGAGED_AXES = 4  # a tool is driven by the last four actuators
KINEMATIC: Final = "KINEMATIC"
KINEMATIC_IO: Final = "io"  # the process of all KINEMATIC robots
DISC_RANGE: Final = math.radians(172.0)
_COUPLING: KeyPath = ("coupling", "ActuatorToJointPosition")


def load_chain(context: Context, path: Path | None) -> document.Chain | None:
    """A kinematic file as a chain; None with errors, or without a path."""
    opened = context.open(KinematicFile, path)
    if opened is None or not check_chain(opened):
        return None
    content = opened.content
    return document.Chain(
        convention=convention_of(content.DH),
        links=convert.links(content.DH),
        base=content.base_offset,
        actuator_to_joint=content.coupling.ActuatorToJointPosition if content.coupling else None,
        source=str(path),
    )


def arm_chain(opened: Opened[ArmFile]) -> document.Chain | None:
    """The chain named in an arm file."""
    return load_chain(opened.context, opened.find(("kinematic",), opened.content.kinematic))


def weighing_links(opened: Opened[ArmFile], family: str) -> document.Chain | None:
    """The links of an arm with their masses; None if it needs none, or with errors."""
    row = ARM_TYPES[family]
    name = opened.content.kinematic_gc or row.physical.get(opened.content.generation, "")
    if not name or not row.physical_links:
        return None
    chain = load_chain(opened.context, opened.find(("kinematic_gc",), name))
    if chain is None or len(chain.links) in row.physical_links:
        return chain
    allowed = f"{' or '.join(map(str, row.physical_links))} rows for gravity compensation of this arm"
    opened.error(("kinematic_gc",), f"chain of {len(chain.links)} rows", allowed)
    return None


def measured_weight(opened: Opened[ArmFile], arms: Collection[str] = (), serial: str = "") -> \
        MasterGravityParameters | None:
    """The parameters in a master's gravity-compensation file; None without such a file, or with errors.

    `arms`, `serial`: names and serial number of the master, if known, for a warning if the file is another's.
    """
    name = opened.content.gravity_compensation if isinstance(opened.content, MtmFile) else ""
    path = opened.find(("gravity_compensation",), name) if name else None
    return load_master_gravity(opened.context, path, arms, serial) if path is not None else None


def check_chain(opened: Opened[KinematicFile]) -> bool:
    """Whether rows and matrices of a kinematic file are valid."""
    content = opened.content
    fine = check_dh(opened, ("DH",), content.DH)
    if content.base_offset is not None:
        fine = check_rigid(opened, ("base-offset",), content.base_offset) and fine
    if content.coupling is not None:
        size = len(content.DH.joints or content.DH.links)
        fine = check_invertible(opened, _COUPLING, content.coupling.ActuatorToJointPosition, size) and fine
    return fine


def load_tool(context: Context, path: Path, name: str) -> document.Tool | None:
    """A tool file, read once; None with errors."""
    if path not in context.tools:
        opened = context.open(ToolFile, path)
        fine = opened is not None and check_tool(opened)
        context.tools[path] = convert.tool(opened.content, name, str(path)) if opened is not None and fine else None
    found = context.tools[path]
    return dataclasses.replace(found, name=name) if found is not None else None


def check_tool(opened: Opened[ToolFile]) -> bool:
    """Whether rows, matrices and ranges of a tool file are valid."""
    content = opened.content
    fine = check_dh(opened, ("DH",), content.DH)
    fine = check_rigid(opened, ("tooltip_offset",), content.tooltip_offset) and fine
    fine = check_invertible(opened, _COUPLING, content.coupling.ActuatorToJointPosition, ENGAGED_AXES) and fine
    if content.jaw.qmin > content.jaw.qmax:
        opened.error(("jaw", "qmin"), "above qmax", f"at most {content.jaw.qmax}")
        fine = False
    check_range(opened, ("jaw", "qmax"), content.jaw.qmin, content.jaw.qmax, REVOLUTE)
    for name in ("lower", "upper"):
        count = len(getattr(content.tool_engage_position, name))
        if count != ENGAGED_AXES:
            opened.error(("tool_engage_position", name), f"{count} numbers", f"{ENGAGED_AXES} numbers")
            fine = False
    return fine


def convention_of(keys: DhKeys) -> str:
    """The convention of the list, or of its first row."""
    rows = keys.joints or keys.links
    return keys.convention or (rows[0].convention if rows else None) or ""


def check_dh(opened: Opened[object], where: KeyPath, keys: DhKeys) -> bool:
    """Whether the rows at `where` form a valid chain."""
    kind = "joints" if keys.joints else "links"
    rows = keys.joints or keys.links
    if not rows or (keys.joints and keys.links):
        opened.error(where, "one list of rows must be given", "either joints or links")
        return False
    fine = True
    for number, row in enumerate(rows):
        key: KeyPath = (*where, kind, number)
        convention = row.convention or keys.convention
        if convention is None or convention != convention_of(keys):
            opened.error((*key, "convention"), "one convention must hold for all rows", "standard or modified")
            fine = False
        if row.qmin > row.qmax:
            opened.error((*key, "qmin"), "above qmax", f"at most {row.qmax}")
            fine = False
        for name, joint_type in (("alpha", REVOLUTE), ("A", PRISMATIC), ("theta", REVOLUTE), ("D", PRISMATIC),
                                 ("offset", row.type)):
            check_unit(opened, (*key, name), getattr(row, name), joint_type)
        check_range(opened, (*key, "qmax"), row.qmin, row.qmax, row.type)
    return fine


def kinematic_robot(
    opened: Opened[ArmFile], name: str, place: int, chain: document.Chain, actuators: int
) -> tuple[document.Robot, document.PidConfig] | None:
    """The robot of the arm `name`, and a joint controller without gains; None with an error in its arm file.

    `place`: the arm's index in the system, for a unique negative board number.
    """
    links = chain.links[:actuators]
    if chain.actuator_to_joint is not None and len(links) != len(chain.actuator_to_joint):
        opened.error(("kinematic",), f"chain of {len(chain.links)} rows for {actuators} actuators", f"{actuators} rows")
        return None
    discs = range(actuators - len(links))
    names = [link.name or f"joint_{place + 1}" for place, link in enumerate(links)]
    names += [f"disc_{place + 1}" for place in discs]
    types = [link.joint_type.upper() for link in links] + ["REVOLUTE" for _ in discs]
    ranges = _ranges(chain, links) + [(-DISC_RANGE, DISC_RANGE) for _ in discs]
    nothing = document.Linear()
    rows = tuple(
        document.Actuator(-1 - place, axis, joint_type, 0.0, nothing, nothing, maximum_current=0.0,
                          encoder=document.Encoder(nothing, lower, upper, "SOFTWARE"))
        for axis, (joint_type, (lower, upper)) in enumerate(zip(types, ranges, strict=True)))
    gains = tuple(document.PidAxis(*row, 0.0, 0.0, 0.0) for row in zip(names, types, strict=True))
    robot = document.Robot(name, "", KINEMATIC, rows, "NONE", source=str(opened.source.path))
    return robot, document.PidConfig(name, name, gains)


def _ranges(chain: document.Chain, links: Sequence[document.DhLink]) -> list[tuple[float, float]]:
    """The ranges of the chain's actuators: the bounding box of all positions within the joint limits."""
    limits = np.array([(link.lower, link.upper) for link in links])
    if chain.actuator_to_joint is not None:
        parts = np.linalg.inv(np.array(chain.actuator_to_joint))[:, :, None] * limits
        limits = np.stack((parts.min(axis=2).sum(axis=1), parts.max(axis=2).sum(axis=1)), axis=1)
    return [(float(lower), float(upper)) for lower, upper in limits]
