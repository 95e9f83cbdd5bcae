"""Converts models of files into values of the document: by name, with exceptions where files differ."""

from __future__ import annotations

import dataclasses
import functools
import typing
from collections.abc import Collection
from typing import Any, TypeVar

import numpy as np

from trocar.procs.config.models.io_file import ActuatorKeys, BrakeKeys, DigitalInputKeys, DigitalOutputKeys, RobotKeys
from trocar.procs.config.models.kinematic_file import DhKeys, LinkKeys, ToolFile
from trocar.procs.config.models.pid_file import PidFile
from trocar.procs.config.read.validate import Section
from trocar.procs.document import system as document
from trocar.procs.document.cart import SETUP_BRAKE

T = TypeVar("T")


def by_name(kind: type[T], *sections: Section, **others: Any) -> T:
    """A value of the document: each field from the key of the same name, in upper or lower case, except `others`.

    If several sections have a key, the first one is used. Nested sections are converted as well.
    """
    hints = _hints(typing.cast(Any, kind))
    for section in sections:
        for key in type(section).model_fields:
            name = key.lower()
            if name in hints and name not in others:
                others[name] = _value(hints[name], getattr(section, key))
    return kind(**others)


@functools.cache
def _hints(kind: Any) -> dict[str, Any]:
    return typing.get_type_hints(kind)


def _value(hint: Any, given: Any) -> Any:
    if isinstance(given, Section):
        kinds: list[Any] = [kind for kind in (hint, *typing.get_args(hint)) if dataclasses.is_dataclass(kind)]
        return by_name(kinds[0], given)
    if isinstance(given, tuple):
        return tuple(_value(typing.get_args(hint)[0], item) for item in given)
    return given


def robot(keys: RobotKeys, source: str, lookup: str = "") -> document.Robot:
    """One robot of an IO file; `lookup`: the table of its potentiometers, if they need one."""
    pots = keys.potentiometers
    return by_name(
        document.Robot, keys, serial=keys.serial_number, hardware=keys.hardware_version,
        actuators=tuple(map(_actuator, keys.actuators)), brakes=tuple(map(_brake, keys.brakes)),
        potentiometers=pots.potentiometers_type if pots else "UNDEFINED",
        tolerances=tuple(document.Tolerance(t.distance, t.latency) for t in pots.tolerances) if pots else (),
        joint_to_actuator_position=pots.coupling.JointToActuatorPosition if pots and pots.coupling else None,
        lookup=lookup, source=source)


def _actuator(keys: ActuatorKeys) -> document.Actuator:
    encoder = keys.encoder
    return by_name(
        document.Actuator, keys, keys.drive, effort_to_current=keys.drive.effort_to_current.scale,
        encoder=by_name(document.Encoder, encoder, encoder.position_limits_soft) if encoder else None)


def _brake(keys: BrakeKeys) -> document.Brake:
    return by_name(document.Brake, keys, keys.drive, release_s=keys.release_time)


def digital_input(keys: DigitalInputKeys) -> document.DigitalInput:
    """One button or switch."""
    return by_name(document.DigitalInput, keys, debounce_s=keys.debounce_time,
                   debounce_click_s=keys.debounce_time_click)


def digital_output(keys: DigitalOutputKeys, robots: Collection[str]) -> document.DigitalOutput:
    """One digital output; io itself sets those for brakes of setup joints under one of its `robots`."""
    robot = keys.name.removesuffix(f"_{SETUP_BRAKE}")
    is_brake = robot != keys.name and robot in robots
    return by_name(
        document.DigitalOutput, keys, high_s=keys.high_duration, low_s=keys.low_duration, pwm_hz=keys.PWM_frequency,
        set_by="setup_brake" if is_brake else "", robot=robot if is_brake else "")


def pid(keys: PidFile, robot_name: str, arm_name: str, source: str) -> document.PidConfig:
    """The gains of one robot."""
    axes = tuple(by_name(document.PidAxis, axis, joint_type=axis.type) for axis in keys.pid)
    return document.PidConfig(robot_name, arm_name, axes, source)


def links(keys: DhKeys) -> tuple[document.DhLink, ...]:
    """The rows of a chain."""
    return tuple(
        by_name(document.DhLink, row, joint_type=row.type, lower=row.qmin, upper=row.qmax, effort_max=row.ftmax,
                com=(row.cx, row.cy, row.cz), inertia=_inertia(row), passive=row.mode == "passive")
        for row in keys.joints or keys.links)


def _inertia(keys: LinkKeys) -> document.Matrix:
    """The inertia tensor in the axes of the link; files have it in its own axes, of which x1..x3 is the first."""
    own = np.array(
        [[keys.Ixx, keys.Ixy, keys.Ixz], [keys.Ixy, keys.Iyy, keys.Iyz], [keys.Ixz, keys.Iyz, keys.Izz]], dtype=float
    )
    axes = np.array([[keys.x1, keys.y1, keys.z1], [keys.x2, keys.y2, keys.z2], [keys.x3, keys.y3, keys.z3]])
    return tuple(tuple(float(value) for value in row) for row in axes @ own @ axes.T)


def tool(keys: ToolFile, name: str, source: str) -> document.Tool:
    """An instrument, with the name under which it was requested."""
    return document.Tool(
        name=name,
        links=links(keys.DH),
        jaw=document.JawConfig(keys.jaw.qmin, keys.jaw.qmax, keys.jaw.ftmax),
        tip=keys.tooltip_offset,
        actuator_to_joint=keys.coupling.ActuatorToJointPosition,
        engage_lower=keys.tool_engage_position.lower,
        engage_upper=keys.tool_engage_position.upper,
        snake=keys.snake_like,
        source=source,
    )
