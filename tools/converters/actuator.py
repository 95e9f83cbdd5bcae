"""Actuators, drives, encoders, potentiometers and brakes of old IO files."""

from __future__ import annotations

from trocar.tools.converters.element import Element
from trocar.tools.converters.report import Json
from trocar.tools.converters.units import PRISMATIC, REVOLUTE, FormatVersion, Unit

_TYPES = {"Revolute": REVOLUTE, "REVOLUTE": REVOLUTE, "Prismatic": PRISMATIC, "PRISMATIC": PRISMATIC}
_SOURCES = {"FIRMWARE": "FIRMWARE", "SOFTWARE": "SOFTWARE"}
_HARDWARE = {"QLA1": "QLA1", "DQLA": "DQLA", "dRA1": "dRA1"}
_MAX_BOARDS, _MAX_AXES = 16, 16
_QLA_AXES, _DQLA_AXES = 4, 8
_DRA_SCALES = (4800.0, 16000.0)  # bits/A of the dRA1's amplifiers; a QLA has 5242.88
_ESTIMATED = "the firmware's velocity is scaled by bits_to_position"
_NO_ENCODERS = "a gripper and an io-only robot have none that is read"


class Actuators:
    """The rows of a robot's actuators and brakes, and their information about its hardware."""

    def __init__(self, elements: list[Element], format_version: FormatVersion, only_io: bool, encoders: int) -> None:
        """Of the actuators, the first `encoders` have an encoder that counts."""
        self._format_version = format_version
        self._only_io = only_io
        self._encoders = encoders
        self._scales: list[float] = []
        self._axes: list[int] = []
        self.brakes: list[Json] = []
        self.analog = False
        self.rows = [self._actuator(element, number) for number, element in enumerate(elements)]

    def hardware(self, robot: Element) -> str:
        """The controllers' version: as stated or, in files older than the attribute, derived from scales and axes."""
        stated = robot.word(_HARDWARE, "HardwareVersion")
        if stated or robot.has("HardwareVersion"):
            return stated or ""
        highest = max(self._axes, default=0)
        if highest >= _DQLA_AXES or any(abs(scale) in _DRA_SCALES for scale in self._scales):
            guess, why = "dRA1", "scales or axes are those of a dRA1"
        elif highest >= _QLA_AXES:
            guess, why = "DQLA", f"axis {highest} is beyond a QLA1's"
        else:
            guess, why = "QLA1", "scales and axes are those of a QLA1"
        robot.report.defaulted(robot.line, robot.key("HardwareVersion"), guess, f"the file does not say; {why}")
        return guess

    def _actuator(self, element: Element, number: int) -> Json:
        element.take("ActuatorID", "ActuatorId")  # always its number in the list
        row: Json = {"actuator_id": number} | self._place(element)
        joint_type = element.word(_TYPES, "JointType", "Type")
        if joint_type is None:
            joint_type = REVOLUTE
            element.report.defaulted(element.line, element.key("JointType"), REVOLUTE, "as in the original software")
        row["joint_type"] = joint_type
        row["drive"] = self._drive(element.need("Drive"), effort=True)
        if number >= self._encoders:
            element.drop_child("Encoder", _NO_ENCODERS)
        else:
            row["encoder"] = self._encoder(element.need("Encoder"), joint_type)
        pot = element.child("AnalogIn")
        if pot is not None:
            self.analog = True
            row["potentiometer"] = self._potentiometer(pot, joint_type)
        brake = element.child("AnalogBrake")
        if brake is not None:
            self.brakes.append({"brake_id": len(self.brakes)} | self._brake(brake))
        return row

    def _place(self, element: Element) -> Json:
        board = element.integer("BoardId", "BoardID", most=_MAX_BOARDS - 1)
        axis = element.integer("AxisId", "AxisID", most=_MAX_AXES - 1)
        self._axes.append(axis)
        return {"board_id": board, "axis_id": axis}

    def _drive(self, element: Element, *, effort: bool) -> Json:
        rows: Json = {}
        if effort:
            scale = element.child("EffortToCurrent") or element.child("NmToAmps")
            if scale is not None:
                rows["effort_to_current"] = {"scale": scale.number("Scale")}
            elif not self._only_io:
                element.report.error(element.line, f"{element.path}/EffortToCurrent", "", "this element is required")
        rows["current_to_bits"] = to_bits = _linear(element.need("AmpsToBits"))
        rows["bits_to_current"] = _linear(element.need("BitsToFeedbackAmps"))
        rows["maximum_current"] = _value(element, "MaxCurrent", "A")
        self._scales.append(to_bits["scale"])
        return rows

    def _encoder(self, element: Element, joint_type: str) -> Json:
        position = element.need("BitsToPosSI")
        unit = Unit(position, joint_type, self._format_version.unit(joint_type))
        linear = {"scale": unit.number("Scale", per="/bit")}
        if position.has("Offset"):
            offset = unit.number("Offset")
            if offset:
                linear["offset"] = offset
        for tag in ("BitsToDeltaPosSI", "BitsToDeltaT", "CountsPerTurn"):
            element.drop_child(tag, _ESTIMATED)
        source = element.word(_SOURCES, "VelocitySource")
        if source is None:
            source = "FIRMWARE"
            why = "the file does not say; both are published, this one is used"
            element.report.defaulted(element.line, element.key("VelocitySource"), source, why)
        limits = {"lower": 0.0, "upper": 0.0}
        soft = element.child("PositionLimitsSoft")
        if soft is not None:
            unit = Unit(soft, joint_type, self._format_version.unit(joint_type))
            limits = {"lower": unit.number("Lower"), "upper": unit.number("Upper")}
        else:
            why = "not there: those of the PID file counted; write them in place of 0 to 0, or the arm does not home"
            element.report.lost(element.line, f"{element.path}/PositionLimitsSoft", "", why)
        return {"bits_to_position": linear, "position_limits_soft": limits, "velocity_source": source}

    def _potentiometer(self, element: Element, joint_type: str) -> Json:
        row: Json = {"bits_to_voltage": _linear(element.need("BitsToVolts"))}
        position = element.child("VoltsToPosSI")
        if position is not None:
            unit = Unit(position, joint_type, self._format_version.unit(joint_type))
            row["voltage_to_position"] = {"scale": unit.number("Scale", per="/V"), "offset": unit.number("Offset")}
        elif not self._only_io:
            element.need("VoltsToPosSI")
        return row

    def _brake(self, element: Element) -> Json:
        return {
            **self._place(element),
            "drive": self._drive(element, effort=False),
            "release_current": _value(element, "ReleaseCurrent", "A"),
            "release_time": _value(element, "ReleaseTime", "s"),
            "released_current": _value(element, "ReleasedCurrent", "A"),
            "engaged_current": _value(element, "EngagedCurrent", "A"),
        }


def _linear(element: Element) -> dict[str, float]:
    return {"scale": element.number("Scale"), "offset": element.number("Offset")}


def _value(element: Element, tag: str, unit: str) -> float:
    """A number with a unit that the original software never looked at: any other one is a mistake."""
    child = element.need(tag)
    found = child.take("Unit", "Units")
    if found is not None and found[1] != unit:
        text = f"was read as {unit} whatever the file says"
        child.report.error(child.line, child.key(found[0]), found[1], text, unit)
    return child.number("Value")
