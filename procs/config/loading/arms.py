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
from trocar.procs.config.loading.io_checks import range_of, robots_of
from trocar.procs.config.loading.meshes import checkout, mesh_links
from trocar.procs.config.loading.user_code import DERIVED, derived_class, derived_commands
from trocar.procs.config.models.arm_file import ArmFile, MtmFile, PsmFile
from trocar.procs.config.models.io_file import IoFile, PidFile, RobotKeys
from trocar.procs.config.models.system_file import ArmKeys
from trocar.procs.config.read.quantities import check_rigid, check_tolerance
from trocar.procs.document import system as document
from trocar.procs.document.arms import MeshLink
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


def load_arms(system: SystemFiles) -> list[LoadedArm]:
    """All arms without errors whose files have a model, with all their files checked."""
    loaders = [_ArmLoader(system, index, part) for index, part in enumerate(system.each("arms", system.content.arms))]
    return [arm for loader in loaders if (arm := loader.load()) is not None]


def base_frame_of(part: Opened[ArmKeys]) -> document.Matrix | None:
    """The fixed base frame of an arm; None without one, or when another component provides it."""
    frame = part.content.base_frame
    if frame is None:
        return None
    fixed = (frame.reference_frame is not None, frame.transform is not None)
    driven = (frame.component is not None, frame.interface is not None)
    if any(fixed) == any(driven) or any(fixed) != all(fixed) or any(driven) != all(driven):
        forms = "either reference_frame and transform, or component and interface"
        part.error("base_frame", "mixed or incomplete forms of a base frame", forms)
        return None
    if frame.transform is None:  # `carts.py` checks the component that provides it
        return None
    return frame.transform if check_rigid(part, "base_frame.transform", frame.transform) else None


def reference_of(keys: ArmKeys) -> str:
    """The reference frame of an arm's base; "" if it has none."""
    return (keys.base_frame.reference_frame or "") if keys.base_frame else ""


def check_pid(opened: Opened[PidFile], robot: RobotKeys | None) -> None:
    """Check that entries are in order, have unique names, and fit the actuators of `robot` (if given)."""
    axes = opened.content.pid
    names: set[str] = set()
    if robot is not None and len(axes) != len(robot.actuators):
        text = f"{len(axes)} entries, robot {robot.name} has {len(robot.actuators)} actuators"
        opened.error("pid", text, f"{len(robot.actuators)} entries")
    for number, part in enumerate(opened.each("pid", axes)):
        axis = part.content
        if part.source.at(part.path("index")) != number:
            part.error("index", "must be its position in the list", str(number))
        if axis.name in names:
            part.error("name", "used twice", "a unique name for every entry")
        names.add(axis.name)
        if not part.has("pid_max_output"):
            part.warning("pid_max_output", "absent: 0 is used, which means no effort", "-1: no limit")
        actuator = robot.actuators[number] if robot is not None and number < len(robot.actuators) else None
        where = "p_measured_setpoint_tolerance"
        if axis.tolerance == 0.0:
            part.warning(where, "0: the smallest error is a fault", "above 0, rad or m")
        check_tolerance(part, where, axis.tolerance, axis.joint_type, range_of(actuator) if actuator else 0.0)
        if robot is not None and actuator is not None and axis.joint_type != actuator.joint_type:
            text = f"actuator {number} of robot {robot.name} is {actuator.joint_type}"
            part.error("type", text, actuator.joint_type)


