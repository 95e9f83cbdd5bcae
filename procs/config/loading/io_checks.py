"""What must hold inside an IO file and between the IO files of one bus, beyond the types of their values."""

from __future__ import annotations

from collections.abc import Iterator

from trocar.procs.config.loading.context import Context, Opened
from trocar.procs.config.models.io_file import ActuatorKeys, BrakeKeys, DriveKeys, IoFile, RobotKeys
from trocar.procs.config.read.problem import Key
from trocar.procs.config.read.source import SourceFile

IoOpened = Opened[IoFile]

AXES = {"QLA1": 4, "DQLA": 8, "dRA1": 10, "HARDWARE_UNDEFINED": 10}
_MIN_FOR_CALIBRATION = 3  # with fewer actuators equal offsets are no sign of a missing calibration
_SCALE_TOLERANCE = 0.05


def check_io_file(context: Context, opened: IoOpened) -> None:
    """Counts, axes, calibration and scales of every robot in one file."""
    source = opened.source
    for index, robot in enumerate(opened.content.robots):
        key: Key = ("robots", index)
        _check_counts(context, source, key, robot)
        _check_axes(context, source, index, robot)
        _check_calibration(context, source, key, robot)
        _check_potentiometers(context, source, key, robot)
        for where, part in parts_of(index, robot):
            _check_drive(context, source, (*where, "drive"), part.drive)
        for number, actuator in enumerate(robot.actuators):
            _check_limits(context, source, (*key, "actuators", number), actuator)


def check_bus(context: Context, files: list[IoOpened]) -> None:
    """Between all files of one bus: names, axes and hardware versions that exclude each other."""
    axes: dict[tuple[object, object], str] = {}
    hardware: dict[int, tuple[str, str]] = {}
    names: dict[tuple[object, object], str] = {}
    for opened in files:
        source = opened.source
        for kind, key, name in _names(opened.content):
            _once(context, source, key, names, (kind, name), f"{kind} name")
        for index, robot in enumerate(opened.content.robots):
            for key, part in parts_of(index, robot):
                if part.axis_id >= 0:
                    place = (part.board_id, part.axis_id)
                    _once(context, source, (*key, "axis_id"), axes, place, f"board {place[0]} axis {place[1]}")
                first = hardware.setdefault(part.board_id, (robot.hardware_version, robot.name))
                if first[0] != robot.hardware_version:
                    context.error(
                        source,
                        ("robots", index, "hardware_version"),
                        f"board {part.board_id} is {first[0]} for robot {first[1]}",
                        "one hardware version for each board",
                    )
                    break


def board_ids(content: IoFile) -> dict[int, str]:
    """Every board a file uses (robots, brakes, inputs, outputs, instrument memories) and its hardware version."""
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


def _once(
    context: Context,
    source: SourceFile,
    key: Key,
    seen: dict[tuple[object, object], str],
    item: tuple[object, object],
    what: str,
) -> None:
    if item in seen:
        context.error(source, key, f"{what} is used twice, first in {seen[item]}", "each only once on a bus")
    else:
        problem = source.problem(key, "")
        seen[item] = f"{problem.file}:{problem.line}"


def _names(content: IoFile) -> Iterator[tuple[str, Key, str]]:
    for index, robot in enumerate(content.robots):
        yield "robot", ("robots", index, "name"), robot.name
    for index, button in enumerate(content.digital_inputs):
        yield "digital input", ("digital_inputs", index, "name"), button.name
    for index, output in enumerate(content.digital_outputs):
        yield "digital output", ("digital_outputs", index, "name"), output.name
    for index, chip in enumerate(content.dallas_chips):
        yield "dallas chip", ("dallas_chips", index, "name"), chip.name


def parts_of(index: int, robot: RobotKeys) -> Iterator[tuple[Key, ActuatorKeys | BrakeKeys]]:
    """Everything of a robot that hangs on an axis of a board, and where it stands in the file."""
    for number, actuator in enumerate(robot.actuators):
        yield ("robots", index, "actuators", number), actuator
    for number, brake in enumerate(robot.brakes):
        yield ("robots", index, "brakes", number), brake


def _check_counts(context: Context, source: SourceFile, key: Key, robot: RobotKeys) -> None:
    for name, stated, listed in (
        ("number_of_actuators", robot.number_of_actuators, len(robot.actuators)),
        ("number_of_brakes", robot.number_of_brakes, len(robot.brakes)),
    ):
        if stated != listed:
            context.error(source, (*key, name), f"the list has {listed} entries", str(listed))


