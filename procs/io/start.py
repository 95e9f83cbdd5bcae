"""What io does once before its loop: find and check the boards, set watchdogs, see which encoders kept a preload."""

from __future__ import annotations

from typing import Final

from procs.io.port import ALL_BOARDS, BoardInfo, Port, PortError
from procs.io.robots import Robots
from procs.lib import conversion, registers

POWER_OFF: Final = registers.CONTROL_POWER_OFF | registers.CONTROL_AMPS_OFF


def prepare(robots: Robots, port: Port) -> list[bool]:
    """Open the port and make every board safe; returns per robot whether all its encoders are preset.

    PortError names the board that is missing, of the wrong hardware or of an unknown firmware.
    """
    port.open()
    check(robots, port.discover())
    port.write_quadlet(ALL_BOARDS, registers.STATUS, POWER_OFF)
    port.write_quadlet(ALL_BOARDS, registers.WATCHDOG, registers.watchdog_counts(robots.io.watchdog_s))
    return [_preset(robots, port, robot) for robot in range(len(robots.names))]


def check(robots: Robots, boards: tuple[BoardInfo, ...]) -> None:
    """The boards are what the IO files say."""
    found = {info.board: info for info in boards}
    for board in robots.board_ids:
        if board not in found:
            raise PortError(f"board {board} does not answer", f"port {robots.io.port}",
                            f"there are: {', '.join(str(b) for b in sorted(found)) or 'none'}")
        if found[board].firmware not in registers.FIRMWARE_REVISIONS:
            raise PortError(f"board {board} has firmware Rev {found[board].firmware}", f"port {robots.io.port}",
                            f"allowed: {', '.join(str(f) for f in registers.FIRMWARE_REVISIONS)}")
    for robot in robots.io.robots:
        for board in sorted({a.board_id for a in robot.actuators}):
            if robot.hardware not in (found[board].hardware, "HARDWARE_UNDEFINED"):
                raise PortError(f"board {board} is a {found[board].hardware}", robot.source or robot.name,
                                f"robot {robot.name} needs {robot.hardware}")


def _preset(robots: Robots, port: Port, robot: int) -> bool:
    """All encoders of the robot were set by somebody: none is at mid-range, where they wake up."""
    axes = robots.slices[robot]
    places = [a for a in range(axes.start, axes.stop) if robots.has_encoder[a]]
    if not places:
        return False
    for axis in places:
        address = registers.axis_register(int(robots.channel[axis]), registers.ENCODER_PRELOAD)
        preload = port.read_quadlet(robots.board_ids[int(robots.board_row[axis])], address)
        if preload & conversion.ENCODER_MASK == conversion.ENCODER_MIDRANGE:
            return False
    return True
