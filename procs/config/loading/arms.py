"""The `arms` of a system with the files each of them names."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any, TypeVar

from trocar.procs.config.loading import convert
from trocar.procs.config.loading.buses import BusFiles, find_bus
from trocar.procs.config.loading.chains import load_chain
from trocar.procs.config.loading.context import Context, Opened
from trocar.procs.config.loading.derived_arms import DERIVED, derived_class, derived_commands, is_foreign
from trocar.procs.config.loading.instruments import psm_tools
from trocar.procs.config.loading.io_names import gripper_of, inputs_of, reader_of
from trocar.procs.config.loading.kinematic_arms import KINEMATIC, KINEMATIC_IO, kinematic_robot
from trocar.procs.config.loading.weights import measured_weight, weighing_links
from trocar.procs.config.models.arm_file import ArmFile, EcmFile, MtmFile, PsmFile
from trocar.procs.config.models.base_frame import base_frame_of
from trocar.procs.config.models.io_file import IoFile, RobotKeys
from trocar.procs.config.models.pid_file import PidFile
from trocar.procs.config.models.system_file import ArmKeys
from trocar.procs.config.models.trocar_section import TrocarSection
from trocar.procs.config.read.problem import Key
from trocar.procs.config.read.source import SourceFile
from trocar.procs.document import system as document
from trocar.procs.document.gravity_parameters import MasterGravityParameters
from trocar.procs.tables.arm_types import ARM_TYPES, class_of

AnyArmFile = TypeVar("AnyArmFile", bound=ArmFile)

_PSM_LINKS = 3  # the rest of the chain comes with the tool


@dataclass(frozen=True, slots=True)
class LoadedArm:
    """An arm with its robot and gains; those of kinds that are not started yet exist on emulated boards only."""

    arm: document.ArmConfig
    robot: document.Robot
    pid: document.PidConfig
    starts: bool
    pid_period_s: float = 0.0  # 0: that of its bus

    @property
    def is_kinematic(self) -> bool:
        """Played by io, without boards."""
        return self.arm.simulation == KINEMATIC

    @property
    def commanded(self) -> document.ArmConfig:
        """The arm as its process has it, which knows of no weight that it is not to compensate."""
        if not self.arm.skip_gravity_compensation:
            return self.arm
        return dataclasses.replace(self.arm, links=None, master_gravity=None)


@dataclass(frozen=True, slots=True)
class ArmPlace:
    """An arm, where it stands in the system file, and the bus it is on."""

    source: SourceFile
    index: int
    keys: ArmKeys
    bus: BusFiles | None

    @property
    def key(self) -> Key:
        """Its key in the system file."""
        return "arms", self.index

    @property
    def robot_name(self) -> str:
        """Its name in IO files and default file names."""
        return self.keys.name_on_IO or self.keys.name


def load_arm(
    context: Context,
    source: SourceFile,
    index: int,
    keys: ArmKeys,
    buses: dict[str, BusFiles],
    options: TrocarSection,
) -> LoadedArm | None:
    """One arm with all its files checked; None when it has errors or is of a kind whose files have no model yet."""
    key: Key = ("arms", index)
    family = keys.type.split("_")[0]
    kinematic = keys.simulation == KINEMATIC
    base_frame = base_frame_of(context, source, key, keys)
    bus = find_bus(context, source, (*key, "IO"), keys.IO, buses) if keys.IO and not kinematic else None
    place = ArmPlace(source, index, keys, bus)
    _check_required(context, place, family, kinematic)
    if keys.type.endswith("_GENERIC") or family not in ARM_TYPES:
        _load_other_files(context, place)
        if keys.type == "FOCUS_CONTROLLER":  # the rest is looked at in carts.py and third_parties.py
            context.notes.append(f"not started: {keys.name} ({keys.type}); the key ISI_focus_controller starts one")
        return None
    if kinematic:
        unused = f"; nothing of it on {keys.IO} is used" if keys.IO else ""
        context.notes.append(f"{keys.name} is KINEMATIC: its joints go where they are commanded{unused}")
    parts = _load_parts(context, place, family)
    return _loaded(context, place, parts, base_frame, options) if parts is not None else None


def _check_required(context: Context, place: ArmPlace, family: str, kinematic: bool) -> None:
    keys = place.keys
    required: list[str] = []
    if keys.type.endswith("_GENERIC"):
        pass  # which program is this arm is not for the file to say
    elif family in ARM_TYPES and not kinematic:
        required += ["IO", "serial"]
    elif keys.type == "SUJ_Classic" and not kinematic:
        required += ["IO"]
    if keys.type.endswith(DERIVED):
        required += ["component"]
    for name in required:
        if not getattr(keys, name):
            context.error(place.source, (*place.key, name), f"this key is required for {keys.type}", "a text")


@dataclass(frozen=True, slots=True)
class _Parts:
    """What the files of an arm of the usual kinds say."""

    arm_file: Opened[ArmFile]
    chain: document.Chain | None
    links: document.Chain | None
    master_gravity: MasterGravityParameters | None
    robot: tuple[Opened[IoFile], int, RobotKeys] | None
    pid: Opened[PidFile] | None
    gripper: str


def _load_parts(context: Context, place: ArmPlace, family: str) -> _Parts | None:
    """Arm file, kinematics, IO files and gains; None when there is no arm file."""
    keys, row = place.keys, ARM_TYPES[family]
    robot = _load_robot(context, place, row.actuators)
    gripper = _load_gripper(context, place) if row.has_gripper else ""
    opened = _open_arm_file(context, place, class_of(row.arm_file, ArmFile))
    generation = opened.content.generation if opened else "Classic"
    pid = None
    if keys.simulation != KINEMATIC or keys.PID_file:  # without a motor gains are good for nothing, but may be checked
        pid = _load_pid(context, place, row.gains.get(generation) or min(row.gains.values()), robot)
    if opened is None:
        return None
    content = opened.content
    chain, links = arm_chain(context, opened), weighing_links(context, opened.source, content, family)
    measured = measured_weight(context, opened.source, content) if isinstance(content, MtmFile) else None
    return _Parts(opened, chain, links, measured, robot, pid, gripper)


def _load_gripper(context: Context, place: ArmPlace) -> str:
    """The robot of a master's gripper, whose file is always there; "" without one."""
    keys, bus = place.keys, place.bus
    if bus is None or not (keys.serial or keys.IO_gripper_file):
        return ""
    file = keys.IO_gripper_file or f"sawRobotIO1394-{place.robot_name}-gripper-{keys.serial}.json"
    path = context.find(place.source, (*place.key, "IO_gripper_file"), (file,))
    opened = bus.add(context, path) if path is not None else None
    return gripper_of(opened.content if opened is not None else None, keys.name, place.robot_name)


