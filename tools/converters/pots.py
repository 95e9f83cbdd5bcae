"""Potentiometers of a robot in old IO files: type, tolerances, and the coupling of those that sit on joints."""

from __future__ import annotations

import numpy as np

from trocar.tools.converters.element import Element
from trocar.tools.converters.report import Json, number_text
from trocar.tools.converters.units import FormatVersion, Unit

Matrix = list[list[float]]

_INVERSE = 1e-3  # as the original software compared the matrices of a block
_ELSEWHERE = "joints and actuators are coupled in the arm's kinematic or tool file: compare"
_DERIVED = "follows from the position matrix"
_PLACES = {"Actuators": False, "Joints": True}
_MATRICES = ("JointToActuatorPosition", "ActuatorToJointTorque", "JointToActuatorTorque")


class _BadMatrixError(Exception):
    """A matrix of an old file that cannot be used, or follows from none."""

    def __init__(self, line: int, key: str, text: str) -> None:
        super().__init__(text)
        self.line, self.key, self.text = line, key, text


def potentiometers(robot: Element, types: list[str], axes: int, format_version: FormatVersion, analog: bool) -> Json:
    """The part `potentiometers` of a robot, for its first `axes` actuators with joint types `types`."""
    row: Json = {"potentiometers_type": "ANALOG" if analog else "NONE"}
    block = robot.child("Potentiometers")
    on_joints = False
    if block is not None:
        table = block.take("LookupTable")
        if table is not None:
            row |= {"potentiometers_type": "DIGITAL", "lookup_table_file": table[1]}
        place = block.take("Position")
        if place is not None and place[1] not in _PLACES:
            block.report.error(block.line, block.key("Position"), place[1], "unknown word", ", ".join(_PLACES))
        elif place is not None:
            on_joints = _PLACES[place[1]]
            why = f"in the new file {'a' if on_joints else 'no'} matrix JointToActuatorPosition says so"
            block.report.dropped(block.line, block.key("Position"), place[1], why)
        tolerances = _tolerances(block, types, axes, format_version)
        if tolerances:
            row["tolerances"] = tolerances
    try:
        matrix = _own_matrix(block, len(types)) or _coupling(robot, on_joints, len(types))
        if matrix:
            row["coupling"] = {"JointToActuatorPosition": _cut(robot, matrix, axes)}
    except _BadMatrixError as bad:  # its text is no matrix: the check refuses the file until a person has written one
        robot.report.lost(bad.line, bad.key, "", f"{bad.text}: write JointToActuatorPosition")
        row["coupling"] = {"JointToActuatorPosition": f"{bad.key}: {bad.text}"}
    return row


def _tolerances(block: Element, types: list[str], axes: int, format_version: FormatVersion) -> list[Json]:
    rows: list[Json] = []
    listed = block.children("Tolerance")
    for number, (element, joint_type) in enumerate(zip(listed, types, strict=False)):
        axis = element.integer("Axis", most=len(types) - 1)
        if axis != number:
            text = "tolerances must be in the order of the axes"
            element.report.error(element.line, element.key("Axis"), str(axis), text, str(number))
        unit = Unit(element, joint_type, format_version.unit(joint_type))
        distance, latency = unit.number("Distance"), element.number("Latency")
        if number < axes:
            rows.append({"axis_id": number, "distance": distance, "latency": latency})
        else:
            old = number_text(distance, unit.si)
            element.report.dropped(element.line, element.path, old, "a gripper has no encoder to compare with")
    for element in listed[len(types) :]:
        element.drop_all("the robot has fewer actuators")
    if 0 < len(rows) < axes:
        why = "0 switches the check off, as where the old file said nothing"
        block.report.defaulted(block.line, f"{block.path}/Tolerance", f"0 for axes {len(rows)} to {axes - 1}", why)
        rows += [{"axis_id": number, "distance": 0.0, "latency": 0.0} for number in range(len(rows), axes)]
    return rows


def _own_matrix(block: Element | None, size: int) -> Matrix:
    element = block.child("JointToActuatorPosition") if block is not None else None
    return _matrix(element, size) if element is not None else []


def _coupling(robot: Element, on_joints: bool, size: int) -> Matrix:
    """The matrix for potentiometers out of the old block of four; the other three are reported as dropped."""
    block = robot.child("Coupling")
    if block is None:
        return []
    if block.integer("Value", most=1) == 0 or not on_joints:
        block.drop_all(_ELSEWHERE)
        return []
    there = block.child("ActuatorToJointPosition")
    back = block.child("JointToActuatorPosition")
    forward = _matrix(there, size) if there is not None else []
    matrix = _matrix(back, size) if back is not None else []
    if there is None and back is None:
        block.need("ActuatorToJointPosition")
    if forward:
        assert there is not None
        block.report.dropped(there.line, there.path, f"a matrix of {size} rows", _ELSEWHERE)
        inverse = _inverse(there, forward)
        if inverse and matrix and np.abs(np.array(inverse) - np.array(matrix)).max() > _INVERSE:
            text = "not the inverse of ActuatorToJointPosition"
            raise _BadMatrixError(back.line if back else block.line, f"{block.path}/JointToActuatorPosition", text)
        matrix = matrix or inverse
    for tag in _MATRICES:
        block.drop_child(tag, _DERIVED)
    return matrix


def _inverse(element: Element, matrix: Matrix) -> Matrix:
    try:
        with np.errstate(all="ignore"):  # absurd numbers overflow, and are refused like any other
            inverse = np.linalg.inv(np.array(matrix))
    except np.linalg.LinAlgError:
        inverse = np.full((1, 1), np.nan)
    if not np.isfinite(inverse).all():
        raise _BadMatrixError(element.line, element.path, "has no inverse")
    return [[float(value) for value in row] for row in np.round(inverse, 12) + 0.0]


def _matrix(element: Element, size: int) -> Matrix:
    rows = []
    for row in element.children("Row"):
        text = row.text("Val")
        try:
            rows.append([float(word) for word in text.split()])
        except ValueError:
            raise _BadMatrixError(row.line, row.key("Val"), f"not {size} numbers") from None
    good = len(rows) == size and all(len(row) == size for row in rows) and np.all(np.isfinite(np.array(rows)))
    if not good:
        raise _BadMatrixError(element.line, element.path, f"not {size} rows of {size} numbers")
    return rows


def _cut(robot: Element, matrix: Matrix, axes: int) -> Matrix:
    """The part of the first `axes`; the rest, a gripper's, must have nothing to do with it."""
    values = np.array(matrix)
    if values[:axes, axes:].any() or values[axes:, :axes].any():
        raise _BadMatrixError(robot.line, f"{robot.path}/Coupling", "the gripper is coupled with the arm")
    return [row[:axes] for row in matrix[:axes]]
