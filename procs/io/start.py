"""io's steps before its loop: find and check boards and arms, and find the encoders that kept a preload.

The last step is repeated for boards that return: they may have been without power.

The controllers of Si arms (dRA1) enable no amplifier before the arm's encoders were preloaded; such an arm stores its
own serial number.
"""

from __future__ import annotations

import contextlib
from typing import Final

import numpy as np

from trocar.procs.document.system import Actuator, Brake
from trocar.procs.fpga import blocks, registers
from trocar.procs.io.bus.bus_port import ALL_BOARDS, BusPort
from trocar.procs.io.bus.discovery import BoardInfo
from trocar.procs.io.bus.port import Port
from trocar.procs.io.bus.transport import PortError
from trocar.procs.io.digital_outputs import DigitalOutputs
from trocar.procs.io.record import Flags
from trocar.procs.io.robots import Robots
from trocar.procs.io.watchdogs import Watchdogs
from trocar.shm.time.clock import pause

POWER_OFF: Final = registers.CONTROL_POWER_OFF | registers.CONTROL_AMPS_OFF
FLASH_PAUSE_S: Final = 0.01  # for the arm to answer a command to its memory
FLASH_WORDS: Final = 16


def prepare(robots: Robots, port: BusPort) -> Flags:
    """Open the port and make every board safe; returns for every actuator whether its encoder is preset.

    PortError names the board that is missing, of the wrong hardware or of an unknown firmware.
    """
    port.open()
    check(robots, port.discover())
    port.write_quadlet(ALL_BOARDS, registers.STATUS, POWER_OFF)
    for robot in range(0 if port.read_only else len(robots.names)):
        _prepare_si(robots, port, robot)
    return _preset(robots, port)


def restore(robots: Robots, port: Port, watchdogs: Watchdogs, outputs: DigitalOutputs, rows: Flags, now_ns: int
            ) -> Flags:
    """Restore the settings of boards (by row) that return; returns the encoders (axes,) on them that are no longer set.

    The boards are read as between two cycles. A board that does not answer is treated as after power-up.
    """
    lost: Flags = robots.has_encoder & rows[robots.board_row[: robots.axes]]
    watchdogs.write(rows, now_ns)
    with contextlib.suppress(PortError):  # it is away again, and will return
        outputs.restore(rows)
        for axis in np.flatnonzero(lost).tolist():
            word = port.peek(*robots.preload_register(axis))
            if word is None:
                break
            lost[axis] = not _is_set(int(word[0]))
    return lost


def _is_set(preload: int) -> bool:
    """Whether an encoder was set: it is not at mid-range, its value after power-up."""
    return preload & registers.ENCODER_MASK != registers.ENCODER_MIDRANGE


def check(robots: Robots, boards: tuple[BoardInfo, ...]) -> None:
    """Check that the boards that discovery has found, of known firmware, match the IO files."""
    found = {info.board: info for info in boards}
    for robot in robots.io.robots:
        for board in sorted({a.board_id for a in robot.actuators}):
            if robot.hardware not in (found[board].hardware, "HARDWARE_UNDEFINED"):
                raise PortError(f"board {board} is a {found[board].hardware}", robot.source or robot.name,
                                f"robot {robot.name} needs {robot.hardware}")
        drives: list[Actuator | Brake] = [*robot.actuators, *robot.brakes]
        for drive in drives:  # also if the file does not specify the hardware
            hardware = found[drive.board_id].hardware
            axes = blocks.AXES_OF[hardware][0]
            if not drive.axis_id < axes:
                raise PortError(f"board {drive.board_id} is a {hardware}, without axis {drive.axis_id}",
                                robot.source or robot.name, f"it has axes 0 to {axes - 1}")


def _prepare_si(robots: Robots, port: BusPort, robot: int) -> None:
    """Check the arm's serial number against the file, and preload its encoders (to 0 where they are not set)."""
    keys, axes = robots.io.robots[robot], robots.slices[robot]
    rows = [row for row in np.flatnonzero(robots.on_board[robot]).tolist() if port.hardware[row] == "dRA1"]
    for row in rows:
        board = robots.board_ids[row]
        expected, found = registers.arm_memory(keys.name, keys.serial), arm_serial(port, board)
        if found != expected:
            raise PortError(f"the arm on board {board} identifies as {found or 'nothing'}", keys.source or keys.name,
                            f"robot {keys.name} with serial number {keys.serial} should be {expected}")
        if not port.read_quadlet(board, registers.STATUS) & registers.STATUS_PRELOADED:
            for axis in range(axes.start, axes.stop):
                if robots.board_row[axis] == row and robots.has_encoder[axis]:
                    port.write_quadlet(*robots.preload_register(axis), registers.ENCODER_MIDRANGE)


def arm_serial(port: BusPort, board: int) -> str:
    """The serial number in an Si arm's memory, e.g. p123456.cal; empty if there is none.

    The memory is read word by word: the address is given twice, the second time with the read enabled.
    """
    data = bytearray()
    for address in range(FLASH_WORDS):
        for enable in (0, registers.ARM_FLASH_ENABLE):
            port.write_quadlet(board, registers.ARM_FLASH_COMMAND, enable | registers.ARM_FLASH_READ | address)
            pause(FLASH_PAUSE_S)
        data += (port.read_quadlet(board, registers.ARM_FLASH_WORD) & 0xFFFF).to_bytes(2, "little")
        if 0 in data:
            break
    port.write_quadlet(board, registers.ARM_FLASH_COMMAND, 0)
    return bytes(data).split(b"\0")[0].decode("ascii", "replace")


def _preset(robots: Robots, port: BusPort) -> Flags:
    """Whether each encoder (axes,) is set."""
    preset = robots.has_encoder.copy()
    for axis in np.flatnonzero(robots.has_encoder).tolist():
        preset[axis] = _is_set(port.read_quadlet(*robots.preload_register(axis)))
    return preset