def _open_arm_file(context: Context, place: ArmPlace, model: type[AnyArmFile]) -> Opened[AnyArmFile] | None:
    keys = place.keys
    where: Key = (*place.key, "arm_file")
    if not keys.arm_file and not keys.serial:
        if keys.simulation == KINEMATIC:
            context.error(place.source, where, "this key is required without a serial", "a file")
        return None  # otherwise the missing serial has been named already
    default = f"{place.robot_name}-{keys.serial}.json"
    path = context.find(place.source, where, (keys.arm_file or default,))
    return context.open(model, path) if path is not None else None


def arm_chain(context: Context, opened: Opened[AnyArmFile]) -> document.Chain | None:
    """The chain an arm file names."""
    search = context.search.first(opened.source.path.parent)
    path = context.find(opened.source, ("kinematic",), (opened.content.kinematic,), search)
    return load_chain(context, path) if path else None


def _load_robot(context: Context, place: ArmPlace, actuators: int) -> tuple[Opened[IoFile], int, RobotKeys] | None:
    """The robot of an arm: its IO file must have it, with the same serial number and the right size."""
    keys, bus, name = place.keys, place.bus, place.robot_name
    if bus is None or not (keys.serial or keys.IO_file):
        return None
    default = f"sawRobotIO1394-{name}-{keys.serial}.json"
    path = context.find(place.source, (*place.key, "IO_file"), (keys.IO_file or default,))
    opened = bus.add(context, path) if path is not None else None
    if path is None or opened is None:
        return None
    found = bus.robot(path, name)
    if found is None:
        names = ", ".join(robot.name for robot in opened.content.robots) or "no robot"
        text = f"arm {keys.name} needs the robot {name}, this file has {names}"
        context.error(opened.source, ("robots",), text, name)
        return None
    index, robot = found[1], found[2]
    if keys.serial and robot.serial_number != keys.serial:
        text = f"arm {keys.name} has the serial {keys.serial}, its robot {robot.name} has {robot.serial_number}"
        context.error(opened.source, ("robots", index, "serial_number"), text, f'"{keys.serial}"')
    if len(robot.actuators) != actuators and robot.number_of_actuators == len(robot.actuators):
        where: Key = ("robots", index, "number_of_actuators")
        context.error(opened.source, where, f"wrong number for {keys.type} {keys.name}", str(actuators))
    return found


