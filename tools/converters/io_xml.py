"""IO XML (versions 1 to 5) to the IO JSON format 6: robots, and the rest of a file.

Versions 1 to 4 are in degrees and mm and spell `BoardID`; version 5 is in SI units and spells `BoardId`. A version 5
with the old spelling was widespread: it is read by its spelling, and an attribute `Unit` precedes either.
"""

from __future__ import annotations

from dataclasses import dataclass

from trocar.procs.config import HEADS
from trocar.tools.converters.actuator import Actuators
from trocar.tools.converters.element import Element
from trocar.tools.converters.names import plain, today
from trocar.tools.converters.pots import potentiometers
from trocar.tools.converters.report import ConversionReport, Json, number_text
from trocar.tools.converters.units import FormatVersion, format_version_of
from trocar.tools.converters.xmltext import XmlNode

_MAX_ACTUATORS = 16
_GRIPPER_AXIS = 7  # of the MTMs of versions 1 to 4: today the gripper is a robot of its own
_TYPES = {"io-only": True, "robot": False}
_FLAGS = {"True": True, "False": False}
_MAX_BOARDS, _MAX_BITS = 16, 32
_TRIGGERS = {"all": (True, True), "press": (True, False), "release": (False, True), "none": (False, False)}
_BITS = {"0": False, "1": True}
_CLICK = 0.2  # of the debounce time, default for an old file
_NO_JOINTS = "joints are those of the kinematic file"


@dataclass(frozen=True, slots=True)
class IoFiles:
    """Output for one old file: a file, and one for the gripper that was an MTM's eighth actuator."""

    main: Json
    grippers: Json | None = None
    gripper_name: str = ""  # default location of that file for a system


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
        digital_inputs=[_digital_input(element) for element in top.children("DigitalIn")],
        digital_outputs=[_digital_output(element) for element in top.children("DigitalOut")],
        dallas_chips=[_dallas_chip(element) for element in top.children("DallasChip")],
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
    name = _name_of(element)
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
    reason = "the gripper is a separate robot, in a separate file"
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


def _digital_input(element: Element) -> Json:
    """One `DigitalIn`."""
    row = _place(element)
    report = element.report
    if element.has("Pressed"):
        row["pressed_value"] = bool(element.word(_BITS, "Pressed"))
    else:
        row["pressed_value"] = False
        report.defaulted(element.line, element.key("Pressed"), "false", "as in the original software")
    if not element.has("Trigger"):
        element.missing("Trigger", ", ".join(_TRIGGERS))
    pressed, released = element.word(_TRIGGERS, "Trigger") or (False, False)
    row |= {"trigger_when_pressed": pressed, "trigger_when_released": released}
    if element.has("SkipFirstRun"):
        row["skip_first_run"] = bool(element.word(_BITS, "SkipFirstRun"))
    debounce = _duration(element, "Debounce")
    row["debounce_time"] = debounce
    if element.has("DebounceClick"):
        click = _duration(element, "DebounceClick")
        if click > debounce:
            allowed = f"up to Debounce ({number_text(debounce)})"
            report.error(element.line, element.key("DebounceClick"), number_text(click), "out of range", allowed)
        row["debounce_time_click"] = click
    elif debounce:
        row["debounce_time_click"] = round(_CLICK * debounce, 9)
        why = f"{_CLICK} of Debounce, as in the original software; left out it would be 0 today"
        new = number_text(_CLICK * debounce, "s")
        report.defaulted(element.line, element.key("DebounceClick"), new, why)
    return row


def _digital_output(element: Element) -> Json:
    """One `DigitalOut`."""
    row = _place(element)
    for old, new in (("HighDuration", "high_duration"), ("LowDuration", "low_duration")):
        if element.has(old):
            row[new] = _duration(element, old)
    frequency = element.has("Frequency")
    row["is_PWM"] = frequency
    if frequency:
        row["PWM_frequency"] = _duration(element, "Frequency")
    return row


def _dallas_chip(element: Element) -> Json:
    """One `DallasChip`."""
    return {"name": _name_of(element), "board_id": _board(element)}


def _place(element: Element) -> Json:
    bit = element.integer("BitId", "BitID", most=_MAX_BITS - 1)
    return {"name": _name_of(element), "board_id": _board(element), "bit_id": bit}


def _board(element: Element) -> int:
    return element.integer("BoardId", "BoardID", most=_MAX_BOARDS - 1)


def _name_of(element: Element) -> str:
    """Its name, as it is called today."""
    old = element.text("Name")
    name = today(old)
    if name != old:
        element.report.converted(element.line, element.key("Name"), old, name, "today's name")
    return name


def _duration(element: Element, name: str) -> float:
    value = element.number(name, default=0.0)
    if value < 0.0:
        element.report.error(element.line, element.key(name), number_text(value), "out of range", "a number from 0")
    return value
