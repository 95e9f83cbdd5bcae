"""Loads the `arms` of a system with the files that they name."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

from trocar.procs.config.loading import convert
from trocar.procs.config.loading.buses import BusFiles, SystemFiles, gripper_of, inputs_of, reader_of
from trocar.procs.config.loading.chains import (
    KINEMATIC,
    KINEMATIC_IO,
    arm_chain,
    kinematic_robot,
    measured_weight,
    weighing_links,
)
from trocar.procs.config.loading.context import Opened
from trocar.procs.config.loading.instruments import psm_tools
from trocar.procs.config.loading.io_checks import range_of
from trocar.procs.config.loading.user_code import DERIVED, derived_class, derived_commands
from trocar.procs.config.models.arm_file import ArmFile, MtmFile, PsmFile
from trocar.procs.config.models.io_file import IoFile, RobotKeys
from trocar.procs.config.models.pid_file import PidFile
from trocar.procs.config.models.system_file import ArmKeys
from trocar.procs.config.read.matrices import check_rigid
from trocar.procs.config.read.problem import KeyPath
from trocar.procs.config.read.units import check_tolerance
from trocar.procs.document import system as document
from trocar.procs.tables.arm_types import ARM_TYPES, ArmType, class_of

_PSM_LINKS = 3  # the tool has the rest of the chain


@dataclass(frozen=True, slots=True)
class LoadedArm:
    """An arm with its robot and gains; kinds that are not started yet exist only on emulated boards."""

    arm: document.ArmConfig
    robot: document.Robot
    pid: document.PidConfig
    starts: bool
    pid_period_s: float = 0.0  # 0: that of its bus

    @property
    def is_kinematic(self) -> bool:
        """Whether it has no boards, only ideal joints in io."""
        return self.arm.simulation == KINEMATIC

    @property
    def commanded(self) -> document.ArmConfig:
        """The arm for its process: without masses if gravity compensation is skipped."""
        if not self.arm.skip_gravity_compensation:
            return self.arm
        return dataclasses.replace(self.arm, links=None, master_gravity=None)


@dataclass(frozen=True, slots=True)
class RobotPlace:
    """The robot of an arm, and its key in the IO file."""

    file: Opened[IoFile]
    key: KeyPath
    keys: RobotKeys


def load_arms(system: SystemFiles) -> list[LoadedArm]:
    """All arms without errors whose files have a model, with all their files checked."""
    loaders = [_ArmLoader(system, index, keys) for index, keys in enumerate(system.content.arms)]
    return [arm for loader in loaders if (arm := loader.load()) is not None]


def base_frame_of(system: Opened[object], key: KeyPath, keys: ArmKeys) -> document.Matrix | None:
    """The fixed base frame of an arm; None without one, or when another component provides it."""
    frame = keys.base_frame
    if frame is None:
        return None
    where = (*key, "base_frame")
    fixed = (frame.reference_frame is not None, frame.transform is not None)
    driven = (frame.component is not None, frame.interface is not None)
    if any(fixed) == any(driven) or any(fixed) != all(fixed) or any(driven) != all(driven):
        forms = "either reference_frame and transform, or component and interface"
        system.error(where, "both forms or half a form", forms)
        return None
    if frame.transform is None:  # `carts.py` checks the component that provides it
        return None
    return frame.transform if check_rigid(system, (*where, "transform"), frame.transform) else None


def check_pid(opened: Opened[PidFile], robot: RobotKeys | None) -> None:
    """Check that entries are in order, have unique names, and fit the actuators of `robot` (if given)."""
    axes = opened.content.pid
    names: set[str] = set()
    if robot is not None and len(axes) != len(robot.actuators):
        text = f"{len(axes)} entries, robot {robot.name} has {len(robot.actuators)} actuators"
        opened.error(("pid",), text, f"{len(robot.actuators)} entries")
    for number, axis in enumerate(axes):
        key: KeyPath = ("pid", number)
        if axis.index != number:
            opened.error((*key, "index"), "must be its position in the list", str(number))
        if axis.name in names:
            opened.error((*key, "name"), "used twice", "a unique name for every entry")
        names.add(axis.name)
        if not opened.source.has((*key, "pid_max_output")):
            opened.warning((*key, "pid_max_output"), "absent: 0 is used, which means no effort", "-1: no limit")
        actuator = robot.actuators[number] if robot is not None and number < len(robot.actuators) else None
        where, tolerance = (*key, "p_measured_setpoint_tolerance"), float(axis.model_dump()["tolerance"])
        if tolerance == 0.0:
            opened.warning(where, "0: the smallest error is a fault", "above 0, rad or m")
        check_tolerance(opened, where, tolerance, axis.type, range_of(actuator) if actuator is not None else 0.0)
        if robot is not None and actuator is not None:
            joint_type = actuator.joint_type
            if axis.type != joint_type:
                text = f"actuator {number} of robot {robot.name} is {joint_type}"
                opened.error((*key, "type"), text, joint_type)


@dataclass(slots=True)
class _ArmLoader:
    """Loads one arm of the system file into the document."""

    system: SystemFiles
    index: int
    keys: ArmKeys

    @property
    def key(self) -> KeyPath:
        """The arm's key in the system file."""
        return "arms", self.index

    @property
    def family(self) -> str:
        """The type without a suffix such as _DERIVED."""
        return str(self.keys.type).split("_")[0]

    @property
    def robot_name(self) -> str:
        """The arm's name in IO files and default file names."""
        return self.keys.name_on_IO or self.keys.name

    @property
    def is_kinematic(self) -> bool:
        """Whether it is KINEMATIC, i.e. has no boards."""
        return self.keys.simulation == KINEMATIC

    @property
    def bus(self) -> BusFiles | None:
        """The arm's bus; None if it is KINEMATIC, or the bus is unknown."""
        return self.system.buses.get(self.keys.IO) if not self.is_kinematic else None

    def load(self) -> LoadedArm | None:
        """Load the arm and check all its files; None with errors, or for a kind whose files have no model yet."""
        keys = self.keys
        base_frame = base_frame_of(self.system, self.key, keys)
        if keys.IO and not self.is_kinematic:
            self.system.find_bus((*self.key, "IO"), keys.IO)
        self._check_required()
        if keys.type.endswith("_GENERIC") or self.family not in ARM_TYPES:
            self._read_other_files()
            if keys.type == "FOCUS_CONTROLLER":  # other types are checked in carts.py and consoles.py
                self.system.note(f"not started: {keys.name} ({keys.type}); the key ISI_focus_controller starts one")
            return None
        if self.is_kinematic:
            unused = f"; its part of {keys.IO} is not used" if keys.IO else ""
            self.system.note(f"{keys.name} is KINEMATIC: positions follow the setpoints exactly{unused}")
        return self._load_files(ARM_TYPES[self.family], base_frame)

    def _check_required(self) -> None:
        keys = self.keys
        required: list[str] = []
        if not self.is_kinematic and not keys.type.endswith("_GENERIC"):  # files need not name a third-party program
            required += ["IO", "serial"] if self.family in ARM_TYPES else ["IO"] if keys.type == "SUJ_Classic" else []
        if keys.type.endswith(DERIVED):
            required += ["component"]
        for name in required:
            if not getattr(keys, name):
                self.system.error((*self.key, name), f"this key is required for {keys.type}", "a text")

    def _read_other_files(self) -> None:
        """For kinds whose files have no model yet: check that the files exist and are readable."""
        if self.keys.arm_file:
            path = self.system.find((*self.key, "arm_file"), self.keys.arm_file)
            if path is not None:
                self.system.context.read(path)
        if self.keys.IO_file and self.bus is not None:
            self.bus.add(self.system.context, self.system.find((*self.key, "IO_file"), self.keys.IO_file))

    # -- its files -----------------------------------------------------------------------------------------------------

    def _load_files(self, row: ArmType, base_frame: document.Matrix | None) -> LoadedArm | None:
        """Load IO files, arm file, gains and kinematics; None without an arm file, or with errors."""
        robot = self._load_robot(row.actuators)
        gripper = self._load_gripper() if row.has_gripper else ""
        opened = self._open_arm_file(class_of(row.arm_file, ArmFile))
        generation = opened.content.generation if opened else "Classic"
        pid = None
        if not self.is_kinematic or self.keys.PID_file:  # KINEMATIC: gains are unused, but checked
            pid = self._open_pid(row.gains.get(generation) or min(row.gains.values()), robot)
        if opened is None:
            return None
        content, keys = opened.content, self.keys
        chain, links = arm_chain(opened), weighing_links(opened, self.family)
        measured = measured_weight(opened, tuple(dict.fromkeys((keys.name, self.robot_name))), keys.serial)
        if isinstance(content, PsmFile):
            self._check_psm(opened, chain)
        own = self._own_values(opened, robot, gripper)
        starts = self._can_start(content, robot)
        driven = self._driven(opened, chain, robot, pid, drives=bool(starts))
        if starts is None or chain is None or driven is None:
            return None
        made, controller = driven
        arm = convert.by_name(
            document.ArmConfig, keys, content, self.system.options.arm,
            type=keys.type.removesuffix(DERIVED),
            io=KINEMATIC_IO if self.is_kinematic else keys.IO,
            robot=made.name,
            period_s=self.system.own(keys.name).period_s or self.system.options.arm.period_s or keys.period,
            chain=chain,
            links=links,
            master_gravity=measured,
            homing_zero_position=_homes_to_zero(content),
            inputs=inputs_of(self.bus, keys.name, self.robot_name),
            base_frame=base_frame,
            reference_frame=(keys.base_frame.reference_frame or "") if keys.base_frame else "",
            calibration_mode=self.system.options.calibration_mode,
            source=str(opened.source.path),
            derived=derived_class(self.system, (*self.key, "component"), keys),
            commands=derived_commands(self.system, keys),
            **own,
        )
        if not self.is_kinematic and len(controller.axes) == row.actuators:
            controller = dataclasses.replace(controller, max_speeds=row.max_speeds)
        return LoadedArm(arm, made, controller, starts, keys.PID_period)

    def _load_robot(self, actuators: int) -> RobotPlace | None:
        """The arm's robot, which must be in its IO file with the same serial number and number of actuators."""
        keys, bus, name = self.keys, self.bus, self.robot_name
        if bus is None or not (keys.serial or keys.IO_file):
            return None
        default = f"sawRobotIO1394-{name}-{keys.serial}.json"
        path = self.system.find((*self.key, "IO_file"), keys.IO_file or default)
        opened = bus.add(self.system.context, path)
        if opened is None:
            return None
        robots = opened.content.robots
        index = next((index for index, robot in enumerate(robots) if robot.name == name), None)
        if index is None:
            names = ", ".join(robot.name for robot in robots) or "no robot"
            opened.error(("robots",), f"arm {keys.name} needs the robot {name}, this file has {names}", name)
            return None
        robot, key = robots[index], ("robots", index)
        if keys.serial and robot.serial_number != keys.serial:
            text = f"arm {keys.name} has the serial {keys.serial}, its robot {robot.name} has {robot.serial_number}"
            opened.error((*key, "serial_number"), text, f'"{keys.serial}"')
        if len(robot.actuators) != actuators and robot.number_of_actuators == len(robot.actuators):
            opened.error((*key, "number_of_actuators"), f"wrong number for {keys.type} {keys.name}", str(actuators))
        return RobotPlace(opened, key, robot)

    def _load_gripper(self) -> str:
        """The robot of a master's gripper, whose file must exist; "" without one."""
        keys, bus = self.keys, self.bus
        if bus is None or not (keys.serial or keys.IO_gripper_file):
            return ""
        file = keys.IO_gripper_file or f"sawRobotIO1394-{self.robot_name}-gripper-{keys.serial}.json"
        opened = bus.add(self.system.context, self.system.find((*self.key, "IO_gripper_file"), file))
        return gripper_of(opened.content if opened is not None else None, keys.name, self.robot_name)

    def _open_arm_file(self, model: type[ArmFile]) -> Opened[ArmFile] | None:
        keys, where = self.keys, (*self.key, "arm_file")
        if not keys.arm_file and not keys.serial:
            if self.is_kinematic:
                self.system.error(where, "this key is required without a serial", "a file")
            return None  # otherwise the missing serial was already reported
        return self.system.open(model, where, keys.arm_file or f"{self.robot_name}-{keys.serial}.json")

    def _open_pid(self, default: str, robot: RobotPlace | None) -> Opened[PidFile] | None:
        opened = self.system.open(PidFile, (*self.key, "PID_file"), self.keys.PID_file or default)
        if opened is not None:
            check_pid(opened, robot.keys if robot else None)
        return opened

    # -- results -------------------------------------------------------------------------------------------------------

    def _check_psm(self, opened: Opened[ArmFile], chain: document.Chain | None) -> None:
        if chain is not None and len(chain.links) != _PSM_LINKS:
            text = f"chain of {len(chain.links)} rows for a PSM"
            opened.error(("kinematic",), text, f"{_PSM_LINKS} rows, the others come with the tool")
        if opened.content.generation == "Si" and opened.content.mounting_pitch is None:
            text = "this key is required for a PSM Si"
            opened.error(("mounting_pitch",), text, "rad; usually -0.7854, PSM3 -0.2618")

    def _own_values(self, opened: Opened[ArmFile], robot: RobotPlace | None, gripper: str) -> dict[str, Any]:
        """Fields of `document.ArmConfig` specific to this kind of arm that `by_name` cannot fill."""
        content, name = opened.content, self.keys.name
        if isinstance(content, PsmFile):
            tools = psm_tools(self.system, name, Opened(opened.context, opened.source, content))
            reader = reader_of(self.bus, name, self.robot_name, robot.keys if robot is not None else None)
            return {"tool": tools.fixed, "tools": tools.all, "cannula_depth": content.cannula_depth or 0.0,
                    "instrument_reader": reader}
        if isinstance(content, MtmFile):
            return {"gripper": gripper, "gripper_debounce_s": content.gripper_events_debounce,
                    "gripper_zero": content.gripper_events_zero}
        return {}

    def _can_start(self, content: ArmFile, robot: RobotPlace | None) -> bool | None:
        """Whether this kind of arm is supported; a note if it is not, None (and an error) if that is unknown."""
        keys = self.keys
        if keys.type.endswith(DERIVED) and keys.component and "." not in keys.component:
            self.system.note(f"not started: {keys.name} ({keys.type}): {keys.component} is a component of the original "
                             "program; name a class of Python, module.Class (docs/derived-arms.md)")
            return False
        if content.generation not in ARM_TYPES[self.family].gains:
            self.system.note(f"not started yet: {keys.name} ({keys.type} {content.generation})")
            return False
        if robot is not None and robot.keys.hardware_version == "HARDWARE_UNDEFINED":
            where = (*robot.key, "hardware_version")
            robot.file.error(where, "the controllers must be stated", "QLA1, DQLA or dRA1")
            return None
        return True

    def _driven(
        self, opened: Opened[ArmFile], chain: document.Chain | None, robot: RobotPlace | None,
        pid: Opened[PidFile] | None, *, drives: bool,
    ) -> tuple[document.Robot, document.PidConfig] | None:
        """Robot and gains for io: from IO and PID files, or, if KINEMATIC, from the chain; None if a part is missing.

        `drives`: whether the arm will be moved.
        """
        name = self.keys.name
        if self.is_kinematic:
            actuators = ARM_TYPES[self.family].actuators
            return kinematic_robot(opened, name, self.index, chain, actuators) if chain is not None else None
        if robot is None or pid is None or self.bus is None:
            return None
        if drives:
            _check_drivable(robot)
        path = robot.file.source.path
        lookup = self.bus.tables.get((path, int(robot.key[1])), "")
        return (convert.robot(robot.keys, str(path), lookup),
                convert.pid(pid.content, robot.keys.name, name, str(pid.source.path)))


def _homes_to_zero(content: ArmFile) -> bool:
    """Whether homing moves to zero: the file's setting; by default only for masters."""
    reported = content.homing_zero_position
    return isinstance(content, MtmFile) if reported is None else reported


def _check_drivable(robot: RobotPlace) -> None:
    """Check that each axis of a moving arm has an encoder and a conversion from effort to current."""
    for number, actuator in enumerate(robot.keys.actuators):
        key: KeyPath = (*robot.key, "actuators", number)
        if actuator.encoder is None:
            robot.file.error((*key, "encoder"), "this key is required for an arm that moves", "an object")
        if actuator.drive.maximum_current == 0.0:
            where = (*key, "drive", "maximum_current")
            robot.file.warning(where, "0 A is used: this axis can never pull", "above 0.0")
        if actuator.drive.effort_to_current.scale == 0.0:
            where = (*key, "drive", "effort_to_current", "scale")
            robot.file.error(where, "must not be 0 for an arm that moves", "A per N·m or N")