def _load_pid(
    context: Context, place: ArmPlace, default: str, robot: tuple[Opened[IoFile], int, RobotKeys] | None
) -> Opened[PidFile] | None:
    path = context.find(place.source, (*place.key, "PID_file"), (place.keys.PID_file or default,))
    opened = context.open(PidFile, path) if path is not None else None
    if opened is not None:
        check_pid(context, opened, robot[2] if robot else None)
    return opened


def check_pid(context: Context, opened: Opened[PidFile], robot: RobotKeys | None) -> None:
    """Whether the entries are in order, named once, and fit the actuators of `robot` (when known)."""
    source, axes = opened.source, opened.content.pid
    names: set[str] = set()
    if robot is not None and len(axes) != len(robot.actuators):
        text = f"{len(axes)} entries, robot {robot.name} has {len(robot.actuators)} actuators"
        context.error(source, ("pid",), text, f"{len(robot.actuators)} entries")
    for number, axis in enumerate(axes):
        key: Key = ("pid", number)
        if axis.index != number:
            context.error(source, (*key, "index"), "must be its place in the list", str(number))
        if axis.name in names:
            context.error(source, (*key, "name"), "used twice", "a name of its own for every entry")
        names.add(axis.name)
        if not source.has((*key, "pid_max_output")):
            text = "absent: 0 is used, which means no effort"
            context.warning(source, (*key, "pid_max_output"), text, "-1: no limit")
        if robot is not None and number < len(robot.actuators):
            joint_type = robot.actuators[number].joint_type
            if axis.type != joint_type:
                text = f"actuator {number} of robot {robot.name} is {joint_type}"
                context.error(source, (*key, "type"), text, joint_type)


def _loaded(
    context: Context, place: ArmPlace, parts: _Parts, base_frame: document.Matrix | None, options: TrocarSection
) -> LoadedArm | None:
    content, source, keys = parts.arm_file.content, parts.arm_file.source, place.keys
    if isinstance(content, PsmFile):
        _check_psm(context, Opened(source, content), parts.chain)
    own = _own_values(context, place, parts, options)
    starts = _can_start(context, place, parts)
    driven = _driven(context, place, parts, drives=bool(starts))
    if starts is None or parts.chain is None or driven is None:
        return None
    robot, pid = driven
    arm = document.ArmConfig(
        name=keys.name,
        type=keys.type.removesuffix(DERIVED),
        generation=content.generation,
        serial=keys.serial,
        io=KINEMATIC_IO if keys.simulation == KINEMATIC else keys.IO,
        robot=robot.name,
        simulation=keys.simulation,
        period_s=keys.period,
        chain=parts.chain,
        links=parts.links,
        homing_zero_position=_homes_to_zero(content),
        inputs=inputs_of(place.bus, keys.name, place.robot_name),
        mounting_pitch=content.mounting_pitch,
        re_home=content.re_home,
        skip_gravity_compensation=content.skip_gravity_compensation,
        base_frame=base_frame,
        reference_frame=(keys.base_frame.reference_frame or "") if keys.base_frame else "",
        calibration_mode=options.calibration_mode,
        source=str(source.path),
        derived=derived_class(context, place.source, (*place.key, "component"), keys),
        commands=derived_commands(context, place.source, keys, options),
        **convert.options(options.arm, document.ArmConfig),
        **own,
    )
    row = ARM_TYPES.get(arm.type)
    if row is not None and keys.simulation != KINEMATIC and len(pid.axes) == row.actuators:
        pid = dataclasses.replace(pid, max_speeds=row.max_speeds)
    return LoadedArm(arm, robot, pid, starts, keys.PID_period)


def _homes_to_zero(content: ArmFile) -> bool:
    """As the file says; without a word masters go to zero, others stay where they are."""
    reported = content.homing_zero_position
    return isinstance(content, MtmFile) if reported is None else reported


