"""Instruments on emulated arms: the joints they bring, the memory a board reads, and the switches they close."""

from __future__ import annotations

import re

from procs.boards.devices.dallas import Dallas, instrument_memory
from procs.boards.emulation import Emulation
from procs.boards.incidents import Incidents
from procs.boards.robots.plant import Plant
from procs.lib.document import Arm, System, Tool
from procs.lib.instrument import NAME_AT, NAME_END

_NAME = re.compile(r"(.+?)[_:](\d{5,})(?:[_[](\d+)]?)?")  # name, model and, where it was asked for, version
VERSION = 1  # where none was asked for


class Instruments:
    """Puts instruments on and takes them off."""

    def __init__(self, system: System, world: Emulation, incidents: Incidents, plant: Plant) -> None:
        """The instruments that `plant` holds already are seen at once."""
        self._system, self._world, self._incidents, self._plant = system, world, incidents, plant
        for arm in system.arms:
            if held := plant.instrument(arm.name):
                self._show(arm, held)

    def insert(self, arm_name: str, name: str) -> None:
        """Put an instrument (NAME:MODEL) on an arm, with its adapter; KeyError names what there is."""
        arm = self._system.arm(arm_name)
        tool = _known(arm, name)
        self._plant.insert_tool(arm.name, tool)
        self._show(arm, tool.name)

    def remove(self, arm_name: str) -> None:
        """Take the instrument off an arm; the adapter stays."""
        arm = self._system.arm(arm_name)
        self._plant.remove_tool(arm.name)
        for memory, now in self._readers(arm):
            memory.remove(now)
        self._switch(f"{arm.name}_tool", False)

    def _show(self, arm: Arm, name: str) -> None:
        for reader, now in self._readers(arm):
            reader.insert(_memory(name), now)
        for part in ("adapter", "tool"):
            self._switch(f"{arm.name}_{part}", True)

    def _switch(self, name: str, closed: bool) -> None:
        if name in self._world.wiring.inputs:
            self._incidents.press(name, closed)

    def _readers(self, arm: Arm) -> list[tuple[Dallas, int]]:
        """What reads an arm's instrument, and the ticks there: the readers of its name, else those on its boards."""
        wiring, prefix = self._world.wiring, f"{arm.name.lower()}_"
        readers = [(reader.name.lower().startswith(prefix), wiring.rows[io.name, reader.board_id])
                   for io in self._system.ios if io.name == arm.io for reader in io.instrument_readers]
        own = wiring.boards_of(arm.robot) if arm.robot in wiring.robots else []
        rows = {row for named, row in readers if named} or {row for _, row in readers if row in own}
        found = [self._incidents.board(row) for row in sorted(rows)]
        return [(bus.boards[local].dallas, bus.now) for bus, local in found]


def _known(arm: Arm, name: str) -> Tool:
    tools: dict[str, Tool] = {tool.name: tool for tool in (*arm.tools, *((arm.tool,) if arm.tool is not None else ()))}
    spelled = {key.replace(":", "_"): tool for key, tool in tools.items()}  # files have either between name and model
    if name.replace(":", "_") not in spelled:
        raise KeyError(f"{name or 'no name'}: not known to {arm.name}; there are {', '.join(tools) or 'none'}")
    return spelled[name.replace(":", "_")]


def _memory(name: str) -> bytes:
    """What the chip of an instrument says, by the name that the document has for it."""
    match = _NAME.fullmatch(name)
    kind, model, version = match.groups() if match else (name, "0", None)
    text = kind.encode("ascii", "replace").decode()[: NAME_END - NAME_AT]
    return instrument_memory(text, int(model) & 0xFF_FFFF, int(version or VERSION) & 0xFF)
