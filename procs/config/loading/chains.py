"""Kinematic files, tools and the tool index: read, checked, converted."""

from __future__ import annotations

import dataclasses
from pathlib import Path

from trocar.procs.config.loading import convert
from trocar.procs.config.loading.context import Context, Opened
from trocar.procs.config.models.kinematic_file import DhKeys, KinematicFile, ToolFile
from trocar.procs.config.read.matrices import check_invertible, check_rigid
from trocar.procs.config.read.problem import Key
from trocar.procs.config.read.source import SourceFile
from trocar.procs.document import system as document

ENGAGED_AXES = 4  # a tool is turned by the last four actuators


def load_chain(context: Context, path: Path) -> document.Chain | None:
    """A kinematic file as a chain; None with errors."""
    opened = context.open(KinematicFile, path)
    if opened is None or not check_chain(context, opened):
        return None
    content = opened.content
    return document.Chain(
        convention=convention_of(content.DH),
        links=convert.links(content.DH),
        base=content.base_offset,
        actuator_to_joint=content.coupling.ActuatorToJointPosition if content.coupling else None,
        source=str(path),
    )


def check_chain(context: Context, opened: Opened[KinematicFile]) -> bool:
    """Whether rows and matrices of a kinematic file make sense."""
    source, content = opened.source, opened.content
    fine = check_dh(context, source, ("DH",), content.DH)
    if content.base_offset is not None:
        fine = check_rigid(context, source, ("base-offset",), content.base_offset) and fine
    if content.coupling is not None:
        matrix = content.coupling.ActuatorToJointPosition
        size = len(content.DH.joints or content.DH.links)
        key: Key = ("coupling", "ActuatorToJointPosition")
        fine = check_invertible(context, source, key, matrix, size) and fine
    return fine


def load_tool(context: Context, path: Path, name: str) -> document.Tool | None:
    """A tool file, read once; None with errors."""
    if path not in context.tools:
        opened = context.open(ToolFile, path)
        fine = opened is not None and check_tool(context, opened)
        context.tools[path] = convert.tool(opened.content, name, str(path)) if opened is not None and fine else None
    found = context.tools[path]
    return dataclasses.replace(found, name=name) if found is not None else None


def check_tool(context: Context, opened: Opened[ToolFile]) -> bool:
    """Whether rows, matrices and ranges of a tool file make sense."""
    source, content = opened.source, opened.content
    fine = check_dh(context, source, ("DH",), content.DH)
    fine = check_rigid(context, source, ("tooltip_offset",), content.tooltip_offset) and fine
    key: Key = ("coupling", "ActuatorToJointPosition")
    fine = check_invertible(context, source, key, content.coupling.ActuatorToJointPosition, ENGAGED_AXES) and fine
    if content.jaw.qmin > content.jaw.qmax:
        context.error(source, ("jaw", "qmin"), "above qmax", f"at most {content.jaw.qmax}")
        fine = False
    for name in ("lower", "upper"):
        count = len(getattr(content.tool_engage_position, name))
        if count != ENGAGED_AXES:
            context.error(source, ("tool_engage_position", name), f"{count} numbers", f"{ENGAGED_AXES} numbers")
            fine = False
    return fine


def convention_of(keys: DhKeys) -> str:
    """What the rows, or the first of them, call their convention."""
    rows = keys.joints or keys.links
    return keys.convention or (rows[0].convention if rows else None) or ""


def check_dh(context: Context, source: SourceFile, where: Key, keys: DhKeys) -> bool:
    """Whether the rows at `where` make a chain."""
    kind = "joints" if keys.joints else "links"
    rows = keys.joints or keys.links
    if not rows or (keys.joints and keys.links):
        context.error(source, where, "one list of rows must be given", "either joints or links")
        return False
    fine = True
    for number, row in enumerate(rows):
        key: Key = (*where, kind, number)
        convention = row.convention or keys.convention
        if convention is None or convention != convention_of(keys):
            context.error(source, (*key, "convention"), "one convention must hold for all rows", "standard or modified")
            fine = False
        if row.qmin > row.qmax:
            context.error(source, (*key, "qmin"), "above qmax", f"at most {row.qmax}")
            fine = False
    return fine
