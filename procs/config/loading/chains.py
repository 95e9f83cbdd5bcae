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
from trocar.procs.config.models.kinematic_file import DhKeys, GravityFile, KinematicFile, ToolFile
from trocar.procs.config.read.quantities import (
    PRISMATIC,
    REVOLUTE,
    check_invertible,
    check_range,
    check_rigid,
    check_unit,
)
from trocar.procs.document import system as document
from trocar.procs.document.arms import MasterGravityParameters
from trocar.procs.tables.arm_types import ARM_TYPES

ENGAGED_AXES = 4  # a tool is driven by the last four actuators
KINEMATIC: Final = "KINEMATIC"
KINEMATIC_IO: Final = "io"  # the process of all KINEMATIC robots
DISC_RANGE: Final = math.radians(172.0)
_COUPLING: Final = "coupling.ActuatorToJointPosition"


def load_chain(context: Context, path: Path | None) -> document.Chain | None:
    """A kinematic file as a chain; None with errors, or without a path."""
    opened = context.open(KinematicFile, path)
    return check_chain(opened) if opened is not None else None


def arm_chain(opened: Opened[ArmFile]) -> document.Chain | None:
    """The chain named in an arm file."""
    return load_chain(opened.context, opened.find("kinematic", opened.content.kinematic))


def weighing_links(opened: Opened[ArmFile], family: str) -> document.Chain | None:
    """The links of an arm with their masses; None if it needs none, or with errors."""
    row = ARM_TYPES[family]
    name = opened.content.kinematic_gc or row.physical.get(opened.content.generation, "")
    if not name or not row.physical_links:
        return None
    chain = load_chain(opened.context, opened.find("kinematic_gc", name))
    if chain is None or len(chain.links) in row.physical_links:
        return chain
    allowed = f"{' or '.join(map(str, row.physical_links))} rows for gravity compensation of this arm"
    opened.error("kinematic_gc", f"chain of {len(chain.links)} rows", allowed)
    return None


def measured_weight(opened: Opened[ArmFile], arms: Collection[str] = (), serial: str = "") -> \
        MasterGravityParameters | None:
    """The parameters in a master's gravity-compensation file; None without such a file, or with errors.

    `arms`, `serial`: names and serial number of the master, if known, for a warning if the file is another's.
    """
    name = opened.content.gravity_compensation if isinstance(opened.content, MtmFile) else ""
    path = opened.find("gravity_compensation", name, stage="gravity") if name else None
    measured = opened.context.open(GravityFile, path)
    return check_gravity(measured, arms, serial) if measured is not None else None


def check_gravity(opened: Opened[GravityFile], arms: Collection[str] = (), serial: str = "") -> \
        MasterGravityParameters | None:
    """The parameters of one master; None with errors. A warning if not measured on that of these names, this serial."""
    measured, made = opened.content, convert.by_name(MasterGravityParameters, opened.content.GC_controller)
    keys = opened.at("GC_controller", measured.GC_controller)
    limits = list(zip(made.lower, made.upper, strict=True))
    bands = list(zip(made.dead_band, made.saturation, strict=True))
    crossed = next((joint for joint, (low, high) in enumerate(limits) if low > high), None)
    if crossed is not None:
        keys.error(("safe_lower_torque_limit", crossed), "is above the upper limit", f"at most {limits[crossed][1]}")
    empty = next((joint for joint, (low, high) in enumerate(bands) if not 0.0 <= low < high), None)
    if empty is not None:
        keys.error(("db_vel_vec", empty), "is no dead band", f"from 0 to below {bands[empty][1]}")
    if crossed is not None or empty is not None:
        return None
    if serial and measured.SN and serial != measured.SN:
        opened.warning("SN", "measured on another arm", serial)
    elif arms and measured.ARM_NAME and measured.ARM_NAME not in arms and not (serial and measured.SN):
        opened.warning("ARM_NAME", "measured on another arm", " or ".join(arms))
    return made


