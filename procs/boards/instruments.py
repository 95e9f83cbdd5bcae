"""Instruments on emulated arms: the joints they bring, the memory a board reads, and the switches they close."""

from __future__ import annotations

from trocar.procs.boards.board_faults import BoardFaults
from trocar.procs.boards.devices.dallas import Dallas, instrument_memory
from trocar.procs.boards.emulation import Emulation
from trocar.procs.boards.robots.plant import Plant
from trocar.procs.document.catalogue import CANDIDATES, find, taken_apart
from trocar.procs.document.system import ArmConfig, SystemConfig, Tool
from trocar.procs.fpga.instrument import NAME_AT, NAME_END

VERSION = 1  # default if neither the name nor the index has one


class EmulatedInstruments:
    """Puts instruments on and takes them off."""

    def __init__(self, system: SystemConfig, world: Emulation, board_faults: BoardFaults, plant: Plant) -> None:
        """The instruments that `plant` holds already are seen at once."""
        self._system, self._world, self._board_faults, self._plant = system, world, board_faults, plant
        for arm in system.arms:
            held = find(plant.instrument(arm.name), _tools(arm)).entry
            if held is not None:
                self._show(arm, held, held.name)

    def insert(self, arm_name: str, name: str) -> None:
        """Insert an instrument (NAME:MODEL) on an arm, with its adapter; KeyError names the possible ones."""
        arm = self._system.arm(arm_name)
        tool = _known(arm, name)
        self._plant.insert_tool(arm.name, tool)
        self._show(arm, tool, name)

    def remove(self, arm_name: str) -> None:
        """Take the instrument off an arm; the adapter stays."""
        arm = self._system.arm(arm_name)
        self._plant.remove_tool(arm.name)
        for memory, now in self._readers(arm):
            memory.remove(now)
        self._switch(arm.inputs.tool, False)

    def _show(self, arm: ArmConfig, tool: Tool, asked: str) -> None:
        for reader, now in self._readers(arm):
            reader.insert(_memory(tool, asked), now)
        for switch in (arm.inputs.adapter, arm.inputs.tool):
            self._switch(switch, True)

    def _switch(self, name: str, closed: bool) -> None:
        if name in self._world.wiring.inputs:
            self._board_faults.press(name, closed)

    def _readers(self, arm: ArmConfig) -> list[tuple[Dallas, int]]:
        """Readers of an arm's instrument, and the ticks there: the readers of its name, else those on its boards."""
        wiring, prefix = self._world.wiring, f"{arm.name.lower()}_"
        readers = [(reader.name.lower().startswith(prefix), wiring.rows[io.name, reader.board_id])
                   for io in self._system.ios if io.name == arm.io for reader in io.instrument_readers]
        own = wiring.boards_of(arm.robot) if arm.robot in wiring.robots else []
        rows = {row for named, row in readers if named} or {row for _, row in readers if row in own}
        found = [self._board_faults.board(row) for row in sorted(rows)]
        return [(bus.boards[local].dallas, bus.now) for bus, local in found]


def _tools(arm: ArmConfig) -> tuple[Tool, ...]:
    return arm.tools or ((arm.tool,) if arm.tool is not None else ())


def _known(arm: ArmConfig, name: str) -> Tool:
    tools = _tools(arm)
    found = find(name, tools)
    if found.entry is None:
        there = ", ".join(found.candidates or tuple(tool.name for tool in tools)[:CANDIDATES]) or "none"
        raise KeyError(f"{name or 'no name'}: not known to {arm.name} ({found.reason}); there are {there}")
    return found.entry


def _memory(tool: Tool, asked: str) -> bytes:
    """Chip content of an instrument, requested by this name."""
    version = tool.version_min if tool.version_min is not None else tool.version_max
    wanted = taken_apart(asked)
    if wanted is not None and wanted.low is not None:
        version = wanted.low
    text = (tool.names[0] if tool.names else tool.name).encode("ascii", "replace").decode()[: NAME_END - NAME_AT]
    model = int(tool.model) if tool.model.isdecimal() else 0
    return instrument_memory(text, model & 0xFF_FFFF, (VERSION if version is None else version) & 0xFF)
