"""Kinematic files, tools and the tool index: read, checked, converted."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from procs.lib import document
from procs.lib.config import convert
from procs.lib.config.context import Context, Opened
from procs.lib.config.kinematic_file import DhKeys, InstrumentKeys, KinematicFile, ToolFile, ToolIndexFile
from procs.lib.config.matrices import check_invertible, check_rigid
from procs.lib.config.problem import Key
from procs.lib.config.search import SearchPath
from procs.lib.config.source import Source

ENGAGED_AXES = 4  # a tool is turned by the last four actuators


@dataclass(frozen=True, slots=True)
class Index:
    """One tool index and the folder its files lie in."""

    source: Source
    instruments: tuple[InstrumentKeys, ...]


def load_chain(context: Context, path: Path) -> document.Chain | None:
    """A kinematic file as a chain; None with errors."""
    opened = context.open(KinematicFile, path)
    if opened is None or not check_chain(context, opened):
        return None
    content = opened.content
    return document.Chain(
        convention=_convention(content.DH),
        links=convert.links(content.DH),
        base=content.base_offset,
        actuator_to_joint=content.coupling.ActuatorToJointPosition if content.coupling else None,
        source=str(path),
    )


def check_chain(context: Context, opened: Opened[KinematicFile]) -> bool:
    """Whether rows and matrices of a kinematic file make sense."""
    source, content = opened.source, opened.content
    fine = _check_dh(context, source, content.DH)
    if content.base_offset is not None:
        fine = check_rigid(context, source, ("base-offset",), content.base_offset) and fine
    if content.coupling is not None:
        matrix = content.coupling.ActuatorToJointPosition
        size = len(content.DH.joints or content.DH.links)
        key: Key = ("coupling", "ActuatorToJointPosition")
        fine = check_invertible(context, source, key, matrix, size) and fine
    return fine


def load_tool(context: Context, path: Path, name: str) -> document.Tool | None:
    """A tool file; None with errors."""
    opened = context.open(ToolFile, path)
    if opened is None or not check_tool(context, opened):
        return None
    return convert.tool(opened.content, name, str(path))


def check_tool(context: Context, opened: Opened[ToolFile]) -> bool:
    """Whether rows, matrices and ranges of a tool file make sense."""
    source, content = opened.source, opened.content
    fine = _check_dh(context, source, content.DH)
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


def load_indexes(context: Context, search: SearchPath, custom: Path | None) -> tuple[Index, ...]:
    """The custom index of an arm (if any), then every `tool/index` on the search path."""
    paths = search.find_all("tool/index.json")
    indexes = []
    for path in ((custom,) if custom else ()) + paths:
        opened = context.open(ToolIndexFile, path)
        if opened is not None:
            indexes.append(Index(opened.source, opened.content.instruments))
    return tuple(indexes)


def tool_file(
    context: Context, asked_by: Source, key: Key, name: str, indexes: tuple[Index, ...], search: SearchPath
) -> Path | None:
    """The file of the tool called NAME:MODEL or NAME:MODEL:VERSION; None with an error at `key`."""
    wanted, _, rest = name.partition(":")
    model, _, version = rest.partition(":")
    for index in indexes:
        entries = [i for i in index.instruments if i.model == model and (not wanted or wanted in i.names)]
        entries = [i for i in entries if _version_fits(i, version)]
        if len(entries) > 1:
            context.error(asked_by, key, "several versions of this tool exist", "NAME:MODEL:VERSION")
            return None
        if entries:
            beside = index.source.path.parent
            file = entries[0].file
            return context.find(asked_by, key, (file, f"tool/{file}"), search.first(beside))
    known = sorted({f"{i.names[0]}:{i.model}" for index in indexes for i in index.instruments})
    allowed = ", ".join(known) if known else "NAME:MODEL of a tool/index.json or index.yaml on the search path"
    context.error(asked_by, key, "no tool of this name in any index", allowed)
    return None


def _version_fits(entry: InstrumentKeys, version: str) -> bool:
    if not version:
        return True
    if not version.isdigit():
        return False
    number = int(version)
    lowest = entry.version_min if entry.version_min is not None else number
    highest = entry.version_max if entry.version_max is not None else number
    return lowest <= number <= highest


def _convention(keys: DhKeys) -> str:
    rows = keys.joints or keys.links
    return keys.convention or (rows[0].convention if rows else None) or ""


def _check_dh(context: Context, source: Source, keys: DhKeys) -> bool:
    kind = "joints" if keys.joints else "links"
    rows = keys.joints or keys.links
    if not rows or (keys.joints and keys.links):
        context.error(source, ("DH",), "one list of rows must be given", "either joints or links")
        return False
    fine = True
    for number, row in enumerate(rows):
        key: Key = ("DH", kind, number)
        convention = row.convention or keys.convention
        if convention is None or convention != _convention(keys):
            context.error(source, (*key, "convention"), "one convention must hold for all rows", "standard or modified")
            fine = False
        if row.qmin > row.qmax:
            context.error(source, (*key, "qmin"), "above qmax", f"at most {row.qmax}")
            fine = False
    return fine
