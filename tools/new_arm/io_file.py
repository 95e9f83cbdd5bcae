"""IO files of a new arm: the numbers of its type, and potentiometers from its `.cal` file.

Formulas as in the dVRK's generator, with its rounding, but for `bits_to_current`, which is exact. A drive's sign d and
full-scale current I give `current_to_bits` d·32768/I and 32768; encoders e·2π/counts·pitch/gear; the 12-bit converter
of the manufacturer spans the 4.5 V of our potentiometers.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import degrees, pi, radians
from typing import Any, Final

from trocar.procs.config.loading.io_checks import AXES
from trocar.tools.new_arm.arm_numbers import CLASSIC, GRIPPER, INSERTION, SI, ArmNumbers, BrakeNumbers, Motor
from trocar.tools.new_arm.cal_file import LOWER, UPPER, CalFile
from trocar.tools.output.errors import Problem

FULL_SCALE: Final = 32768
AMPERE: Final = 6.25
"""Full-scale current of QLA and DQLA amplifiers."""
LARGE_AXES, LARGE_AMPERE, SMALL_AMPERE = 2, 65536 / 9600, 2.048
"""A dRA1 has two large amplifiers; the others, and those of its brakes, are small."""
VOLTS, BITS_16, BITS_12 = 4.5, 65536, 4096
SECOND_HALF: Final = 16
"""Bits of the second half of a DQLA follow those of the first."""
SI_BRAKES, DQLA_BRAKES = 7, 4
"""First axis of the brakes on the first board."""
WITHIN, WIDEST = 0.05, 1.5
"""The range that a potentiometer is checked for contains the joint's but for WITHIN of it, and is at most WIDEST times
as wide: so it is in 35 files of three laboratories, where it is either the joint's range or up to 1.41 times as wide.
"""
ALONE: Final = {"MTM": (0, 1), "PSM": (0, 1, 2), "ECM": (0, 1, 2)}
"""Axes whose potentiometer measures one joint only, so that both ranges can be compared."""
PLATFORM: Final = 4
"""The axis of a master whose sign tells left from right."""


@dataclass(frozen=True, slots=True)
class NewArm:
    """What the user chose: name, generation, hardware of the controllers, their board ids, serial number, port."""

    name: str
    generation: str
    hardware: str
    ids: tuple[int, ...]
    serial: str
    port: str
    numbers: ArmNumbers
    cal: CalFile | None

    def is_prismatic(self, axis: int) -> bool:
        """Whether an axis inserts."""
        return axis == INSERTION and self.numbers.type != "MTM"

    def place(self, axis: int) -> dict[str, int]:
        """Board and axis of an actuator."""
        count = AXES[self.hardware]
        return {"axis_id": axis % count, "board_id": self.ids[axis // count]}


def io_file(arm: NewArm) -> dict[str, Any]:
    """The content of the arm's IO file; Problem if the `.cal` file does not fit."""
    numbers = arm.numbers
    pots = _pots(arm) if arm.cal is not None else [None] * len(numbers.motors)
    robot = {
        "name": arm.name,
        "hardware_version": arm.hardware,
        "number_of_actuators": len(numbers.motors),
        "number_of_brakes": len(numbers.brakes),
        "serial_number": arm.serial,
        "actuators": [_actuator(arm, axis, motor, pot) for axis, (motor, pot) in
                      enumerate(zip(numbers.motors, pots, strict=True))],
        "brakes": [_brake(arm, number, brake) for number, brake in enumerate(numbers.brakes)],
        "potentiometers": _potentiometers(arm),
    }
    boards = arm.ids if arm.hardware == "QLA1" else arm.ids[:1] * 2
    found: dict[str, Any] = {"$id": "saw-robot-io.schema.json", "$version": "6", "robots": [robot]}
    if numbers.type == "PSM":
        found["dallas_chips"] = [{"board_id": boards[-1], "name": f"{arm.name}_dallas"}]
    found["digital_inputs"] = [{
        "bit_id": button.bit + SECOND_HALF * (button.board > 0 and arm.hardware == "DQLA"),
        "board_id": boards[button.board], "debounce_time": button.debounce_s, "name": f"{arm.name}_{button.name}",
        "pressed_value": arm.generation == CLASSIC, "trigger_when_pressed": True, "trigger_when_released": True,
    } for button in numbers.buttons]
    if arm.generation == SI:
        found["digital_outputs"] = [{"bit_id": 0, "board_id": arm.ids[0], "name": f"{arm.name}_SUJ_brake"}]
    return found


def gripper_file(arm: NewArm) -> dict[str, Any]:
    """The content of the IO file of a master's gripper; zero scale and offset mean that it is not calibrated."""
    actuator = _actuator(arm, len(arm.numbers.motors), replace(GRIPPER, gear=arm.numbers.motors[0].gear), (0.0, 0.0))
    actuator["actuator_id"], actuator["encoder"]["bits_to_position"] = 0, {"scale": 2 * pi}
    robot = {
        "name": f"{arm.name}_gripper", "type": "io-only", "hardware_version": arm.hardware, "number_of_actuators": 1,
        "number_of_brakes": 0, "serial_number": arm.serial, "actuators": [actuator], "brakes": [],
        "potentiometers": {"potentiometers_type": "ANALOG", "tolerances": None}}
    return {"$id": "saw-robot-io.schema.json", "$version": "6", "robots": [robot]}


def table_name(arm: NewArm) -> str:
    """The file of a Si arm's potentiometer table, which calibration makes."""
    return f"sawRobotIO1394-{arm.name}-{arm.serial}-PotentiometerLookupTable.json"


