"""Consistency checks within an IO file and between the IO files of one bus."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

from trocar.procs.config.loading.context import MEASURES, Opened
from trocar.procs.config.models.io_file import IoFile, RobotKeys
from trocar.procs.config.read.quantities import check_range, check_tolerance
from trocar.procs.document.system import Actuator, Brake, DigitalInput, DigitalOutput, InstrumentReader
from trocar.procs.fpga.conversion import are_nominal

IoOpened = Opened[IoFile]
Robot = Opened[RobotKeys]
Named = RobotKeys | DigitalInput | DigitalOutput | InstrumentReader

AXES = {"QLA1": 4, "DQLA": 8, "dRA1": 10, "HARDWARE_UNDEFINED": 10}
_SCALE_TOLERANCE = 0.05
_DAC = 2**15  # bits of the commanded current, either sign
_ADC = 2**16  # values of a potentiometer's converter
_POT_RANGES = 10.0  # a potentiometer may measure so many times the range of its joint, or the range so many times that


def check_io_file(opened: IoOpened) -> None:
    """Check counts, axes, calibration and scales of every robot in one file."""
    for robot in robots_of(opened):
        _check_counts(robot)
        _check_axes(robot)
        _check_calibration(robot)
        _check_potentiometers(robot)
        for part in parts_of(robot):
            _check_drive(part)
        for actuator in robot.each("actuators", robot.content.actuators):
            _check_limits(actuator)


def check_bus(files: list[IoOpened]) -> None:
    """Check all files of one bus for conflicting names, axes and hardware versions."""
    used: dict[tuple[object, object], str] = {}
    hardware: dict[int, tuple[str, str]] = {}
    for opened in files:
        for kind, row in _named(opened):
            _once(row, "name", used, (kind, row.content.name), f"{kind} name", row.error)
        for button in opened.each("digital_inputs", opened.content.digital_inputs):
            bit = (button.content.board_id, button.content.bit_id)
            _once(button, "bit_id", used, ("bit", bit), f"bit {bit[1]} of board {bit[0]}", button.warning)
        for robot in robots_of(opened):
            version, name = robot.content.hardware, robot.content.name
            for part in parts_of(robot):
                board, axis = part.content.board_id, part.content.axis_id
                if axis >= 0:
                    _once(part, "axis_id", used, (board, axis), f"board {board} axis {axis}", part.error)
                first = hardware.setdefault(board, (version, name))
                if first[0] != version:
                    text = f"board {board} is {first[0]} for robot {first[1]}"
                    robot.error("hardware_version", text, "one hardware version for each board")
                    break


def board_ids(content: IoFile) -> dict[int, str]:
    """All boards that a file uses (robots, brakes, inputs, outputs, instrument memories), with hardware versions."""
    boards: dict[int, str] = {}
    for robot in content.robots:
        for board in [part.board_id for rows in (robot.actuators, robot.brakes) for part in rows]:
            boards.setdefault(board, robot.hardware)
    others = (content.digital_inputs, content.digital_outputs, content.dallas_chips)
    for board in [row.board_id for rows in others for row in rows]:
        boards.setdefault(board, "HARDWARE_UNDEFINED")
    return boards


def _once(part: Opened[object], key: str, seen: dict[tuple[object, object], str], item: tuple[object, object],
          what: str, report: Callable[[str, str, str], None]) -> None:
    if item in seen:
        report(key, f"{what} is used twice, first in {seen[item]}", "each only once on a bus")
    else:
        problem = part.source.problem(part.path(key), "")
        seen[item] = f"{problem.file}:{problem.line}"


def _named(opened: IoOpened) -> Iterator[tuple[str, Opened[Named]]]:
    for kind in ("robot", "digital input", "digital output", "dallas chip"):
        name = f"{kind.replace(' ', '_')}s"
        rows: Sequence[Named] = getattr(opened.content, name)
        yield from ((kind, row) for row in opened.each(name, rows))


def robots_of(opened: IoOpened) -> Iterator[Robot]:
    """The robots of a file."""
    return opened.each("robots", opened.content.robots)


def parts_of(robot: Robot) -> Iterator[Opened[Actuator | Brake]]:
    """All actuators and brakes of a robot."""
    yield from robot.each("actuators", robot.content.actuators)
    yield from robot.each("brakes", robot.content.brakes)


def _check_counts(robot: Robot) -> None:
    content = robot.content
    for name, stated, listed in (
        ("number_of_actuators", content.number_of_actuators, len(content.actuators)),
        ("number_of_brakes", content.number_of_brakes, len(content.brakes)),
    ):
        if stated != listed:
            robot.error(name, f"the list has {listed} entries", str(listed))
    for number, actuator in enumerate(robot.each("actuators", content.actuators)):
        if actuator.source.at(actuator.path("actuator_id")) not in (None, number):
            actuator.warning("actuator_id", "actuators are used in their order, actuator_id is not consulted",
                             str(number))


def _check_axes(robot: Robot) -> None:
    version = robot.content.hardware
    for part in parts_of(robot):
        if not 0 <= part.content.axis_id < AXES[version]:
            text = "this axis does not exist" if part.has("axis_id") else "this key is required"
            part.error("axis_id", text, f"0 to {AXES[version] - 1} on {version}")


def _check_calibration(robot: Robot) -> None:
    """Check calibration: equal current offsets were not measured, and motors would pull at zero effort."""
    content = robot.content
    if content.hardware == "dRA1":
        return
    is_calibrating = robot.context.calibration_mode
    report = robot.warning if is_calibrating else robot.error
    mode = "" if is_calibrating else ", or calibration mode (trocar: {calibration_mode: true})"
    if are_nominal([actuator.current_to_bits.offset for actuator in content.actuators]):
        text = f"robot {content.name} is not calibrated: its {len(content.actuators)} current offsets are all equal"
        report(("actuators", 0, "drive", "current_to_bits", "offset"), text,
               f"offsets of these controllers: {MEASURES % 'currents'} measures them{mode}")
    if len(content.actuators) == 1:
        pot = content.actuators[0].potentiometer
        if pot and pot.voltage_to_position.scale == 0.0 and pot.voltage_to_position.offset == 0.0:
            report(("actuators", 0, "potentiometer", "voltage_to_position"), "the potentiometer is not calibrated",
                   f"scale or offset other than 0: {MEASURES % 'calibrate'} measures them{mode}")


def _check_potentiometers(robot: Robot) -> None:
    pots, actuators = robot.content.potentiometers, robot.content.actuators
    if pots is None:
        return
    count = len(actuators)
    if pots.tolerances and len(pots.tolerances) != count:
        robot.error("potentiometers.tolerances", f"{len(pots.tolerances)} entries", f"{count}, one an actuator")
    rows = list(robot.each("potentiometers.tolerances", pots.tolerances))
    for number, row in enumerate(rows):
        if row.source.at(row.path("axis_id")) != number:
            row.warning("axis_id", "tolerances are used in their order, axis_id is not consulted", str(number))
    for row, actuator in zip(rows, actuators, strict=False):
        check_tolerance(row, "distance", row.content.distance, actuator.joint_type, range_of(actuator))
    matrix = pots.coupling.JointToActuatorPosition if pots.coupling else None
    if matrix is not None and (len(matrix) != count or any(len(row) != count for row in matrix)):
        robot.error("potentiometers.coupling.JointToActuatorPosition", "wrong size", f"{count} rows of {count} numbers")


def _check_drive(part: Opened[Actuator | Brake]) -> None:
    """Check that the scales of command and measurement agree, above all in sign."""
    command = part.content.current_to_bits.scale
    product = command * part.content.bits_to_current.scale
    if not product > 0.0:
        part.error("drive.bits_to_current.scale", f"must have the sign of current_to_bits.scale ({command})")
    elif abs(product - 1.0) > _SCALE_TOLERANCE:
        text = f"is not the inverse of current_to_bits.scale (their product is {product:.3g})"
        part.warning("drive.bits_to_current.scale", text, f"about {1 / command:.6g}")
    if part.content.maximum_current * abs(command) > _DAC:
        part.warning("drive.maximum_current", "more than the controller can command",
                     f"at most {_DAC / abs(command):.3g} A")


def range_of(actuator: Actuator) -> float:
    """The range between the soft limits of an actuator; 0: unknown."""
    encoder = actuator.encoder
    return encoder.upper - encoder.lower if encoder is not None else 0.0


def _check_limits(part: Opened[Actuator]) -> None:
    actuator, encoder = part.content, part.content.encoder
    if encoder is None:
        return
    if encoder.lower > encoder.upper:
        part.error("encoder.position_limits_soft.lower", "above the upper limit", f"at most {encoder.upper}")
    if encoder.lower == encoder.upper == 0.0 and actuator.maximum_current > 0.0:
        part.warning("encoder.position_limits_soft", "0 to 0: has a motor but no range; the arm does not home",
                     "lower below upper")
    check_range(part, "encoder.position_limits_soft.upper", encoder.lower, encoder.upper, actuator.joint_type)
    _check_full_scale(part)
    if encoder.bits_to_position.scale == 0.0:
        part.error("encoder.bits_to_position.scale", "must not be 0")


def _check_full_scale(part: Opened[Actuator]) -> None:
    """Check that a potentiometer measures about the range of its encoder's limits: both have the same unit."""
    pot, way = part.content.potentiometer, range_of(part.content)
    if pot is None or way <= 0.0:
        return
    measured = abs(pot.voltage_to_position.scale * pot.bits_to_voltage.scale) * _ADC
    if measured > 0.0 and not way / _POT_RANGES <= measured <= way * _POT_RANGES:
        text = f"this potentiometer measures {measured:.3g} in all, the encoder's limits are {way:.3g} apart"
        part.warning("potentiometer.voltage_to_position.scale", text, "the unit of the encoder, rad or m")
