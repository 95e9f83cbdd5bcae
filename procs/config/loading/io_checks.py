"""Consistency checks within an IO file and between the IO files of one bus."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

from trocar.procs.config.loading.context import Opened
from trocar.procs.config.models.io_file import (
    ActuatorKeys,
    BrakeKeys,
    DallasKeys,
    DigitalInputKeys,
    DigitalOutputKeys,
    DriveKeys,
    IoFile,
    RobotKeys,
)
from trocar.procs.config.read.problem import KeyPath
from trocar.procs.config.read.units import check_range, check_tolerance

IoOpened = Opened[IoFile]

AXES = {"QLA1": 4, "DQLA": 8, "dRA1": 10, "HARDWARE_UNDEFINED": 10}
_MIN_FOR_CALIBRATION = 3  # with fewer actuators, equal offsets do not prove a missing calibration
_SCALE_TOLERANCE = 0.05
_ADC = 2**16  # values of a potentiometer's converter
_POT_RANGES = 10.0  # a potentiometer may measure so many times the range of its joint, or the range so many times that


def check_io_file(opened: IoOpened) -> None:
    """Check counts, axes, calibration and scales of every robot in one file."""
    for index, robot in enumerate(opened.content.robots):
        key: KeyPath = ("robots", index)
        _check_counts(opened, key, robot)
        _check_axes(opened, index, robot)
        _check_calibration(opened, key, robot)
        _check_potentiometers(opened, key, robot)
        for where, part in parts_of(index, robot):
            _check_drive(opened, (*where, "drive"), part.drive)
        for number, actuator in enumerate(robot.actuators):
            _check_limits(opened, (*key, "actuators", number), actuator)


def check_bus(files: list[IoOpened]) -> None:
    """Check all files of one bus for conflicting names, axes and hardware versions."""
    used: dict[tuple[object, object], str] = {}
    hardware: dict[int, tuple[str, str]] = {}
    for opened in files:
        for kind, key, name in _names(opened.content):
            _once(opened, key, used, (kind, name), f"{kind} name")
        for index, row in enumerate(opened.content.digital_inputs):
            key, bit = ("digital_inputs", index, "bit_id"), (row.board_id, row.bit_id)
            _once(opened, key, used, ("bit", bit), f"bit {bit[1]} of board {bit[0]}", opened.warning)
        for index, robot in enumerate(opened.content.robots):
            for key, part in parts_of(index, robot):
                if part.axis_id >= 0:
                    place = (part.board_id, part.axis_id)
                    _once(opened, (*key, "axis_id"), used, place, f"board {place[0]} axis {place[1]}")
                first = hardware.setdefault(part.board_id, (robot.hardware_version, robot.name))
                if first[0] != robot.hardware_version:
                    text = f"board {part.board_id} is {first[0]} for robot {first[1]}"
                    opened.error(("robots", index, "hardware_version"), text, "one hardware version for each board")
                    break


def board_ids(content: IoFile) -> dict[int, str]:
    """All boards that a file uses (robots, brakes, inputs, outputs, instrument memories), with hardware versions."""
    boards: dict[int, str] = {}
    for robot in content.robots:
        for _, part in parts_of(0, robot):
            boards.setdefault(part.board_id, robot.hardware_version)
    others = [button.board_id for button in content.digital_inputs]
    others += [output.board_id for output in content.digital_outputs]
    others += [chip.board_id for chip in content.dallas_chips]
    for board in others:
        boards.setdefault(board, "HARDWARE_UNDEFINED")
    return boards


def _once(opened: IoOpened, key: KeyPath, seen: dict[tuple[object, object], str], item: tuple[object, object],
          what: str, report: Callable[[KeyPath, str, str], None] | None = None) -> None:
    if item in seen:
        (report or opened.error)(key, f"{what} is used twice, first in {seen[item]}", "each only once on a bus")
    else:
        problem = opened.source.problem(key, "")
        seen[item] = f"{problem.file}:{problem.line}"


def _names(content: IoFile) -> Iterator[tuple[str, KeyPath, str]]:
    lists: dict[str, Sequence[RobotKeys | DigitalInputKeys | DigitalOutputKeys | DallasKeys]] = {
        "robot": content.robots, "digital input": content.digital_inputs, "digital output": content.digital_outputs,
        "dallas chip": content.dallas_chips}
    for kind, rows in lists.items():
        for index, row in enumerate(rows):
            yield kind, (f"{kind.replace(' ', '_')}s", index, "name"), row.name


def parts_of(index: int, robot: RobotKeys) -> Iterator[tuple[KeyPath, ActuatorKeys | BrakeKeys]]:
    """All actuators and brakes of a robot, with their keys in the file."""
    for number, actuator in enumerate(robot.actuators):
        yield ("robots", index, "actuators", number), actuator
    for number, brake in enumerate(robot.brakes):
        yield ("robots", index, "brakes", number), brake


def _check_counts(opened: IoOpened, key: KeyPath, robot: RobotKeys) -> None:
    for name, stated, listed in (
        ("number_of_actuators", robot.number_of_actuators, len(robot.actuators)),
        ("number_of_brakes", robot.number_of_brakes, len(robot.brakes)),
    ):
        if stated != listed:
            opened.error((*key, name), f"the list has {listed} entries", str(listed))
    for number, actuator in enumerate(robot.actuators):
        if actuator.actuator_id not in (None, number):
            here = (*key, "actuators", number, "actuator_id")
            opened.warning(here, "actuators are used in their order, actuator_id is not consulted", str(number))


def _check_axes(opened: IoOpened, index: int, robot: RobotKeys) -> None:
    axes = AXES[robot.hardware_version]
    for part_key, part in parts_of(index, robot):
        if not 0 <= part.axis_id < axes:
            where = (*part_key, "axis_id")
            text = "this axis does not exist" if opened.source.has(where) else "this key is required"
            opened.error(where, text, f"0 to {axes - 1} on {robot.hardware_version}")


def _check_calibration(opened: IoOpened, key: KeyPath, robot: RobotKeys) -> None:
    """Check calibration: equal current offsets were not measured, and motors would pull at zero effort."""
    if robot.hardware_version == "dRA1":
        return
    is_calibrating = opened.context.calibration_mode
    report = opened.warning if is_calibrating else opened.error
    mode = "" if is_calibrating else ", or calibration mode (trocar: {calibration_mode: true})"
    offsets = {int(actuator.drive.current_to_bits.offset) for actuator in robot.actuators}
    if len(robot.actuators) >= _MIN_FOR_CALIBRATION and len(offsets) == 1:
        where = (*key, "actuators", 0, "drive", "current_to_bits", "offset")
        text = f"robot {robot.name} is not calibrated: its {len(robot.actuators)} current offsets are all equal"
        report(where, text, f"offsets measured by the current calibration{mode}")
    if len(robot.actuators) == 1:
        pot = robot.actuators[0].potentiometer
        if pot and pot.voltage_to_position.scale == 0.0 and pot.voltage_to_position.offset == 0.0:
            where = (*key, "actuators", 0, "potentiometer", "voltage_to_position")
            report(where, "the potentiometer is not calibrated", f"scale or offset other than 0{mode}")


def _check_potentiometers(opened: IoOpened, key: KeyPath, robot: RobotKeys) -> None:
    pots = robot.potentiometers
    if pots is None:
        return
    where = (*key, "potentiometers")
    count = len(robot.actuators)
    if pots.tolerances and len(pots.tolerances) != count:
        opened.error((*where, "tolerances"), f"{len(pots.tolerances)} entries", f"{count}, one an actuator")
    for number, tolerance in enumerate(pots.tolerances):
        if tolerance.axis_id != number:
            here = (*where, "tolerances", number, "axis_id")
            opened.warning(here, "tolerances are used in their order, axis_id is not consulted", str(number))
    for number, (tolerance, actuator) in enumerate(zip(pots.tolerances, robot.actuators, strict=False)):
        here = (*where, "tolerances", number, "distance")
        check_tolerance(opened, here, tolerance.distance, actuator.joint_type, range_of(actuator))
    matrix = pots.coupling.JointToActuatorPosition if pots.coupling else None
    if matrix is not None and (len(matrix) != count or any(len(row) != count for row in matrix)):
        here = (*where, "coupling", "JointToActuatorPosition")
        opened.error(here, "wrong size", f"{count} rows of {count} numbers")


def _check_drive(opened: IoOpened, key: KeyPath, drive: DriveKeys) -> None:
    """Check that the scales of command and measurement agree, above all in sign."""
    product = drive.current_to_bits.scale * drive.bits_to_current.scale
    if not product > 0.0:
        where = (*key, "bits_to_current", "scale")
        opened.error(where, f"must have the sign of current_to_bits.scale ({drive.current_to_bits.scale})")
    elif abs(product - 1.0) > _SCALE_TOLERANCE:
        text = f"is not the inverse of current_to_bits.scale (their product is {product:.3g})"
        allowed = f"about {1 / drive.current_to_bits.scale:.6g}"
        opened.warning((*key, "bits_to_current", "scale"), text, allowed)


def range_of(actuator: ActuatorKeys) -> float:
    """The range between the soft limits of an actuator; 0: unknown."""
    limits = actuator.encoder.position_limits_soft if actuator.encoder is not None else None
    return limits.upper - limits.lower if limits is not None else 0.0


def _check_limits(opened: IoOpened, key: KeyPath, actuator: ActuatorKeys) -> None:
    encoder = actuator.encoder
    if encoder is None:
        return
    limits = encoder.position_limits_soft
    if limits.lower > limits.upper:
        where = (*key, "encoder", "position_limits_soft", "lower")
        opened.error(where, "above the upper limit", f"at most {limits.upper}")
    if limits.lower == limits.upper == 0.0 and actuator.drive.maximum_current > 0.0:
        where = (*key, "encoder", "position_limits_soft")
        opened.warning(where, "0 to 0: with a motor but no range the arm does not home", "lower below upper")
    check_range(opened, (*key, "encoder", "position_limits_soft", "upper"), limits.lower, limits.upper,
                actuator.joint_type)
    _check_full_scale(opened, (*key, "potentiometer", "voltage_to_position", "scale"), actuator)
    if encoder.bits_to_position.scale == 0.0:
        opened.error((*key, "encoder", "bits_to_position", "scale"), "must not be 0")


def _check_full_scale(opened: IoOpened, key: KeyPath, actuator: ActuatorKeys) -> None:
    """Check that a potentiometer measures about the range of its encoder's limits: both have the same unit."""
    pot, way = actuator.potentiometer, range_of(actuator)
    if pot is None or way <= 0.0:
        return
    measured = abs(pot.voltage_to_position.scale * pot.bits_to_voltage.scale) * _ADC
    if measured > 0.0 and not way / _POT_RANGES <= measured <= way * _POT_RANGES:
        text = f"this potentiometer measures {measured:.3g} in all, the encoder's limits are {way:.3g} apart"
        opened.warning(key, text, "the unit of the encoder, rad or m")