def _drive(sign: int, ampere: float, maximum: float) -> dict[str, Any]:
    return {"current_to_bits": {"offset": float(FULL_SCALE), "scale": round(sign * FULL_SCALE / ampere, 4)},
            "bits_to_current": {"offset": -sign * ampere, "scale": sign * ampere / FULL_SCALE},
            "maximum_current": maximum}


def _actuator(arm: NewArm, axis: int, motor: Motor, pot: tuple[float, float] | None) -> dict[str, Any]:
    prismatic = arm.is_prismatic(axis)
    ampere = AMPERE if arm.hardware != "dRA1" else LARGE_AMPERE if axis < LARGE_AXES else SMALL_AMPERE
    lower, upper = (limit * 1e-3 if prismatic else radians(limit) for limit in (motor.lower, motor.upper))
    drive = _drive(motor.drive, ampere, motor.current)
    drive["effort_to_current"] = {"scale": round(1.0 / (motor.gear * motor.torque), 10)}
    scale = round(motor.encoder * 2 * pi / motor.counts * motor.pitch / motor.gear, 15)
    found = {
        "actuator_id": axis, **arm.place(axis), "joint_type": "PRISMATIC" if prismatic else "REVOLUTE", "drive": drive,
        "encoder": {"bits_to_position": {"scale": scale}, "velocity_source": motor.velocity,
                    "position_limits_soft": {"lower": lower, "upper": upper}}}
    if pot is not None:
        found["potentiometer"] = {"bits_to_voltage": {"offset": 0.0, "scale": VOLTS / BITS_16},
                                  "voltage_to_position": {"offset": pot[1], "scale": pot[0]}}
    return found


def _brake(arm: NewArm, number: int, brake: BrakeNumbers) -> dict[str, Any]:
    if arm.hardware == "QLA1":
        place = {"axis_id": number, "board_id": arm.ids[1]}
    else:
        place = {"axis_id": (SI_BRAKES if arm.hardware == "dRA1" else DQLA_BRAKES) + number, "board_id": arm.ids[0]}
    ampere = SMALL_AMPERE if arm.hardware == "dRA1" else AMPERE
    return {**place, "drive": _drive(1, ampere, brake.maximum), "release_current": brake.release,
            "release_time": brake.time_s, "released_current": brake.released, "engaged_current": 0.0}


def _potentiometers(arm: NewArm) -> dict[str, Any]:
    tolerances = [{"axis_id": axis, "distance": distance * 1e-3 if arm.is_prismatic(axis) else radians(distance),
                   "latency": latency} for axis, (distance, latency) in enumerate(arm.numbers.tolerances)]
    found: dict[str, Any] = {"potentiometers_type": "ANALOG" if arm.generation == CLASSIC else "DIGITAL",
                             "tolerances": tolerances}
    if arm.numbers.coupling:
        found["coupling"] = {"JointToActuatorPosition": [list(row) for row in arm.numbers.coupling]}
    if arm.generation == SI:
        found["lookup_table_file"] = table_name(arm)
    return found


def _pots(arm: NewArm) -> list[tuple[float, float]]:
    """Scale (rad/V or m/V) and offset of each potentiometer, as the manufacturer measured them."""
    assert arm.cal is not None
    motors = arm.numbers.motors
    count = len(motors) + (arm.numbers.type == "MTM")  # a master's last one is its gripper
    gains, offsets = (arm.cal.numbers(f"motor.pot_input_{what}", count) for what in ("gain", "offset"))
    _check(arm, motors, gains, offsets)
    return [(round(gain * BITS_12 / VOLTS * motor.pitch, 8), round(offset * motor.pitch, 8))
            for motor, gain, offset in zip(motors, gains, offsets, strict=False)]


def _check(arm: NewArm, motors: Sequence[Motor], gains: Sequence[float], offsets: Sequence[float]) -> None:
    """Problem if the file is of another arm: the other hand's master, or ranges that do not agree."""
    assert arm.cal is not None
    for axis, gain in enumerate(gains[: len(motors)]):
        if not gain:
            raise Problem(f"{arm.cal.path}: motor.pot_input_gain of axis {axis} is 0: this potentiometer has no use")
    if arm.numbers.type == "MTM" and (gains[PLATFORM] < 0) != (motors[PLATFORM].drive < 0):
        other = "MTMR" if arm.name == "MTML" else "MTML"
        raise Problem(f"{arm.cal.path} is of an {other}, not of an {arm.name}: the gain of motor {PLATFORM + 1} is "
                      f"{gains[PLATFORM]:g}")
    if ("motor.pot_limit_checks", UPPER) not in arm.cal.lists or ("joint.signal_range", UPPER) not in arm.cal.lists:
        return
    checks, ranges = ([arm.cal.numbers(name, len(gains), row) for row in (LOWER, UPPER)]
                      for name in ("motor.pot_limit_checks", "joint.signal_range"))
    turn, usual = ranges[1][0] - ranges[0][0], radians(motors[0].upper - motors[0].lower)
    if turn > WIDEST * usual:
        raise Problem(f"{arm.cal.path}: the first axis turns {degrees(turn):.0f}°, that of a Classic {arm.name} "
                      f"{degrees(usual):.0f}°: if the arm is an Si, give --generation Si and --serial without --cal")
    for axis in ALONE[arm.numbers.type]:
        low, high = sorted(gains[axis] * counts[axis] + offsets[axis] for counts in checks)
        lower, upper = (limit[axis] for limit in ranges)
        spare = WITHIN * (upper - lower)
        if not (low <= lower + spare and high >= upper - spare and high - low <= WIDEST * (upper - lower)):
            raise Problem(f"{arm.cal.path}: axis {axis}: the range of the potentiometer, {low:.4g} to {high:.4g}, does "
                          f"not fit the joint's, {lower:.4g} to {upper:.4g}: the file is damaged, or of another arm")
