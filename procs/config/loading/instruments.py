"""The instruments of a PSM: all in the tool indexes, that of its file, and the one inserted on emulated boards."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path

from trocar.procs.config.loading.buses import SystemFiles
from trocar.procs.config.loading.chains import load_tool
from trocar.procs.config.loading.context import ADDED, Context, Opened
from trocar.procs.config.models.arm_file import PsmFile
from trocar.procs.config.models.kinematic_file import InstrumentKeys, ToolIndexFile
from trocar.procs.config.read.problem import KeyPath
from trocar.procs.document import system as document
from trocar.procs.document.catalogue import find, full_name

INDEX = "tool/index.json"


@dataclass(frozen=True, slots=True)
class Listed:
    """One entry of an index."""

    names: tuple[str, ...]
    model: str
    version_min: int | None
    version_max: int | None
    keys: InstrumentKeys
    index: Path


@dataclass(frozen=True, slots=True)
class PsmTools:
    """A PSM's fixed instrument, and all instruments that can be selected."""

    fixed: document.Tool | None
    all: tuple[document.Tool, ...]


def psm_tools(system: SystemFiles, arm: str, opened: Opened[PsmFile]) -> PsmTools:
    """The instruments of the arm called `arm`.

    With FIXED detection, only the one in its file and the inserted one are read.
    """
    listed = listed_for(opened)
    fixed = psm_tool(opened, listed)
    name = system.options.emulation.instruments.get(arm)
    key = ("trocar", "emulation", "instruments", arm)
    inserted = _named(opened, listed, system, key, name) if name is not None else None
    tools = [tool for tool in (fixed, inserted) if tool is not None]
    if opened.content.tool_detection != "FIXED":
        tools += _loadable(opened, listed, arm)
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
            taken = {(entry.model, name) for entry in found for name in entry.names}
            found += [Listed(row.names, row.model, row.version_min, row.version_max, row, path)
                      for row in index.content.instruments if not taken & {(row.model, name) for name in row.names}]
    return tuple(found)


def check_index(opened: Opened[ToolIndexFile]) -> bool:
    """Whether at most one entry covers each name, model and version."""
    fine, rows = True, opened.content.instruments
    for number, row in enumerate(rows):
        key: KeyPath = ("instruments", number)
        low, high = _versions(row)
        if low > high:
            opened.error((*key, "version_max"), "below version_min", f"from {row.version_min}")
            fine = False
        for other in rows[:number]:
            first, last = _versions(other)
            if other.model == row.model and set(other.names) & set(row.names) and low <= last and first <= high:
                text = f"model {row.model} is listed twice for the same versions"
                opened.error((*key, "model"), text, "version_min and version_max that tell them apart")
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
    found = find(name, listed)
    if found.note:
        opened.note(f"{asked_by.source.path.name}: {key[-1]} {name} {found.note}")
    if found.entry is None:
        nothing = f"NAME:MODEL of a tool/index.json or index.yaml on the search path; {ADDED}"
        asked_by.error(key, found.reason, ", ".join(found.candidates) or nothing)
        return None
    file, beside = found.entry.keys.file, (found.entry.index.parent, opened.source.path.parent)
    path = asked_by.find(key, file, f"tool/{file}", beside=beside)
    return _loaded(opened.context, path, found.entry) if path is not None else None


def _loadable(opened: Opened[PsmFile], listed: tuple[Listed, ...], arm: str) -> list[document.Tool]:
    """All instruments whose files exist; the others are noted."""
    tools, missing = [], []
    for entry in listed:
        path = file_of(opened.context, entry.index, entry.keys.file)
        tool = _loaded(opened.context, path, entry) if path is not None else None
        tools += [tool] if tool is not None else []
        missing += [entry.keys.file] if path is None else []
    if missing:
        text = f"{arm}: {len(missing)} of {len(listed)} instruments of the tool index have no file"
        opened.note(f"{text} and cannot be chosen: {', '.join(missing[:3])}{', …' if missing[3:] else ''}")
    return tools


def _loaded(context: Context, path: Path, entry: Listed) -> document.Tool | None:
    tool = load_tool(context, path, full_name(entry))
    if tool is None:
        return None
    return dataclasses.replace(tool, names=entry.names, model=entry.model, generation=entry.keys.generation,
                               description=entry.keys.description, version_min=entry.version_min,
                               version_max=entry.version_max)
