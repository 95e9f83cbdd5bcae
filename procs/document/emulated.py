"""Emulated boards in the document, beyond the files of their robots: kinds of controllers, buses, model variations."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from trocar.procs.document.keys import Key

Linear = tuple[float, float]  # scale, offset

# Existing firmware versions by hardware, with the FPGAs each was made for. Rev 7 supports only the QLA, and no FPGA V3;
# DQLA and dRA1 need V3. Emulated, Rev 10 differs from Rev 9 by its number only.
MADE_FOR: dict[str, dict[int, tuple[str, ...]]] = {
    "QLA1": {7: ("V2",), 8: ("V2", "V3"), 9: ("V2", "V3"), 10: ("V2", "V3")},
    "DQLA": {8: ("V3",), 9: ("V3",), 10: ("V3",)},
    "dRA1": {8: ("V3",), 9: ("V3",), 10: ("V3",)},
}


Switch = Annotated[bool, Key(is_optional=True)]
Factor = Annotated[float, Key(0.0, 10.0, "factor")]


@dataclass(frozen=True, slots=True)
class Quirks:
    """Oddities of the real firmware that emulated boards reproduce unless switched off."""

    direction_lag: Switch = True  # the first edge after a reversal counts in the old direction
    sticky_overflow: Switch = True  # a preload does not clear a counter's overflow bit
    repeated_amp_bits: Switch = True  # Rev 8 on: status bits 3:0 repeat the feedback, not the requests
    longest_pwm_holds: Switch = True  # a PWM count of 65535 is held indefinitely, like 0
    playing_hides_table: Switch = True  # a table being played reads as its active entry
    late_deviation: Switch = True  # dRA1: too large a current error is detected only when the amplifier goes off anyway


@dataclass(frozen=True, slots=True)
class Controller:
    """One emulated controller board; its node on the FireWire bus is its index in the bus's list."""

    board_id: int
    hardware: str = "QLA1"  # QLA1, DQLA or dRA1
    firmware: int = 8
    fpga: str = "V2"
    serial: str = ""  # dddd-dd, in the PROMs of the boards; empty: never written
    robot_serial: str = ""  # of the Si arm around a dRA1
    qla: str = "1.4"  # of a QLA1 or DQLA; from 1.5 on with I/O expander: voltage mode, safety line
    quirks: Quirks = Quirks()


@dataclass(frozen=True, slots=True)
class BusConfig:
    """One emulated bus: the UDP endpoint (or, Ethernet-only, the endpoints) of its controllers."""

    io: str
    address: str  # 127.x.y.z, port 1394; 0.0.0.0: every address of the machine
    controllers: tuple[Controller, ...]
    network: str = "bridge"  # bridge: FireWire behind the first board; ethernet: an address for every board (Rev 9)
    testboard: bool = False  # the boards are wired to the loop-back board of the original test programs


@dataclass(frozen=True, slots=True)
class ModelVariation:
    """Differences of an emulated robot from its files, as in real robots, unknown to controllers."""

    robot: str
    friction: Factor = 1.0  # on the friction of every joint
    inertia: Annotated[float, Key(0.1, 10.0, "factor")] = 1.0  # on the motors' inertia
    mass: Factor = 1.0  # on the masses of the links
    payload: Annotated[float, Key(0.0, 5.0, "kg at the tip")] = 0.0
    backlash: Annotated[tuple[float, ...], Key(0.0, 0.5, "rad or m")] = ()  # between actuator and joint, by actuator
    pot_offset: Annotated[tuple[float, ...], Key(-10.0, 10.0, "rad or m")] = ()  # potentiometers' error, by actuator
    command_current: Annotated[tuple[float, ...], Key(-1.0, 1.0, "A")] = ()  # at zero command, by actuator, then brake
    measured_current: Annotated[tuple[float, ...], Key(-1.0, 1.0, "A")] = ()  # without current, likewise
    brake_release: Annotated[tuple[float, ...], Key(0.0, 5.0, "A")] = ()  # from which on a brake lets go, by brake
    brake_hold: Annotated[tuple[float, ...], Key(0.0, 5.0, "A")] = ()  # down to which it then stays so, by brake

    def wrong_sizes(self, actuators: int, brakes: int) -> list[tuple[str, int, str]]:
        """Lists that are not empty and lack a value, or have too many: (key, number of values, the allowed one)."""
        axes, drives = (actuators, "an actuator"), (actuators + brakes, "an actuator and brake")
        held = (brakes, "a brake")
        parts = (("backlash", self.backlash, axes), ("pot_offset", self.pot_offset, axes),
                 ("command_current", self.command_current, drives), ("measured_current", self.measured_current, drives),
                 ("brake_release", self.brake_release, held), ("brake_hold", self.brake_hold, held))
        return [(key, len(values), f"{count}, one {what}") for key, values, (count, what) in parts
                if len(values) not in (0, count)]


@dataclass(frozen=True, slots=True)
class EmulatedSetupArm:
    """One passive arm of Classic setup joints; rad, and m for the first joint."""

    name: str
    plug: int  # 1 to 4
    primary: tuple[Linear, ...]  # volts to position, by joint; scale 0: no such joint
    secondary: tuple[Linear, ...]
    release_current: float = 0.0  # A, releases its brakes; 0: they are never released
    lifts: bool = False  # the first joint has a motor
    position: tuple[float, ...] = ()  # at start; empty: middle of the potentiometers' range


@dataclass(frozen=True, slots=True)
class EmulatedSetupJoints:
    """Classic setup joints, and the bits of the board to which their interface is wired."""

    name: str  # of their robot
    io: str
    board_id: int
    axes: tuple[int, ...]  # of plugs 1 to 4: analog input, brakes' current, one bit of the multiplexer's channel
    reset: int  # digital outputs
    increment: int
    pwm: int
    disable: int
    arms: tuple[EmulatedSetupArm, ...]
