"""The instruments of a PSM: the one its file names, the one emulated boards find in it."""

from __future__ import annotations

from procs.lib import document
from procs.lib.config.arm_file import PsmFile
from procs.lib.config.chains import load_indexes, load_tool, tool_file
from procs.lib.config.context import Context, Opened
from procs.lib.config.problem import Key
from procs.lib.config.source import Source
from procs.lib.config.trocar_section import TrocarSection


def psm_tool(context: Context, opened: Opened[PsmFile]) -> document.Tool | None:
    """The tool an arm file names, required when detection is FIXED."""
    source, content = opened.source, opened.content
    if not content.tool:
        if content.tool_detection == "FIXED":
            context.error(source, ("tool",), "this key is required with tool_detection FIXED", "NAME:MODEL")
        return None
    return _named_tool(context, opened, source, ("tool",), content.tool)


def inserted_tool(
    context: Context, system: Source, arm: str, opened: Opened[PsmFile], options: TrocarSection
) -> document.Tool | None:
    """The instrument that emulated boards find in this arm at start."""
    name = options.emulation.instruments.get(arm)
    if name is None:
        return None
    return _named_tool(context, opened, system, ("trocar", "emulation", "instruments", arm), name)


def _named_tool(
    context: Context, opened: Opened[PsmFile], asked_by: Source, key: Key, name: str
) -> document.Tool | None:
    """The tool NAME:MODEL, from the indexes that hold for this arm."""
    source, content = opened.source, opened.content
    search = context.search.first(source.path.parent)
    custom = None
    if content.custom_tool_index:
        names = (content.custom_tool_index, f"tool/{content.custom_tool_index}")
        custom = context.find(source, ("custom_tool_index",), names, search)
    indexes = load_indexes(context, search, custom)
    path = tool_file(context, asked_by, key, name, indexes, search)
    return load_tool(context, path, name) if path else None
