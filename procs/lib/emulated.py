"""What emulated boards stand in for beyond the files of their robots: kinds of controller, rows of the document."""

from __future__ import annotations

from dataclasses import dataclass

Linear = tuple[float, float]  # scale, offset

# The firmwares there are, by hardware, with the FPGAs each was made for. Rev 7 knows no other hardware than the QLA and
# no FPGA V3; DQLA and dRA1 sit on V3 only.
MADE_FOR: dict[str, dict[int, tuple[str, ...]]] = {
    "QLA1": {7: ("V2",), 8: ("V2", "V3"), 9: ("V2", "V3")},
    "DQLA": {8: ("V3",), 9: ("V3",)},
    "dRA1": {8: ("V3",), 9: ("V3",)},
}


@dataclass(frozen=True, slots=True)
class Likeness:
    """How an emulated robot differs from its files: what a controller does not know of a real one."""

    robot: str
    friction: float = 1.0  # factor on the friction of every joint
    inertia: float = 1.0  # factor on the motors' inertia
    mass: float = 1.0  # factor on the masses of the links
    payload: float = 0.0  # kg at the tip
    backlash: tuple[float, ...] = ()  # play between actuator and joint, rad or m, by actuator
    pot_offset: tuple[float, ...] = ()  # error of the potentiometers, rad or m, by actuator


@dataclass(frozen=True, slots=True)
class SetupArm:
    """One passive arm of Classic set-up joints; rad, and m for the first joint."""

    name: str
    plug: int  # 1 to 4
    primary: tuple[Linear, ...]  # volts to position, by joint; scale 0: there is no such joint
    secondary: tuple[Linear, ...]
    release_current: float = 0.0  # A, lets its brakes go; 0: they always hold
    lifts: bool = False  # the first joint has a motor
    position: tuple[float, ...] = ()  # at start; empty: in the middle of what the potentiometers reach


@dataclass(frozen=True, slots=True)
class SetupJoints:
    """Classic set-up joints, and which bits of their board their interface hangs on."""

    name: str  # of their robot
    io: str
    board_id: int
    axes: tuple[int, ...]  # of plugs 1 to 4: analog input, brakes' current, one bit of the multiplexer's channel
    reset: int  # digital outputs
    increment: int
    pwm: int
    disable: int
    arms: tuple[SetupArm, ...]
