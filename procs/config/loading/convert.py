"""From the models of files to the values of the document; nothing is decided here."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection
from typing import Any, Final

import numpy as np

from trocar.procs.config.models.io_file import (
    ActuatorKeys,
    BrakeKeys,
    DallasKeys,
    DigitalInputKeys,
    DigitalOutputKeys,
    LinearKeys,
    RobotKeys,
)
from trocar.procs.config.models.kinematic_file import DhKeys, LinkKeys, ToolFile
from trocar.procs.config.models.pid_file import PidFile, PidKeys
from trocar.procs.config.models.setup_file import SetupArmKeys
from trocar.procs.config.read.validate import Section
from trocar.procs.document import emulated
from trocar.procs.document import system as document
from trocar.procs.document.cart import SETUP_BRAKE
from trocar.procs.document.gains import GAINS

SETTLED_ELSEWHERE: Final = ("period_s", "tasks")  # by other files as well


def options(section: Section, made: type[document.ArmConfig | document.IoConfig]) -> dict[str, Any]:
    """What a part of the `trocar:` section says of the fields of the document that are called the same."""
    names = {field.name for field in dataclasses.fields(made)}.difference(SETTLED_ELSEWHERE)
    return {name: getattr(section, name) for name in type(section).model_fields if name in names}


def robot(keys: RobotKeys, source: str, lookup: str = "") -> document.Robot:
    """One robot of an IO file; `lookup` is the table of its potentiometers, where they need one."""
    pots = keys.potentiometers
    coupling = pots.coupling if pots else None
    return document.Robot(
        name=keys.name,
        serial=keys.serial_number,
        hardware=keys.hardware_version,
        actuators=tuple(_actuator(actuator) for actuator in keys.actuators),
        potentiometers=pots.potentiometers_type if pots else "UNDEFINED",
        tolerances=tuple(document.Tolerance(t.distance, t.latency) for t in pots.tolerances) if pots else (),
        only_io=keys.only_IO,
        joint_to_actuator_position=coupling.JointToActuatorPosition if coupling else None,
        brakes=tuple(_brake(brake) for brake in keys.brakes),
        lookup=lookup,
        source=source,
    )


def _linear(keys: LinearKeys) -> document.Linear:
    return document.Linear(keys.scale, keys.offset)


def _actuator(keys: ActuatorKeys) -> document.Actuator:
    encoder, pot = keys.encoder, keys.potentiometer
    return document.Actuator(
        board_id=keys.board_id,
        axis_id=keys.axis_id,
        joint_type=keys.joint_type,
        effort_to_current=keys.drive.effort_to_current.scale,
        current_to_bits=_linear(keys.drive.current_to_bits),
        bits_to_current=_linear(keys.drive.bits_to_current),
        maximum_current=keys.drive.maximum_current,
        encoder=document.Encoder(
            bits_to_position=_linear(encoder.bits_to_position),
            lower=encoder.position_limits_soft.lower,
            upper=encoder.position_limits_soft.upper,
            velocity_source=encoder.velocity_source,
        )
        if encoder
        else None,
        potentiometer=document.Potentiometer(_linear(pot.bits_to_voltage), _linear(pot.voltage_to_position))
        if pot
        else None,
    )


def _brake(keys: BrakeKeys) -> document.Brake:
    return document.Brake(
        board_id=keys.board_id,
        axis_id=keys.axis_id,
        current_to_bits=_linear(keys.drive.current_to_bits),
        bits_to_current=_linear(keys.drive.bits_to_current),
        maximum_current=keys.drive.maximum_current,
        release_current=keys.release_current,
        release_s=keys.release_time,
        released_current=keys.released_current,
        engaged_current=keys.engaged_current,
    )


def instrument_reader(keys: DallasKeys) -> document.InstrumentReader:
    """One instrument memory."""
    return document.InstrumentReader(keys.name, keys.board_id)


def digital_input(keys: DigitalInputKeys) -> document.DigitalInput:
    """One button."""
    return document.DigitalInput(
        name=keys.name,
        board_id=keys.board_id,
        bit_id=keys.bit_id,
        pressed_value=keys.pressed_value,
        trigger_when_pressed=keys.trigger_when_pressed,
        trigger_when_released=keys.trigger_when_released,
        skip_first_run=keys.skip_first_run,
        debounce_s=keys.debounce_time,
        debounce_click_s=keys.debounce_time_click,
    )


def digital_output(keys: DigitalOutputKeys, robots: Collection[str]) -> document.DigitalOutput:
    """One digital output; io sets the brakes of the setup joints under one of its `robots` by itself."""
    robot = keys.name.removesuffix(f"_{SETUP_BRAKE}")
    is_brake = robot != keys.name and robot in robots
    return document.DigitalOutput(
        name=keys.name,
        board_id=keys.board_id,
        bit_id=keys.bit_id,
        is_pwm=keys.is_PWM,
        high_s=keys.high_duration,
        low_s=keys.low_duration,
        pwm_hz=keys.PWM_frequency,
        set_by="setup_brake" if is_brake else "",
        robot=robot if is_brake else "",
    )


def pid(keys: PidFile, robot_name: str, arm_name: str, source: str) -> document.PidConfig:
    """The gains of one robot."""
    return document.PidConfig(robot_name, arm_name, tuple(_pid_axis(axis) for axis in keys.pid), source)


def _pid_axis(keys: PidKeys) -> document.PidAxis:
    gains: dict[str, Any] = {gain.field: getattr(keys, gain.key) for gain in GAINS}
    return document.PidAxis(keys.name, keys.type, **gains)


def links(keys: DhKeys) -> tuple[document.DhLink, ...]:
    """The rows of a chain."""
    return tuple(_link(link) for link in keys.joints or keys.links)


def _link(keys: LinkKeys) -> document.DhLink:
    return document.DhLink(
        name=keys.name,
        joint_type=keys.type,
        alpha=keys.alpha,
        a=keys.A,
        theta=keys.theta,
        d=keys.D,
        offset=keys.offset,
        lower=keys.qmin,
        upper=keys.qmax,
        effort_max=keys.ftmax,
        mass=keys.mass,
        com=(keys.cx, keys.cy, keys.cz),
        inertia=_inertia(keys),
        passive=keys.mode == "passive",
    )


def _inertia(keys: LinkKeys) -> document.Matrix:
    """The tensor in the axes of the link: the files state it in axes of its own, x1..x3 being the first one."""
    own = np.array(
        [[keys.Ixx, keys.Ixy, keys.Ixz], [keys.Ixy, keys.Iyy, keys.Iyz], [keys.Ixz, keys.Iyz, keys.Izz]], dtype=float
    )
    axes = np.array([[keys.x1, keys.y1, keys.z1], [keys.x2, keys.y2, keys.z2], [keys.x3, keys.y3, keys.z3]])
    return tuple(tuple(float(value) for value in row) for row in axes @ own @ axes.T)


def tool(keys: ToolFile, name: str, source: str) -> document.Tool:
    """An instrument, under the name it was asked for."""
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


def setup_arm(keys: SetupArmKeys) -> emulated.EmulatedSetupArm:
    """One passive arm of the setup joints."""
    return emulated.EmulatedSetupArm(
        name=keys.name,
        plug=keys.plug_number,
        primary=tuple(zip(keys.primary_scales or (), keys.primary_offsets or (), strict=False)),
        secondary=tuple(zip(keys.secondary_scales or (), keys.secondary_offsets or (), strict=False)),
        release_current=keys.brake_release_current,
        lifts=keys.type == "Motorized PSM",
        position=keys.simulated_position or (),
    )
