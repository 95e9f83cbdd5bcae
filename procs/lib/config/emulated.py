"""Emulated boards in the place of real ones: which controllers, at which address, instead of what."""

from __future__ import annotations

import hashlib
from collections.abc import Callable

from procs.lib import document
from procs.lib.config.arms import LoadedArm
from procs.lib.config.buses import BusFiles
from procs.lib.config.context import Context
from procs.lib.config.io_checks import board_ids
from procs.lib.config.source import Source
from procs.lib.config.trocar_section import EmulationOptions

MOST_BUSES = 15  # addresses 127.x.y.16 to 127.x.y.240
_UNKNOWN = "HARDWARE_UNDEFINED"


def default_addresses(system_name: str) -> Callable[[int], str]:
    """Address of the bus with index 0, 1, …: in a part of 127/8 that depends on the name of the system."""
    digest = hashlib.sha256(system_name.encode()).digest()
    first, second = 1 + digest[0] % 254, digest[1]
    return lambda index: f"127.{first}.{second}.{16 * (index + 1)}"


def controllers(bus: BusFiles) -> tuple[document.Controller, ...]:
    """Every board that any IO file of the bus uses, in order of board id."""
    hardware: dict[int, str] = {}
    serials: dict[int, str] = {}
    for opened in bus.opened():
        for board, version in board_ids(opened.content).items():
            if hardware.get(board, _UNKNOWN) == _UNKNOWN:
                hardware[board] = version
        for robot in opened.content.robots:
            for board in [a.board_id for a in robot.actuators] + [b.board_id for b in robot.brakes]:
                serials.setdefault(board, robot.serial_number)
    rows = []
    for board in sorted(hardware):
        version = "QLA1" if hardware[board] == _UNKNOWN else hardware[board]
        fpga = "V2" if version == "QLA1" else "V3"
        serial = serials.get(board, "") if version == "dRA1" else ""  # only these keep their arm's serial number
        rows.append(document.Controller(board, version, fpga=fpga, serial=serial))
    return tuple(rows)


def build_emulation(
    context: Context,
    source: Source,
    buses: list[BusFiles],
    arms: list[LoadedArm],
    options: EmulationOptions,
    address: Callable[[int], str],
) -> document.Emulation:
    """The emulation of all `buses`; says in the notes what it replaced."""
    if len(buses) > MOST_BUSES:
        context.error(source, ("IOs",), f"{len(buses)} buses with emulated boards", f"at most {MOST_BUSES}")
    rows = []
    for index, bus in enumerate(buses):
        rows.append(document.Bus(bus.keys.name, address(index), controllers(bus)))
        boards = ", ".join(str(controller.board_id) for controller in rows[-1].controllers)
        text = f"{bus.keys.name}: port {bus.keys.port} replaced by emulated boards {boards} at {rows[-1].address}"
        context.notes.append(text)
    instruments = {item.arm.name: item.arm.tool.name for item in arms if item.arm.tool is not None}
    names = [item.arm.name for item in arms]
    for arm, tool in options.instruments.items():
        if arm not in names:
            key = ("trocar", "emulation", "instruments", arm)
            context.error(source, key, "no arm of this name is started", f"one of {', '.join(names)}")
        instruments[arm] = tool
    return document.Emulation(
        period_s=options.period_s,
        buses=tuple(rows),
        seed=options.seed,
        pot_noise_v=options.pot_noise_v,
        instruments=tuple(sorted(instruments.items())),
    )