def check_chain(opened: Opened[KinematicFile]) -> document.Chain | None:
    """The chain of a kinematic file; None if rows or matrices are not valid."""
    content = opened.content
    made = dh_chain(opened.at("DH", content.DH))
    fine = made is not None
    if content.base is not None:
        fine = check_rigid(opened, "base-offset", content.base) and fine
    if content.coupling is not None:
        size = len(content.DH.joints or content.DH.links)
        fine = check_invertible(opened, _COUPLING, content.coupling.actuator_to_joint, size) and fine
    if made is None or not fine:
        return None
    return dataclasses.replace(made, base=content.base,
                               actuator_to_joint=content.coupling.actuator_to_joint if content.coupling else None)


def load_tool(context: Context, path: Path, name: str) -> document.Tool | None:
    """A tool file, read once; None with errors."""
    if path not in context.tools:
        opened = context.open(ToolFile, path)
        context.tools[path] = check_tool(opened) if opened is not None else None
    found = context.tools[path]
    return dataclasses.replace(found, name=name) if found is not None else None


def check_tool(opened: Opened[ToolFile]) -> document.Tool | None:
    """The instrument of a tool file; None if rows, matrices or ranges are not valid."""
    content = opened.content
    chain = dh_chain(opened.at("DH", content.DH))
    fine = check_rigid(opened, "tooltip_offset", content.tip)
    fine = check_invertible(opened, _COUPLING, content.coupling.actuator_to_joint, ENGAGED_AXES) and fine
    if content.jaw.lower > content.jaw.upper:
        opened.error("jaw.qmin", "above qmax", f"at most {content.jaw.upper}")
        fine = False
    check_range(opened, "jaw.qmax", content.jaw.lower, content.jaw.upper, REVOLUTE)
    engage = content.tool_engage_position
    for name, values in (("lower", engage.engage_lower), ("upper", engage.engage_upper)):
        if len(values) != ENGAGED_AXES:
            opened.error(("tool_engage_position", name), f"{len(values)} numbers", f"{ENGAGED_AXES} numbers")
            fine = False
    if chain is None or not fine:
        return None
    return convert.by_name(document.Tool, content, content.coupling, engage, name="", links=chain.links,
                           source=chain.source)


def dh_chain(part: Opened[DhKeys]) -> document.Chain | None:
    """The rows of a part of a file as a chain; None if they are not valid."""
    keys, kind = part.content, "joints" if part.content.joints else "links"
    rows = keys.joints or keys.links
    if not rows or (keys.joints and keys.links):
        part.error("", "exactly one list of rows must be given", "either joints or links")
        return None
    fine, of_all = True, keys.convention or rows[0].convention or ""
    made = convert.links(keys)
    for link, values in zip(part.each(kind, rows), made, strict=True):
        if (link.content.convention or keys.convention) != of_all or not of_all:
            link.error("convention", "one convention must hold for all rows", "standard or modified")
            fine = False
        if values.lower > values.upper:
            link.error("qmin", "above qmax", f"at most {values.upper}")
            fine = False
        for name, value, joint_type in (("alpha", values.alpha, REVOLUTE), ("A", values.a, PRISMATIC),
                                        ("theta", values.theta, REVOLUTE), ("D", values.d, PRISMATIC),
                                        ("offset", values.offset, values.joint_type)):
            check_unit(link, name, value, joint_type)
        check_range(link, "qmax", values.lower, values.upper, values.joint_type)
    return document.Chain(of_all, made, source=str(part.source.path)) if fine else None


def kinematic_robot(
    opened: Opened[ArmFile], name: str, place: int, chain: document.Chain, actuators: int
) -> tuple[document.Robot, document.PidConfig] | None:
    """The robot of the arm `name`, and a joint controller without gains; None with an error in its arm file.

    `place`: the arm's index in the system, for a unique negative board number.
    """
    links = chain.links[:actuators]
    if chain.actuator_to_joint is not None and len(links) != len(chain.actuator_to_joint):
        opened.error("kinematic", f"chain of {len(chain.links)} rows for {actuators} actuators", f"{actuators} rows")
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