def _check_axes(context: Context, source: SourceFile, index: int, robot: RobotKeys) -> None:
    axes = AXES[robot.hardware_version]
    for part_key, part in parts_of(index, robot):
        if not 0 <= part.axis_id < axes:
            where = (*part_key, "axis_id")
            text = "this axis does not exist" if source.has(where) else "this key is required"
            context.error(source, where, text, f"0 to {axes - 1} on {robot.hardware_version}")


def _check_calibration(context: Context, source: SourceFile, key: Key, robot: RobotKeys) -> None:
    """Equal current offsets everywhere mean that nobody measured them: the motors would pull when asked for nothing."""
    if robot.hardware_version == "dRA1":
        return
    report = context.warning if context.calibration_mode else context.error
    mode = ", or calibration mode (trocar: {calibration_mode: true})" if not context.calibration_mode else ""
    offsets = {int(actuator.drive.current_to_bits.offset) for actuator in robot.actuators}
    if len(robot.actuators) >= _MIN_FOR_CALIBRATION and len(offsets) == 1:
        where = (*key, "actuators", 0, "drive", "current_to_bits", "offset")
        text = f"robot {robot.name} is not calibrated: its {len(robot.actuators)} current offsets are all equal"
        report(source, where, text, f"offsets measured by the current calibration{mode}")
    if len(robot.actuators) == 1:
        pot = robot.actuators[0].potentiometer
        if pot and pot.voltage_to_position.scale == 0.0 and pot.voltage_to_position.offset == 0.0:
            where = (*key, "actuators", 0, "potentiometer", "voltage_to_position")
            report(source, where, "the potentiometer is not calibrated", f"scale or offset other than 0{mode}")


def _check_potentiometers(context: Context, source: SourceFile, key: Key, robot: RobotKeys) -> None:
    pots = robot.potentiometers
    if pots is None:
        return
    where = (*key, "potentiometers")
    count = len(robot.actuators)
    if pots.tolerances and len(pots.tolerances) != count:
        context.error(source, (*where, "tolerances"), f"{len(pots.tolerances)} entries", f"{count}, one an actuator")
    for number, tolerance in enumerate(pots.tolerances):
        if tolerance.axis_id != number:
            here = (*where, "tolerances", number, "axis_id")
            context.warning(source, here, "tolerances are used in their order, axis_id is not consulted", str(number))
    matrix = pots.coupling.JointToActuatorPosition if pots.coupling else None
    if matrix is not None and (len(matrix) != count or any(len(row) != count for row in matrix)):
        here = (*where, "coupling", "JointToActuatorPosition")
        context.error(source, here, "wrong size", f"{count} rows of {count} numbers")


def _check_drive(context: Context, source: SourceFile, key: Key, drive: DriveKeys) -> None:
    """Commanding and measuring must agree, above all in sign."""
    product = drive.current_to_bits.scale * drive.bits_to_current.scale
    if not product > 0.0:
        where = (*key, "bits_to_current", "scale")
        context.error(source, where, f"must have the sign of current_to_bits.scale ({drive.current_to_bits.scale})")
    elif abs(product - 1.0) > _SCALE_TOLERANCE:
        text = f"is not the inverse of current_to_bits.scale (their product is {product:.3g})"
        allowed = f"about {1 / drive.current_to_bits.scale:.6g}"
        context.warning(source, (*key, "bits_to_current", "scale"), text, allowed)


def _check_limits(context: Context, source: SourceFile, key: Key, actuator: ActuatorKeys) -> None:
    encoder = actuator.encoder
    if encoder is None:
        return
    limits = encoder.position_limits_soft
    if limits.lower > limits.upper:
        where = (*key, "encoder", "position_limits_soft", "lower")
        context.error(source, where, "above the upper limit", f"at most {limits.upper}")
    if limits.lower == limits.upper == 0.0 and actuator.drive.maximum_current > 0.0:
        where = (*key, "encoder", "position_limits_soft")
        context.warning(source, where, "0 to 0: with a motor but no range the arm does not home", "lower below upper")
    if encoder.bits_to_position.scale == 0.0:
        context.error(source, (*key, "encoder", "bits_to_position", "scale"), "must not be 0")
