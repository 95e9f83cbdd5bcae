"""The files of 2026 with the potentiometers of the setup arms under Si arms."""

from __future__ import annotations

from typing import Final

from trocar.procs.config.loading.buses import SystemFiles
from trocar.procs.config.loading.context import Opened
from trocar.procs.config.models.setup_pots import SiPotsFile
from trocar.procs.config.models.system_file import ArmKeys
from trocar.procs.config.read.problem import count
from trocar.procs.document.cart import Linear

HARDWARE: Final = "dRA1"
POTS: Final = ("primary_measured_js", "secondary_measured_js")
MOST: Final = 5  # joints
OLD_SCALE_M: Final = 5e-5
"""A smaller scale of the first joint is one of the Bluetooth boards, whose counts have 16 bits."""
MAKES: Final = "stop to stop, with the dVRK's dvrk_calibrate_suj.py"


def open_pots(
    system: SystemFiles, arm: ArmKeys, part: Opened[object], joints: int
) -> list[tuple[Linear, ...]] | None:
    """Conversions of the primary and secondary potentiometers under an arm; None, and errors, if they lack any."""
    name = arm.name_on_IO or arm.name
    if not arm.serial:
        part.error("name", f"the file of its potentiometers is named by the serial number of {arm.name}",
                   f"serial of {arm.name} in the system file")
        return None
    opened = system.open(SiPotsFile, "arms", f"sawRobotIO1394-SUJ-Si-{name}-{arm.serial}.json")
    if opened is None:
        return None
    before, content = len(opened.context.problems), opened.content
    if content.arm_name != name:
        opened.error("arm_name", f"{content.arm_name}, in a file of {name}", name)
    if content.serial_number != arm.serial:
        given = content.serial_number or "none"
        opened.error("serial_number", f"{given}, in a file of {name} {arm.serial}", arm.serial)
    bus = system.buses.get(arm.IO)
    hardware = next((row.content.hardware for row in bus.robots() if row.content.name == name), "") if bus else ""
    if bus is not None and hardware != HARDWARE:
        opened.error("arm_name", f"the controller of {name} is {hardware or 'not known'}", HARDWARE)
    found = check_pots(opened, joints)
    return None if count(opened.context.problems[before:]) else found


def check_pots(opened: Opened[SiPotsFile], joints: int | None = None) -> list[tuple[Linear, ...]]:
    """The same of one file; errors name each joint that is not calibrated. `joints`: default: as many as it has."""
    found = []
    for key in POTS:
        rows = getattr(opened.content, key)
        wanted = min(max(len(rows), 1), MOST) if joints is None else joints
        if len(rows) != wanted:
            opened.error(key, f"{len(rows)} potentiometers for {wanted} joints", f"{wanted} of them")
        missing = [str(joint + 1) for joint, row in enumerate(rows)
                   if not row.scale or row.offset is None or (row.scale, row.offset) == (1.0, 0.0)]
        if missing:
            opened.error(key, f"{opened.content.arm_name}: joint {', '.join(missing)} not calibrated",
                         f"scale and offset, from its motion {MAKES}")
        elif rows and abs(rows[0].scale or 0.0) < OLD_SCALE_M:
            opened.error(key, f"scale {rows[0].scale:g} m of joint 1 is that of a Bluetooth board (16 bits)",
                         "one for the 12-bit converter, about 16 times as large")
        found.append(tuple((row.scale or 0.0, row.offset or 0.0) for row in rows))
    if joints is None and len(found[0]) != len(found[1]):
        opened.error(POTS[1], f"{len(found[1])} potentiometers, {len(found[0])} primary ones", "as many of both")
    return found
