"""An instrument that is put on is seen by the board that reads its memory, and by the switches it closes."""

from __future__ import annotations

import dataclasses

import pytest

from tests.boards.rails import MS, START, Rails, real_time, two_buses, write
from tests.fpga import board_side
from trocar.procs.boards.board_faults import BoardFaults
from trocar.procs.boards.emulation import Emulation
from trocar.procs.boards.instruments import EmulatedInstruments
from trocar.procs.document.system import (
    ArmConfig,
    ArmInputs,
    Chain,
    DigitalInput,
    InstrumentReader,
    JawConfig,
    SystemConfig,
    Tool,
)
from trocar.procs.fpga import blocks, wire
from trocar.procs.fpga import registers as reg
from trocar.procs.fpga.instrument import MODEL_AT, NAME_AT, VERSION_AT

LND, HOOK = "LARGE_NEEDLE_DRIVER:400006", "PERMANENT_CAUTERY_HOOK:420183[11..]"
NODE, ADAPTER, TOOL = 1, 7, 10  # of board 3


class Holder(Rails):
    """A plant as far as instruments go."""

    def __init__(self, held: str = "") -> None:
        super().__init__(7)
        self.held = held

    def instrument(self, arm: str) -> str:
        return self.held

    def insert_tool(self, arm: str, tool: Tool) -> None:
        self.held = tool.name

    def remove_tool(self, arm: str) -> None:
        self.held = ""


def _system(reader: str) -> SystemConfig:
    system = two_buses()
    first, second = system.ios
    switches = tuple(DigitalInput(f"PSM1_{name}", 3, bit, pressed, True, True)
                     for name, bit, pressed in (("adapter", ADAPTER, False), ("tool", TOOL, True)))
    io = dataclasses.replace(first, digital_inputs=first.digital_inputs + switches, instrument_readers=(
        InstrumentReader("PSM2_dallas", 9), InstrumentReader(reader, 3)))
    tools = tuple(Tool(name, (), JawConfig(0.0, 1.0, 1.0), (), (), (), (), names=(kind,), model=model,
                       version_min=least)
                  for name, kind, model, least in (
                      (LND, "LARGE_NEEDLE_DRIVER", "400006", None), (HOOK, "PERMANENT_CAUTERY_HOOK", "420183", 11)))
    arm = ArmConfig("PSM1", "PSM", "Classic", "1", "IO1", "PSM1", "NONE", 1e-3, Chain("modified", ()), tools=tools,
              inputs=ArmInputs(adapter="PSM1_adapter", tool="PSM1_tool"))
    return dataclasses.replace(system, ios=(io, second), arms=(arm,))


def _world(held: str = "", reader: str = "PSM1_dallas") -> tuple[Emulation, EmulatedInstruments, Holder]:
    plant, system = Holder(held), _system(reader)
    world = Emulation(system, plant, START)
    board_faults = BoardFaults(world, plant)  # type: ignore[arg-type]  # a plant as far as it goes
    return world, EmulatedInstruments(system, world, board_faults, plant), plant  # type: ignore[arg-type]


def _read(world: Emulation, at: int) -> bytes | None:
    """256 bytes of the instrument's memory from 0x80 on, as a host reads them; None: there is none."""
    now = START + at * MS
    write(world, 0, NODE, reg.DALLAS, 0x80 << 16 | 2, now)
    status = board_side.decode_response(
        world.answer(0, wire.quadlet_read(NODE, reg.DALLAS, 1, 1), now + 900 * MS) or b"")
    data = board_side.decode_response(
        world.answer(0, wire.block_read(NODE, reg.DALLAS_MEMORY, 256, 1, 1), now + 901 * MS) or b"")
    assert isinstance(status, board_side.WireResponse) and isinstance(data, board_side.WireResponse)
    assert status.value & 0x20F0 == 0
    return data.data if status.value >> 1 & 3 == 1 else None


def _switches(world: Emulation, at: int) -> tuple[int, int]:
    """Levels of adapter (1: pressed) and tool (0: pressed)."""
    levels = int(real_time(world, 0, NODE, START + at * MS)[blocks.DIGITAL_INPUT])
    return levels >> ADAPTER & 1, levels >> TOOL & 1


@pytest.mark.parametrize(("reader", "spelled"), [  # by its name, else by the robot's boards
    ("psm1_Dallas", LND), ("chip 2", "LARGE_NEEDLE_DRIVER_400006")])
def test_an_instrument_is_read_until_it_is_taken_off(reader: str, spelled: str) -> None:
    world, instruments, plant = _world(reader=reader)
    assert _read(world, 1) is None
    assert _switches(world, 1000) == (0, 1)
    instruments.insert("PSM1", spelled)
    assert plant.held == LND
    memory = _read(world, 1001)
    assert memory is not None
    assert memory[NAME_AT - 0x80 :][:20] == b"LARGE_NEEDLE_DRIVER\0"
    assert int.from_bytes(memory[MODEL_AT - 0x80 :][:4], "big") == 400006
    assert _switches(world, 2000) == (1, 0)
    instruments.remove("PSM1")
    assert plant.held == ""
    assert _read(world, 2001) is None
    assert _switches(world, 3000) == (1, 1)  # the adapter stays


@pytest.mark.parametrize(("asked", "version"), [("", 11), ("PERMANENT_CAUTERY_HOOK:420183[12]", 12)])
def test_what_is_held_is_seen_with_its_version(asked: str, version: int) -> None:
    world, instruments, _ = _world("" if asked else HOOK)
    if asked:
        instruments.insert("PSM1", asked)
    memory = _read(world, 1)
    assert memory is not None
    assert (memory[NAME_AT - 0x80 :][:23], memory[VERSION_AT - 0x80]) == (b"PERMANENT_CAUTERY_HOOK\0", version)
    assert int.from_bytes(memory[MODEL_AT - 0x80 :][:4], "big") == 420183
    assert _switches(world, 1000) == (1, 0)


def test_unknown_instruments_and_arms_are_refused() -> None:
    world, instruments, plant = _world()
    with pytest.raises(KeyError, match=f"NEEDLE:1: not known to PSM1 .no instrument of model 1.*there are {LND}"):
        instruments.insert("PSM1", "NEEDLE:1")
    for act in (instruments.remove, lambda arm: instruments.insert(arm, LND)):
        with pytest.raises(KeyError, match=r"PSM7.*PSM1"):
            act("PSM7")
    assert plant.held == ""
    assert _switches(world, 1) == (0, 1)
