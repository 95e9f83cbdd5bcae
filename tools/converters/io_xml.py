"""IO XML (versions 1 to 5) to the IO JSON format 6: robots, and what is in a file besides them.

Versions 1 to 4 are in degrees and mm and spell `BoardID`; version 5 is in SI units and spells `BoardId`. A version 5
with the old spelling was widespread: it is read by its spelling, and an attribute `Unit` counts before either.
"""

from __future__ import annotations

from dataclasses import dataclass

from trocar.procs.config import HEADS
from trocar.tools.converters.actuator import Actuators
from trocar.tools.converters.digital import dallas_chip, digital_input, digital_output, name_of
from trocar.tools.converters.element import Element
from trocar.tools.converters.format_version import FormatVersion, format_version_of
from trocar.tools.converters.names import plain
from trocar.tools.converters.pots import potentiometers
from trocar.tools.converters.report import ConversionReport
from trocar.tools.converters.xmltext import XmlNode

Json = dict[str, object]

_MAX_ACTUATORS = 16
_GRIPPER_AXIS = 7  # of the MTMs of versions 1 to 4: today the gripper is a robot of its own
_TYPES = {"io-only": True, "robot": False}
_FLAGS = {"True": True, "False": False}
_NO_JOINTS = "joints are those of the kinematic file"


@dataclass(frozen=True, slots=True)
class IoFiles:
    """What one old file becomes: a file, and one for the gripper that was an MTM's eighth actuator."""

    main: Json
    grippers: Json | None = None
    gripper_name: str = ""  # where a system looks for that file, unless it is told otherwise


def convert_io(root: XmlNode, report: ConversionReport) -> IoFiles:
    """The new files of an old one; they are of no use when the report has problems."""
    top = Element(root, "", report)
    format_version = format_version_of(root, top)
    robots: list[Json] = []
    grippers: list[Json] = []
    for element in top.children("Robot"):
        robot, gripper = _robot(element, format_version)
        robots.append(robot)
        grippers += [gripper] if gripper else []
    main = _file(
        robots=robots,
        digital_inputs=[digital_input(element) for element in top.children("DigitalIn")],
        digital_outputs=[digital_output(element) for element in top.children("DigitalOut")],
        dallas_chips=[dallas_chip(element) for element in top.children("DallasChip")],
    )
    if len(main) == len(_file()):
        report.error(root.line, "Config", "", "nothing in it", "Robot, DigitalIn, DigitalOut or DallasChip")
    top.finish()
    if not grippers:
        return IoFiles(main)
    first = grippers[0]
    arm = str(first["name"]).removesuffix("_gripper")
    return IoFiles(main, _file(robots=grippers), plain(f"sawRobotIO1394-{arm}-gripper-{first['serial_number']}"))


def _file(**lists: list[Json]) -> Json:
    return HEADS["io"] | {name: rows for name, rows in lists.items() if rows}


def _robot(element: Element, format_version: FormatVersion) -> tuple[Json, Json | None]:
    report = element.report
    name = name_of(element)
    only_io = element.word(_TYPES, "Type") or False
    preload = element.word(_FLAGS, "HasEncoderPreload")
    element.drop("NumOfJoint", _NO_JOINTS)
    count = element.integer("NumOfActuator", least=1, most=_MAX_ACTUATORS)
    listed = element.children("Actuator")
    for extra in listed[count:]:
        extra.drop_all(f"NumOfActuator is {count}")
    if len(listed) < count:
        text = f"the file has {len(listed)} actuators"
        report.error(element.line, element.key("NumOfActuator"), str(count), text, str(len(listed)))
    splits = format_version.old and not only_io and name.startswith("MTM") and count == _GRIPPER_AXIS + 1
    axes = _GRIPPER_AXIS if splits else count
    actuators = Actuators(listed[:count], format_version, only_io, 0 if only_io else axes)
    serial = element.take("SerialNumber", "SN")
    if serial is None:
        report.defaulted(element.line, element.key("SerialNumber"), '""', "the file has none")
    pots = potentiometers(element, [str(row["joint_type"]) for row in actuators.rows], axes, format_version,
                          actuators.analog)
    robot: Json = {
        "name": name,
        "serial_number": serial[1] if serial else "",
        "hardware_version": actuators.hardware(element),
        "number_of_actuators": axes,
        "number_of_brakes": len(actuators.brakes),
        "actuators": actuators.rows[:axes],
        "brakes": actuators.brakes,
        "potentiometers": pots,
    }
    if only_io:
        robot["only_IO"] = True
    if preload is not None:
        robot["has_encoder_preload"] = preload
    return robot, _gripper(robot, actuators.rows[-1], listed[-1]) if splits and listed else None


def _gripper(robot: Json, actuator: Json, element: Element) -> Json:
    name = f"{robot['name']}_gripper"
    reason = "the gripper is a robot of its own, in a file of its own"
    element.report.converted(element.line, element.path, f"actuator {_GRIPPER_AXIS} of {robot['name']}", name, reason)
    return {
        "name": name,
        "serial_number": robot["serial_number"],
        "hardware_version": robot["hardware_version"],
        "number_of_actuators": 1,
        "number_of_brakes": 0,
        "actuators": [actuator | {"actuator_id": 0}],
        "potentiometers": {"potentiometers_type": "ANALOG" if "potentiometer" in actuator else "NONE"},
        "only_IO": True,
    }