def _own_values(context: Context, place: ArmPlace, parts: _Parts, options: TrocarSection) -> dict[str, Any]:
    """Fields of `document.Arm` that only arms of this kind have."""
    content, name = parts.arm_file.content, place.keys.name
    if isinstance(content, PsmFile):
        tools = psm_tools(context, place.source, name, Opened(parts.arm_file.source, content), options)
        robot = parts.robot[2] if parts.robot is not None else None
        return {"tool_detection": content.tool_detection, "tool": tools.fixed, "tools": tools.all,
                "cannula_depth": content.cannula_depth or 0.0,
                "instrument_reader": reader_of(place.bus, name, place.robot_name, robot)}
    if isinstance(content, EcmFile):
        return {"endoscope": content.endoscope}
    if isinstance(content, MtmFile):
        return {"master_gravity": parts.master_gravity, "platform_gain": content.platform_gain,
                "gripper": parts.gripper, "gripper_debounce_s": content.gripper_events_debounce,
                "gripper_zero": content.gripper_events_zero}
    return {}


def _driven(
    context: Context, place: ArmPlace, parts: _Parts, *, drives: bool
) -> tuple[document.Robot, document.PidConfig] | None:
    """What io has of an arm: from its IO and PID files, or, KINEMATIC, from its chain; None when something is missing.

    `drives`: somebody will move it.
    """
    name = place.keys.name
    if place.keys.simulation == KINEMATIC:
        if parts.chain is None:
            return None
        actuators = ARM_TYPES[place.keys.type.split("_")[0]].actuators
        return kinematic_robot(context, parts.arm_file.source, name, place.index, parts.chain, actuators)
    if parts.robot is None or parts.pid is None or place.bus is None:
        return None
    if drives:
        _check_drivable(context, parts.robot)
    opened, index, robot = parts.robot
    path = opened.source.path
    pid = convert.pid(parts.pid.content, robot.name, name, str(parts.pid.source.path))
    return convert.robot(robot, str(path), place.bus.tables.get((path, index), "")), pid


def _check_psm(context: Context, opened: Opened[PsmFile], chain: document.Chain | None) -> None:
    if chain is not None and len(chain.links) != _PSM_LINKS:
        text = f"chain of {len(chain.links)} rows for a PSM"
        context.error(opened.source, ("kinematic",), text, f"{_PSM_LINKS} rows, the others come with the tool")
    if opened.content.generation == "Si" and opened.content.mounting_pitch is None:
        text = "this key is required for a PSM Si"
        context.error(opened.source, ("mounting_pitch",), text, "rad; usually -0.7854, PSM3 -0.2618")


def _can_start(context: Context, place: ArmPlace, parts: _Parts) -> bool | None:
    """Whether this arm is of a kind that runs already; a note when it is not, None when nobody can tell."""
    keys, generation = place.keys, parts.arm_file.content.generation
    if is_foreign(context, keys):
        return False
    family = keys.type.removesuffix(DERIVED)
    if family not in ARM_TYPES or generation not in ARM_TYPES[family].gains:
        context.notes.append(f"not started yet: {keys.name} ({keys.type} {generation})")
        return False
    if parts.robot is not None and parts.robot[2].hardware_version == "HARDWARE_UNDEFINED":
        where: Key = ("robots", parts.robot[1], "hardware_version")
        context.error(parts.robot[0].source, where, "the controllers must be stated", "QLA1, DQLA or dRA1")
        return None
    return True


def _check_drivable(context: Context, found: tuple[Opened[IoFile], int, RobotKeys]) -> None:
    """Every axis of an arm that is moved needs an encoder and a way from effort to current."""
    opened, index, robot = found
    for number, actuator in enumerate(robot.actuators):
        key: Key = ("robots", index, "actuators", number)
        if actuator.encoder is None:
            context.error(opened.source, (*key, "encoder"), "this key is required for an arm that moves", "an object")
        if actuator.drive.maximum_current == 0.0:
            where = (*key, "drive", "maximum_current")
            context.warning(opened.source, where, "0 A is used: this axis can never pull", "above 0.0")
        if actuator.drive.effort_to_current.scale == 0.0:
            where = (*key, "drive", "effort_to_current", "scale")
            context.error(opened.source, where, "must not be 0 for an arm that moves", "A per N·m or N")


def _load_other_files(context: Context, place: ArmPlace) -> None:
    """Kinds whose files have no model yet: the files must exist and be readable."""
    keys, source, key = place.keys, place.source, place.key
    if keys.arm_file:
        path = context.find(source, (*key, "arm_file"), (keys.arm_file,))
        if path is not None:
            context.read(path)
    if keys.IO_file and place.bus is not None:
        path = context.find(source, (*key, "IO_file"), (keys.IO_file,))
        if path is not None:
            place.bus.add(context, path)
