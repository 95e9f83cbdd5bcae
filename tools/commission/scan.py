"""Stage `scan`: the boards on each bus are those of the configuration. Nothing is switched on."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final, Protocol

from trocar.procs.document.system import IoConfig, Robot, SystemConfig
from trocar.procs.fpga import blocks
from trocar.procs.node.fault_report import place
from trocar.procs.tables import codes
from trocar.tools.commission.finding import Finding, Outcome
from trocar.tools.inspect.bus_client import NO_SERIALS, BusClient, FoundBoard

UNKNOWN: Final = "HARDWARE_UNDEFINED"


class Scanned(Protocol):
    """The environment of this stage, which runs before a system is up (emulated boards need one)."""

    document: SystemConfig


def run(bench: Scanned) -> Outcome:
    """Scan each bus in turn."""
    outcome = Outcome()
    for io in (io for io in bench.document.ios if io.port):
        with BusClient(io.port) as desk:
            driver = desk.driver()
            asks = not driver
            outcome.figures[io.name] = [_figures(desk, board, asks) for board in desk.boards]
            outcome.add(judge(io, desk.boards))
        extra = sorted({board.board for board in desk.boards} - set(boards_of(io)))
        if unknown := [board.board for board in desk.boards
                       if board.firmware in blocks.LAYOUTS and blocks.LAYOUTS[board.firmware].is_assumed]:
            outcome.notes.append(f"{place(io.name, boards=unknown)}: {codes.FIRMWARE_UNKNOWN.cause}; "
                                 f"{codes.FIRMWARE_UNKNOWN.remedy}")
        if extra:
            outcome.notes.append(f"{place(io.name, boards=extra)}: in no file")
        if not asks:
            rehearsed = bench.document.emulation is not None
            why = f"in a rehearsal {io.name} drives the boards meanwhile" if rehearsed else driver
            outcome.notes.append(f"{io.name}: serial numbers were not read: {why}")
    return outcome


def _figures(desk: BusClient, board: FoundBoard, asks: bool) -> dict[str, Any]:
    return {"board": board.board, "node": board.node, "hardware": board.hardware, "firmware": board.firmware,
            "fpga": board.fpga, **(desk.serials(board) if asks else NO_SERIALS)}


def boards_of(io: IoConfig) -> dict[int, str]:
    """Ids of the boards that a bus needs, each with the robot or device that needs it."""
    needed: dict[int, str] = {}
    for robot in io.robots:
        for number in boards_of_robot(robot):
            needed.setdefault(number, robot.name)
    rows = [(row.board_id, row.name) for row in io.digital_inputs]
    rows += [(row.board_id, row.name) for row in io.digital_outputs]
    rows += [(row.board_id, row.name) for row in io.instrument_readers]
    return {**dict(reversed(rows)), **needed}


def boards_of_robot(robot: Robot) -> set[int]:
    """Ids of the boards of a robot's motors and brakes."""
    return {a.board_id for a in robot.actuators} | {b.board_id for b in robot.brakes}


def judge(io: IoConfig, boards: Sequence[FoundBoard]) -> list[Finding]:
    """Compare the boards that were found with those in the files."""
    found, needed = [], boards_of(io)
    hardware = {number: robot.hardware for robot in io.robots for number in boards_of_robot(robot)}
    there = ", ".join(str(board.board) for board in boards) or "none"
    for number, who in sorted(needed.items()):
        alike = [board for board in boards if board.board == number]
        where = f"{who}, board {number} on {io.name} ({io.port})"
        if not alike:
            found.append(Finding(where, f"it is missing; found are {there}", f"board {number}",
                                 "is it switched on and plugged in? Its rotary switch says its number"))
            continue
        if len(alike) > 1:
            found.append(Finding(where, f"{len(alike)} boards have this number", "one",
                                 "set every rotary switch differently"))
        board, wanted = alike[0], hardware.get(number, UNKNOWN)
        if wanted not in (UNKNOWN, board.hardware):
            found.append(Finding(where, f"it is a {board.hardware}", wanted, "are these the files of this controller?"))
        if board.firmware not in blocks.LAYOUTS:
            found.append(Finding(where, f"firmware Rev {board.firmware}", blocks.REVISIONS, "update its firmware"))
    return found