@dataclass(slots=True)
class _ArmLoader:
    """Loads one arm of the system file into the document."""

    system: SystemFiles
    index: int
    part: Opened[ArmKeys]

    @property
    def keys(self) -> ArmKeys:
        """The arm's keys in the system file."""
        return self.part.content

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
        base_frame = base_frame_of(self.part)
        if keys.IO and not self.is_kinematic:
            self.system.find_bus(self.part.path("IO"), keys.IO)
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
        missing = [name for name in required if not getattr(keys, name)]
        if keys.type.endswith(DERIVED) and not keys.component.name:
            missing.append("component")
        for name in missing:
            self.part.error(name, f"this key is required for {keys.type}", "a text")

    def _read_other_files(self) -> None:
        """For kinds whose files have no model yet: check that the files exist and are readable."""
        if self.keys.arm_file:
            path = self.part.find("arm_file", self.keys.arm_file)
            if path is not None:
                self.system.context.read(path)
        if self.keys.IO_file and self.bus is not None:
            self.bus.add(self.part.find("IO_file", self.keys.IO_file))

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
        content, keys, system = opened.content, self.keys, self.system
        chain, links = arm_chain(opened), weighing_links(opened, self.family)
        measured = measured_weight(opened, tuple(dict.fromkeys((keys.name, self.robot_name))), keys.serial)
        own = {"gripper": gripper} if not isinstance(content, PsmFile) else self._psm_values(
            Opened(opened.context, opened.source, content), chain, robot)
        starts = self._can_start(content, robot)
        driven = self._driven(opened, chain, robot, pid, drives=bool(starts))
        if starts is None or chain is None or driven is None:
            return None
        made, controller = driven
        arm = convert.by_name(
            document.ArmConfig, keys, content, system.options.arm,
            type=keys.type.removesuffix(DERIVED),
            io=KINEMATIC_IO if self.is_kinematic else keys.IO,
            robot=made.name,
            period_s=system.own(keys.name).period_s or system.options.arm.period_s or keys.period,
            chain=chain,
            links=links,
            master_gravity=measured,
            homing_zero_position=_homes_to_zero(content),
            inputs=inputs_of(self.bus, keys.name, self.robot_name),
            base_frame=base_frame,
            reference_frame=reference_of(keys),
            calibration_mode=system.options.calibration_mode,
            source=str(opened.source.path),
            derived=derived_class(system, self.part.path("component"), keys),
            meshes=self._meshes(generation, chain),
            commands=derived_commands(system, keys),
            **own,
        )
        if not self.is_kinematic and len(controller.axes) == row.actuators:
            controller = dataclasses.replace(controller, max_speeds=row.max_speeds)
        return LoadedArm(arm, made, controller, starts, keys.PID_period)

    def _meshes(self, generation: str, chain: document.Chain) -> tuple[MeshLink, ...]:
        """Its meshes, if dvrk_model is on the search path."""
        folder = checkout(self.system.context.search)
        found, missing = mesh_links(folder, self.family, generation, chain) if folder is not None else ((), "")
        if missing:
            self.system.note(missing)
        return found

    def _load_robot(self, actuators: int) -> Opened[RobotKeys] | None:
        """The arm's robot, which must be in its IO file with the same serial number and number of actuators."""
        keys, name = self.keys, self.robot_name
        if not (keys.serial or keys.IO_file):
            return None
        opened = self._open_io("IO_file", keys.IO_file or f"sawRobotIO1394-{name}-{keys.serial}.json")
        if opened is None:
            return None
        found = next((robot for robot in robots_of(opened) if robot.content.name == name), None)
        if found is None:
            robots = opened.content.robots
            names = ", ".join(robot.name for robot in robots) or "no robot"
            self.part.error("name_on_IO" if keys.name_on_IO else "name", f"its IO file has no robot {name}: "
                            f"{opened.source.path.name} has {names}", f"a name_on_IO: {names}; or {name} in that file")
            return None
        robot = found.content
        if keys.serial and robot.serial != keys.serial:
            text = f"arm {keys.name} has the serial {keys.serial}, its robot {robot.name} has {robot.serial}"
            found.error("serial_number", text, f'"{keys.serial}"')
        if len(robot.actuators) != actuators and robot.number_of_actuators == len(robot.actuators):
            found.error("number_of_actuators", f"wrong number for {keys.type} {keys.name}", str(actuators))
        return found

    def _load_gripper(self) -> str:
        """The robot of a master's gripper, whose file must exist; "" without one."""
        keys = self.keys
        if self.bus is None or not (keys.serial or keys.IO_gripper_file):
            return ""
        opened = self._open_io("IO_gripper_file", keys.IO_gripper_file
                               or f"sawRobotIO1394-{self.robot_name}-gripper-{keys.serial}.json")
        return gripper_of(opened.content if opened is not None else None, keys.name, self.robot_name)

    def _open_io(self, key: str, file: str) -> Opened[IoFile] | None:
        return self.bus.add(self.part.find(key, file)) if self.bus is not None else None

    def _open_arm_file(self, model: type[ArmFile]) -> Opened[ArmFile] | None:
        keys = self.keys
        if not keys.arm_file and not keys.serial:
            if self.is_kinematic:
                self.part.error("arm_file", "this key is required without a serial", "a file")
            return None  # otherwise the missing serial was already reported
        return self.part.open(model, "arm_file", keys.arm_file or f"{self.robot_name}-{keys.serial}.json")

    def _open_pid(self, default: str, robot: Opened[RobotKeys] | None) -> Opened[PidFile] | None:
        opened = self.part.open(PidFile, "PID_file", self.keys.PID_file or default)
        if opened is not None:
            check_pid(opened, robot.content if robot else None)
        return opened

    # -- results -------------------------------------------------------------------------------------------------------

    def _psm_values(self, opened: Opened[PsmFile], chain: document.Chain | None,
                    robot: Opened[RobotKeys] | None) -> dict[str, Any]:
        """Fields of `document.ArmConfig` that only a PSM has and `by_name` cannot fill."""
        content, name = opened.content, self.keys.name
        if chain is not None and len(chain.links) != _PSM_LINKS:
            text = f"chain of {len(chain.links)} rows for a PSM"
            opened.error("kinematic", text, f"{_PSM_LINKS} rows, the others come with the tool")
        if content.generation == "Si" and content.mounting_pitch is None:
            opened.error("mounting_pitch", "this key is required for a PSM Si", "rad; usually -0.7854, PSM3 -0.2618")
        tools = psm_tools(self.system, name, opened, is_kinematic=self.is_kinematic)
        needs = tools.fixed.needs_depth(content.generation) if tools.fixed is not None else ""
        if needs and content.cannula_depth is None and not self.is_kinematic:
            opened.warning("tool", needs, "also the key cannula_depth, m")
        return {"tool": tools.fixed, "tools": tools.all, "cannula_depth": content.cannula_depth or 0.0,
                "instrument_reader": reader_of(self.bus, name, self.robot_name, robot.content if robot else None)}

    def _can_start(self, content: ArmFile, robot: Opened[RobotKeys] | None) -> bool | None:
        """Whether this kind of arm is supported; a note if it is not, None (and an error) if that is unknown."""
        keys = self.keys
        component = keys.component.name
        if keys.type.endswith(DERIVED) and component and "." not in component:
            self.system.note(f"not started: {keys.name} ({keys.type}): {component} is a component of the original "
                             "program; name a class of Python, module.Class (docs/derived-arms.md)")
            return False
        if content.generation not in ARM_TYPES[self.family].gains:
            self.system.note(f"not started yet: {keys.name} ({keys.type} {content.generation})")
            return False
        if robot is not None and robot.content.hardware == "HARDWARE_UNDEFINED":
            robot.error("hardware_version", "the controller hardware must be specified", "QLA1, DQLA or dRA1")
            return None
        return True

    def _driven(
        self, opened: Opened[ArmFile], chain: document.Chain | None, robot: Opened[RobotKeys] | None,
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
        return (self.bus.robot(robot),
                document.PidConfig(robot.content.name, name, pid.content.pid, str(pid.source.path)))


def _homes_to_zero(content: ArmFile) -> bool:
    """Whether homing moves to zero: the file's setting; by default only for masters."""
    reported = content.homing_zero_position
    return isinstance(content, MtmFile) if reported is None else reported


def _check_drivable(robot: Opened[RobotKeys]) -> None:
    """Check that each axis of a moving arm has an encoder and a conversion from effort to current."""
    for part in robot.each("actuators", robot.content.actuators):
        if part.content.encoder is None:
            part.error("encoder", "this key is required for an arm that moves", "an object")
        if part.content.maximum_current == 0.0:
            part.warning("drive.maximum_current", "0 A is used: the motor of this axis produces no torque", "above 0.0")
        if part.content.effort_to_current == 0.0:
            part.error("drive.effort_to_current.scale", "must not be 0 for an arm that moves", "A per N·m or N")
