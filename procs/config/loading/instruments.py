"""The instruments of a PSM: all in the tool indexes, that of its file, and the one inserted on emulated boards."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

from trocar.procs.config.loading.buses import SystemFiles
from trocar.procs.config.loading.chains import load_tool
from trocar.procs.config.loading.context import ADDED, Context, Opened
from trocar.procs.config.loading.convert import by_name
from trocar.procs.config.models.arm_file import PsmFile
from trocar.procs.config.models.kinematic_file import InstrumentKeys, ToolIndexFile
from trocar.procs.config.read.problem import KeyPath
from trocar.procs.document import system as document
from trocar.procs.document.catalogue import find, full_name

INDEX = "tool/index.json"
Listed: TypeAlias = Opened[InstrumentKeys]
"""An entry of an index."""


@dataclass(frozen=True, slots=True)
class PsmTools:
    """A PSM's fixed instrument, and all instruments that can be selected."""

    fixed: document.Tool | None
    all: tuple[document.Tool, ...]


def psm_tools(system: SystemFiles, arm: str, opened: Opened[PsmFile], *, is_kinematic: bool) -> PsmTools:
    """The instruments of the arm called `arm`.

    With FIXED detection, a robot has only the one in its file and the inserted one; a KINEMATIC arm takes any.
    """
    listed = listed_for(opened)
    fixed = psm_tool(opened, listed)
    name = system.options.emulation.instruments.get(arm)
    key = ("trocar", "emulation", "instruments", arm)
    inserted = _named(opened, listed, system, key, name) if name is not None else None
    tools = [tool for tool in (fixed, inserted) if tool is not None]
    is_fixed = opened.content.tool_detection == "FIXED"
    if is_kinematic or not is_fixed:
        tools += _loadable(opened, listed, "" if is_fixed else arm)
    return PsmTools(fixed, tuple({tool.name: tool for tool in tools}.values()))


def psm_tool(opened: Opened[PsmFile], listed: tuple[Listed, ...] | None = None) -> document.Tool | None:
    """The tool named in an arm file, required when detection is FIXED."""
    content = opened.content
    if not content.tool:
        if content.tool_detection == "FIXED":
            opened.error(("tool",), "this key is required with tool_detection FIXED", "NAME:MODEL")
        return None
    return _named(opened, listed_for(opened) if listed is None else listed, opened, ("tool",), content.tool)


def listed_for(opened: Opened[PsmFile]) -> tuple[Listed, ...]:
    """The custom index of an arm (if any), then every `tool/index` on the search path.

    An instrument of an earlier index hides those of the same model and name in later ones.
    """
    paths = opened.context.search.first(opened.source.path.parent).find_all(INDEX)
    name = opened.content.custom_tool_index
    if name:
        custom = opened.find(("custom_tool_index",), name, f"tool/{name}")
        paths = ((custom,) if custom is not None else ()) + paths
    found: list[Listed] = []
    for path in dict.fromkeys(paths):
        index = opened.context.open(ToolIndexFile, path)
        if index is not None and check_index(index):
            taken = {(entry.content.model, name) for entry in found for name in entry.content.names}
            found += [row for row in index.each("instruments", index.content.instruments)
                      if not taken & {(row.content.model, name) for name in row.content.names}]
    return tuple(found)


def check_index(opened: Opened[ToolIndexFile]) -> bool:
    """Whether at most one entry covers each name, model and version."""
    fine, rows = True, opened.content.instruments
    for number, part in enumerate(opened.each("instruments", rows)):
        row, (low, high) = part.content, _versions(part.content)
        if low > high:
            part.error("version_max", "below version_min", f"from {row.version_min}")
            fine = False
        for other in rows[:number]:
            first, last = _versions(other)
            if other.model == row.model and set(other.names) & set(row.names) and low <= last and first <= high:
                part.error("model", f"model {row.model} is listed twice for the same versions",
                           "version ranges (version_min, version_max) that do not overlap")
                fine = False
                break
    return fine


def file_of(context: Context, index: Path, file: str) -> Path | None:
    """The file of an index entry, in the folder of the index or on the search path."""
    return context.search.first(index.parent).find(file, f"tool/{file}")


def _versions(row: InstrumentKeys) -> tuple[float, float]:
    return (row.version_min or 0, float("inf") if row.version_max is None else row.version_max)


def _named(opened: Opened[PsmFile], listed: tuple[Listed, ...], asked_by: Opened[object], key: KeyPath,
           name: str) -> document.Tool | None:
    """The tool called `name`; None with an error at the key that requests it."""
    found = find(name, [entry.content for entry in listed])
    if found.note:
        opened.note(f"{asked_by.source.path.name}: {key[-1]} {name} {found.note}")
    if found.entry is None:
        nothing = f"NAME:MODEL of a tool/index.json or index.yaml on the search path; {ADDED}"
        asked_by.error(key, found.reason, ", ".join(found.candidates) or nothing)
        return None
    index = next(entry.source.path for entry in listed if entry.content is found.entry)
    path = asked_by.find(key, found.entry.file, f"tool/{found.entry.file}",
                         beside=(index.parent, opened.source.path.parent))
    return _loaded(opened.context, path, found.entry) if path is not None else None


def _loadable(opened: Opened[PsmFile], listed: tuple[Listed, ...], arm: str) -> list[document.Tool]:
    """All instruments whose files exist; the others are noted for the arm called `arm`, if it is named."""
    tools, missing = [], []
    for entry in listed:
        path = file_of(opened.context, entry.source.path, entry.content.file)
        tool = _loaded(opened.context, path, entry.content) if path is not None else None
        tools += [tool] if tool is not None else []
        missing += [entry.content.file] if path is None else []
    if missing and arm:
        text = f"{arm}: {len(missing)} of {len(listed)} instruments of the tool index have no file"
        opened.note(f"{text} and cannot be chosen: {', '.join(missing[:3])}{', …' if missing[3:] else ''}")
    return tools


def _loaded(context: Context, path: Path, keys: InstrumentKeys) -> document.Tool | None:
    tool = load_tool(context, path, full_name(keys))
    return by_name(document.Tool, keys, tool) if tool is not None else None
