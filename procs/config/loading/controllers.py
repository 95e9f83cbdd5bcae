"""The controllers of one emulated bus: those in its IO files, modified and extended by `trocar.emulation`."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, TypeVar

from trocar.procs.config.loading.buses import SystemFiles
from trocar.procs.config.loading.context import Opened
from trocar.procs.config.loading.io_checks import AXES, board_ids, parts_of, robots_of
from trocar.procs.config.models.io_file import IoFile, RobotKeys
from trocar.procs.config.models.trocar_section import (
    ControllerKeys,
    EmulatedBusKeys,
    EmulationOptions,
    NetworkKeys,
    QuirkKeys,
)
from trocar.procs.config.read.problem import KeyPath
from trocar.procs.config.read.sections import Section
from trocar.procs.document import system as document
from trocar.procs.document.emulated import MADE_FOR
from trocar.procs.fpga import blocks, registers

Keys = TypeVar("Keys", bound=Section)

EMULATION: KeyPath = ("trocar", "emulation")
BOARDS = 16
USUAL, OF_ETHERNET = 8, 9  # the oldest firmware for all hardware; the oldest without need for FireWire
_UNKNOWN = "HARDWARE_UNDEFINED"


@dataclass(frozen=True, slots=True)
class BusPlace:
    """One emulated bus with its keys, and the files in which mistakes are reported."""

    system: SystemFiles
    name: str
    part: Opened[EmulatedBusKeys]
    files: list[Opened[IoFile]]  # empty if the system has no IOs

    def robots(self) -> Iterator[Opened[RobotKeys]]:
        """All robots of its files."""
        return (robot for opened in self.files for robot in robots_of(opened))

    @property
    def options(self) -> EmulationOptions:
        """The keys for all buses."""
        return self.system.options.emulation

    @property
    def keys(self) -> EmulatedBusKeys:
        """The keys of this bus."""
        return self.part.content

    def of_board(self, board: int) -> ControllerKeys:
        """The keys of a board, merged with those of its bus and those for all."""
        own = self.keys.controllers.get(str(board), ControllerKeys())
        return _merged(ControllerKeys, self.options, self.keys, own)

    @property
    def of_bus(self) -> NetworkKeys:
        """The keys of this bus, merged with those for all."""
        return _merged(NetworkKeys, self.options, self.keys)

    @property
    def ethernet(self) -> bool:
        """Whether each board has its own network address."""
        return self.of_bus.network == "ethernet"

    def where(self, name: str, board: int | None = None) -> KeyPath:
        """The origin of a value of a bus, or of one of its boards: the nearest level that has the key."""
        nearest = (self.part.path(("controllers", str(board))), self.part.key, EMULATION)
        return next(((*key, name) for key in nearest if self.system.source.has((*key, name))), self.part.key)


def _merged(model: type[Keys], *levels: Section) -> Keys:
    """Merge the keys of several levels; later levels take precedence."""
    reported: dict[str, Any] = {}
    for level in levels:
        for name in model.model_fields:
            value = getattr(level, name, None)
            if isinstance(value, QuirkKeys):
                value = _merged(QuirkKeys, reported.get(name, QuirkKeys()), value)
            if value is not None:
                reported[name] = value
    return model(**reported)


def controllers(place: BusPlace) -> tuple[document.Controller, ...]:
    """All boards in IO files or in the section; by board id, the hub first."""
    hardware = _hardware_of_files(place)
    for name in place.keys.controllers:
        if name not in map(str, range(BOARDS)):
            place.part.error(("controllers", name), "no board has this id", f"0 to {BOARDS - 1}")
        elif int(name) not in hardware:
            hardware[int(name)] = _UNKNOWN
            if place.files:
                place.system.note(f"{place.name}: board {name} is in no IO file")
    rows = [_controller(place, board, hardware[board]) for board in sorted(hardware)]
    hub = place.keys.hub
    if hub is not None and hub not in hardware:
        place.part.unlisted("hub", "no such board on this bus", map(str, sorted(hardware)))
    return tuple(sorted(rows, key=lambda row: row.board_id != hub))


def _hardware_of_files(place: BusPlace) -> dict[int, str]:
    hardware: dict[int, str] = {}
    for opened in place.files:
        for board, version in board_ids(opened.content).items():
            if hardware.get(board, _UNKNOWN) == _UNKNOWN:
                hardware[board] = version
    return hardware


def _controller(place: BusPlace, board: int, of_files: str) -> document.Controller:
    reported = place.of_board(board)
    hardware = reported.hardware or ("QLA1" if of_files == _UNKNOWN else of_files)
    if of_files not in (_UNKNOWN, hardware):
        text = f"board {board} of {place.name} is a {of_files} in its IO file"
        place.system.error(place.where("hardware", board), text, of_files)
    _check_axes(place, board, hardware)
    firmware = reported.firmware or (OF_ETHERNET if place.ethernet else USUAL)
    fpga = reported.fpga or _usual_fpga(place, hardware, firmware)
    _check_made(place, board, hardware, firmware, fpga)
    return document.Controller(
        board_id=board,
        hardware=hardware,
        firmware=firmware,
        fpga=fpga,
        serial=reported.serial or "",
        robot_serial=_robot_serial(place, board) if hardware == "dRA1" else "",
        qla=_qla(place, board, hardware, firmware),
        quirks=document.Quirks(**reported.quirks.model_dump(exclude_none=True)),
    )


def _usual_fpga(place: BusPlace, hardware: str, firmware: int) -> str:
    made = MADE_FOR[hardware].get(firmware, ("V3",))
    return made[-1] if place.ethernet else made[0]


def _check_made(place: BusPlace, board: int, hardware: str, firmware: int, fpga: str) -> None:
    """Check that the firmware exists for this board, and that it works without FireWire if the bus has none."""
    who = f"board {board} of {place.name}"
    firmware_key, fpga_key = place.where("firmware", board), place.where("fpga", board)
    made = MADE_FOR[hardware]
    if place.ethernet and firmware < OF_ETHERNET:
        text = f"{who} needs FireWire with firmware {firmware}"
        place.system.error(firmware_key, text, f"{OF_ETHERNET} or later, or network bridge")
    elif place.ethernet and fpga != "V3":
        place.system.error(fpga_key, f"{who} needs FireWire with FPGA {fpga}", "V3, or network bridge")
    elif firmware not in made:
        text = f"there is no firmware {firmware} for a {hardware} ({who})"
        place.system.error(firmware_key, text, " or ".join(map(str, made)))
    elif fpga not in made[firmware]:
        text = f"there is no firmware {firmware} for a {hardware} on FPGA {fpga} ({who})"
        place.system.error(fpga_key, text, " or ".join(made[firmware]))


def _check_axes(place: BusPlace, board: int, hardware: str) -> None:
    """Check the axes in a file without hardware version against the assumed hardware."""
    for robot in place.robots():
        used = [part.content.axis_id for part in parts_of(robot) if part.content.board_id == board]
        if robot.content.hardware == _UNKNOWN and max(used, default=0) >= AXES[hardware]:
            text = f"board {board} of {place.name} has no axis {max(used)} as a {hardware}"
            enough = " or ".join(name for name in MADE_FOR if AXES[name] > max(used))
            if place.of_board(board).hardware:
                place.system.error(place.where("hardware", board), text, enough)
            else:
                robot.error("hardware_version", text, enough)


def _qla(place: BusPlace, board: int, hardware: str, firmware: int) -> str:
    qla, key = place.of_board(board).qla, place.where("qla", board)
    usual = document.Controller(board).qla
    who = f"board {board} of {place.name}"
    if qla is not None and hardware == "dRA1":
        if str(board) in key:  # a key for all boards does not apply to those without a QLA
            place.system.error(key, f"{who} is a dRA1: it has no QLA", "nothing")
        return usual
    if qla == "1.5" and firmware == 7:
        place.system.error(key, f"firmware 7 does not support QLA {qla} ({who})", f"{usual}, or firmware 8 or 9")
    return qla or usual


def _robot_serial(place: BusPlace, board: int) -> str:
    """The identification in the memory of the Si arm that contains the board."""
    return next((registers.arm_memory(robot.content.name, robot.content.serial) for robot in place.robots()
                 if any(part.content.board_id == board for part in parts_of(robot))), "")


def check_broadcasts(place: BusPlace, rows: tuple[document.Controller, ...], protocol: str) -> None:
    """Check broadcasts: boards on one bus understand those of others only if all have Rev 7, or none has."""
    old = [row.board_id for row in rows if row.firmware == 7]
    if protocol != "sequential-read-write" and old and len(old) < len(rows):
        key = place.where("firmware", old[0])
        text = f"{protocol} cannot mix firmware 7 (board {', '.join(map(str, old))} of {place.name}) with others"
        place.system.error(key, text, "7 for all boards, 8 and 9 for all, or protocol sequential-read-write")


def check_hub_memory(place: BusPlace, rows: tuple[document.Controller, ...]) -> None:
    """Check that hub memory, and a block, have room for the replies of all boards to a broadcast query."""
    quads = blocks.hub_read_quads((row.firmware, row.hardware) for row in rows)
    if quads > blocks.MAX_HUB_QUADS:
        text = f"the {len(rows)} boards of {place.name} have {quads} quadlets in hub memory"
        place.part.error("controllers" if place.keys.controllers else "", text,
                         f"up to {blocks.MAX_HUB_QUADS}: 15 QLA1 (16 with firmware 7), or 8 DQLA or dRA1")
