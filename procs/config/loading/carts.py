"""The setup joints of a system: their files, the arms they carry, and their rows for io."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Iterable, Sequence
from typing import Final, TypeAlias, TypeVar

from trocar.procs.config.loading import convert
from trocar.procs.config.loading.buses import BusFiles, SystemFiles
from trocar.procs.config.loading.chains import KINEMATIC, dh_chain
from trocar.procs.config.loading.context import Opened
from trocar.procs.config.loading.setup_pots import open_pots
from trocar.procs.config.models.arm_file import (
    PLUGS,
    FixedSetupFile,
    MeasuredArmKeys,
    SetupArmKeys,
    SetupFile,
    SiArmKeys,
    SiSetupFile,
)
from trocar.procs.config.models.system_file import ArmKeys, SystemFile
from trocar.procs.config.models.trocar_section import TrocarSection
from trocar.procs.config.read.problem import count
from trocar.procs.config.read.quantities import check_rigid
from trocar.procs.config.read.sections import Section
from trocar.procs.document import cart
from trocar.procs.document import system as document
from trocar.procs.fpga import registers

PERIOD_S: Final = 0.002  # no joint moves by itself; base frames follow the reference arm's tip at this rate
ECM_JOINTS: Final = 4
SI_JOINTS: Final = (4, 5)
FIXED_LINKS: Final = 2  # of Si, after the joints with potentiometers
BASE_POTS: Final = ("PSM3", "ECM", "PSM2", "PSM1")  # in the order of their wiring to the base's board
JOINT_ROOM: Final = 8
CLUTCHES: Final = tuple(f"SUJ_clutch_{plug + 1}" for plug in range(PLUGS))
LIFT_BUTTONS: Final = ("motor_up", "motor_down")

FileType = TypeVar("FileType", bound=Section)
Geometry: TypeAlias = tuple[document.Chain, document.Matrix, document.Matrix]
Pots: TypeAlias = tuple[tuple[cart.Linear, ...], tuple[cart.Linear, ...], tuple[float, ...]]


def load_carts(system: SystemFiles) -> tuple[cart.Cart, ...]:
    """All setup joints of the system, except those with errors."""
    carries = _carried(system.content)
    found = []
    for part in system.each("arms", system.content.arms):
        keys = part.content
        if keys.type.startswith("SUJ"):
            made = _CartLoader(system, part, carries.get(keys.name, {})).load(system.buses.get(keys.IO))
            if made is not None:
                found.append(made)
    _check_base_frames(system, found)
    return tuple(found)


def with_base_frames(arms: Sequence[document.ArmConfig], carts: Sequence[cart.Cart]) -> tuple[document.ArmConfig, ...]:
    """The arms, each with the name of the setup joints that carry it."""
    setups = {arm.carries: (one.name, arm.name) for one in carts for arm in one.arms if arm.carries}
    return tuple(dataclasses.replace(arm, base_from=name, base_setup=setup)
                 for arm in arms for name, setup in (setups.get(arm.name, ("", "")),))


def with_brakes(ios: Sequence[document.IoConfig], carts: Sequence[cart.Cart]) -> tuple[document.IoConfig, ...]:
    """The ios; with a Classic cart they take brake currents as efforts, and show the multiplexer's channel."""
    by_io = {one.io: one for one in carts if one.io}
    return tuple(_with_cart(io, by_io[io.name]) if io.name in by_io else io for io in ios)


def _with_cart(io: document.IoConfig, one: cart.Cart) -> document.IoConfig:
    robot = next(robot for robot in io.robots if robot.name == one.robot)
    actuators = tuple(dataclasses.replace(actuator, effort_to_current=1.0) for actuator in robot.actuators)
    robots = tuple(dataclasses.replace(robot, actuators=actuators) if r is robot else r for r in io.robots)
    axes = tuple(document.PidAxis(f"plug_{n + 1}", "UNDEFINED", 0.0, 0.0, 0.0, pid_max_output=-1.0)
                 for n in range(len(actuators)))
    shown = tuple(
        document.DigitalInput(name, actuator.board_id, registers.INPUT_ENCODER_A_SHIFT + actuator.axis_id, False, False,
                              False)
        for name, actuator in zip(cart.channel_inputs(one.robot), actuators, strict=True))
    pid = document.PidConfig(one.robot, one.name, axes)
    sets = dict.fromkeys(cart.MULTIPLEXER_OUTPUTS, "multiplexer")
    if any(arm.lifts for arm in one.arms):
        sets |= dict.fromkeys(cart.LIFT_OUTPUTS, "lift")
    outputs = tuple(dataclasses.replace(row, set_by=sets[row.name], robot=one.robot) if row.name in sets else row
                    for row in io.digital_outputs)
    return dataclasses.replace(io, robots=robots, pids=(*io.pids, pid), digital_outputs=outputs,
                               digital_inputs=(*io.digital_inputs, *shown))


def _carried(content: SystemFile) -> dict[str, dict[str, str]]:
    """The arms with base frames from setup joints, by setup joints and setup arm."""
    found: dict[str, dict[str, str]] = {}
    for keys in content.arms:
        frame = keys.base_frame
        if frame is not None and frame.component and frame.interface and frame.transform is None:
            found.setdefault(frame.component, {})[frame.interface] = keys.name
    return found


def _check_base_frames(system: SystemFiles, found: Sequence[cart.Cart]) -> None:
    carts, listed = {one.name: one for one in found}, {keys.name for keys in system.content.arms
                                                       if keys.type[:3] == "SUJ"}
    taken: dict[tuple[str, str], str] = {}
    for part in system.each("arms", system.content.arms):
        name, frame = part.content.name, part.content.base_frame
        if frame is None or frame.component is None or frame.interface is None or frame.transform is not None:
            continue
        place = (frame.component, frame.interface)
        if frame.component not in listed:
            system.note(f"not started yet: base frame of {name} from {frame.component}/{frame.interface}")
            continue
        names = [arm.name for arm in carts[frame.component].arms] if frame.component in carts else []
        if names and frame.interface not in names:
            part.unlisted("base_frame.interface", f"{frame.component} has no setup arm {frame.interface}", names)
        if place in taken:
            text = f"{frame.component}/{frame.interface} carries {taken[place]} already"
            part.error("base_frame.interface", text, "a different setup arm for every arm")
        taken.setdefault(place, name)


@dataclasses.dataclass(slots=True)
class _CartLoader:
    """Loads one entry of the `arms` list as a cart."""

    system: SystemFiles
    part: Opened[ArmKeys]
    carries: dict[str, str]

    @property
    def is_kinematic(self) -> bool:
        """Whether it is KINEMATIC, i.e. without measurements."""
        return self.part.content.simulation == KINEMATIC

    def load(self, bus: BusFiles | None) -> cart.Cart | None:
        """Load the cart; None with errors."""
        before = len(self.system.context.problems)
        match self.part.content.type:
            case "SUJ_Classic":
                made = self._classic(bus)
            case "SUJ_Si":
                made = self._si()
            case _:
                made = self._fixed()
        return None if count(self.system.context.problems[before:]) else made

    def _open(self, model: type[FileType]) -> Opened[FileType] | None:
        keys = self.part.content
        if not keys.arm_file:
            self.part.error("arm_file", f"this key is required for {keys.type}", "a file")
            return None
        return self.part.open(model, "arm_file", keys.arm_file)

    def _cart(self, opened: Opened[object], found: Iterable[cart.CartArm | None], reference: str) -> cart.Cart:
        keys, made = self.part.content, tuple(arm for arm in found if arm is not None)
        names = [arm.name for arm in made]
        if reference not in names and reference != "ECM":  # the default may be missing: no reference arm then
            opened.unlisted("reference_arm", f"no setup arm {reference}", names)
        for place, name in enumerate(names):
            if name in names[:place]:
                text = f"{name} is also the name of arms[{names.index(name)}]"
                opened.error(("arms", place, "name"), text, "a different one for every arm")
        stated = keys.period if "period" in keys.model_fields_set else PERIOD_S
        return cart.Cart(keys.name, keys.type.removeprefix("SUJ_"), keys.simulation,
                         self.system.own(keys.name).period_s or stated, made, reference,
                         source=str(opened.source.path))

    # -- Classic -------------------------------------------------------------------------------------------------------

    def _classic(self, bus: BusFiles | None) -> cart.Cart | None:
        opened = self._open(SetupFile)
        if opened is None:
            return None
        _check_plugs(opened)
        arms = [self._classic_arm(part) for part in opened.each("arms", opened.content.arms)]
        made = self._cart(opened, arms, opened.content.reference_arm)
        if self.is_kinematic or bus is None:
            return made
        keys = self.part.content
        robot = keys.name_on_IO or keys.name
        self._check_bus(bus, robot, any(arm.lifts for arm in made.arms))
        return dataclasses.replace(made, io=keys.IO, robot=robot)

    def _classic_arm(self, part: Opened[SetupArmKeys]) -> cart.CartArm | None:
        keys, geometry = part.content, self._geometry(part)
        pots = self._pots(part, len(geometry[0].links) if geometry else 0)
        if geometry is None or pots is None:
            return None
        made = self._arm(part, geometry, pots, lifts=keys.lifts)
        if keys.type == "ECM":  # it has only these joints, even if the file has more
            primary, secondary = ((*row[:ECM_JOINTS], *((0.0, 0.0),) * len(row[ECM_JOINTS:])) for row in pots[:2])
            made = dataclasses.replace(made, primary=primary, secondary=secondary)
        return made

    def _check_bus(self, bus: BusFiles, name: str, lifts: bool) -> None:
        file = f"no file of {bus.keys.name}"
        robot = next((robot.content for robot in bus.robots() if robot.content.name == name), None)
        if robot is None or len(robot.actuators) != PLUGS or any(a.axis_id > 3 for a in robot.actuators):
            text = f"{file} has a robot {name} with an actuator for each of 4 plugs, axes 0 to 3"
            self.part.error("IO", text, "an IO_file that has it")
        outputs = [row.name for content in bus.contents() for row in content.digital_outputs]
        if missing := _missing(cart.MULTIPLEXER_OUTPUTS + (cart.LIFT_OUTPUTS if lifts else ()), outputs):
            self.part.error("IO", f"{file} has the digital outputs {missing}", "an IO_file that has them")
        inputs = [row.name for content in bus.contents() for row in content.digital_inputs]
        if missing := _missing(CLUTCHES + (LIFT_BUTTONS if lifts else ()), inputs):
            text = f"{file} has the buttons {missing}: they cannot be pressed"
            self.part.warning("IO", text, "digital inputs of these names")

    # -- Si ------------------------------------------------------------------------------------------------------------

    def _si(self) -> cart.Cart | None:
        opened = self._open(SiSetupFile)
        if opened is None:
            return None
        content, emulated = opened.content, self.system.emulated
        by_arm = not self.is_kinematic and _has_pots_elsewhere(content)
        arms = [self._si_arm(part, by_arm=by_arm) for part in opened.each("arms", content.arms)]
        made = self._cart(opened, arms, content.reference_arm)
        if self.is_kinematic:
            return made
        if by_arm:
            if not emulated:
                text = ("firmware Rev 10 reads these setup joints; where it shows them is not public, so their poses "
                        "stay unknown")
                self.part.warning("type", text, "SUJ_Fixed, with measured poses, until then")
            return dataclasses.replace(made, by_arm=True, emulated=emulated)
        if content.base_arduino_mac is None:
            text = "this key is required: the first joint of every arm hangs on the base's board"
            opened.error("base_arduino_mac", text, "a Bluetooth address")
        if emulated:
            self.system.note(f"{made.name}: potentiometer boards emulated, no Bluetooth is used")
        return dataclasses.replace(made, base_board=content.base_arduino_mac or "", emulated=emulated)

    def _si_arm(self, part: Opened[SiArmKeys], *, by_arm: bool) -> cart.CartArm | None:
        keys, geometry = part.content, self._geometry(part)
        if geometry is None:
            return None
        rows = len(geometry[0].links)
        joints = rows - FIXED_LINKS
        if joints not in SI_JOINTS:
            allowed = " or ".join(str(count + FIXED_LINKS) for count in SI_JOINTS)
            part.error("DH", f"{rows} rows", f"{allowed} rows, the last two fixed")
        pots = self._pots_by_arm(part, joints) if by_arm else self._pots(part, joints)
        if keys.name not in BASE_POTS:
            part.unlisted("name", "not an Si setup arm", BASE_POTS)
        elif not self.is_kinematic and not by_arm and keys.arduino_mac is None:
            part.error("arduino_mac", "this key is required", "a Bluetooth address")
        if pots is None or keys.name not in BASE_POTS:
            return None
        return self._arm(part, geometry, pots, joints, board=keys.name if by_arm else keys.arduino_mac or "",
                         base_pot=BASE_POTS.index(keys.name))

    def _pots_by_arm(self, part: Opened[SiArmKeys], joints: int) -> Pots | None:
        """The same as `_pots`, from the file of the arm that it carries."""
        name = self.carries.get(part.content.name, "")
        arm = next((row for row in self.system.content.arms if row.name == name), None)
        if arm is None:
            part.error("name", "its potentiometers are in the file of the arm that it carries, and it carries none",
                       f"an arm with base_frame {self.part.content.name}/{part.content.name}")
            return None
        found, weight = open_pots(self.system, arm, part, joints), _weight(part, joints)
        return (found[0], found[1], weight) if found is not None and weight else None

    # -- fixed ---------------------------------------------------------------------------------------------------------

    def _fixed(self) -> cart.Cart | None:
        opened = self._open(FixedSetupFile)
        if opened is None:
            return None
        arms = [cart.CartArm(keys.name, self.carries.get(keys.name, ""), pose=keys.measured_cp)
                for part in opened.each("arms", opened.content.arms) for keys in (part.content,)
                if check_rigid(part, "measured_cp", keys.measured_cp)]
        return self._cart(opened, arms, opened.content.reference_arm_as_before or opened.content.reference_arm)

    # -- parts of an arm -----------------------------------------------------------------------------------------------

    def _arm(self, part: Opened[MeasuredArmKeys], geometry: Geometry, pots: Pots, joints: int | None = None,
             **others: object) -> cart.CartArm:
        """An arm with potentiometers at its first `joints`; default: at all."""
        keys, (chain, world, tip), (primary, secondary, weight) = part.content, geometry, pots
        joints = len(chain.links) if joints is None else joints
        given = keys.simulated_position or ()
        if keys.simulated_position is not None and len(given) != joints and joints:
            part.error("simulated_position", f"{len(given)} numbers for {joints} joints", f"{joints} numbers")
        return convert.by_name(
            cart.CartArm, keys, carries=self.carries.get(keys.name, ""), chain=chain, joints=joints, world=world,
            tip=tip, position=given, primary=primary, secondary=secondary, weight=weight, **others)

    def _geometry(self, part: Opened[MeasuredArmKeys]) -> Geometry | None:
        keys = part.content
        for name in ("DH", "world_origin_to_SUJ", "SUJ_tip_to_tool_origin"):
            if not getattr(keys, name):
                part.error(name, "this key is required", "an object")
        if keys.DH is None or keys.world_origin_to_SUJ is None or keys.SUJ_tip_to_tool_origin is None:
            return None
        poses = []
        for name, frame in (("world_origin_to_SUJ", keys.world_origin_to_SUJ),
                            ("SUJ_tip_to_tool_origin", keys.SUJ_tip_to_tool_origin)):
            rows = tuple((*row, x) for row, x in zip(frame.Rotation, frame.Translation, strict=False))
            matrix: document.Matrix = (*rows, (0.0, 0.0, 0.0, 1.0))
            if not check_rigid(part, (name, "Rotation"), matrix):
                return None
            poses.append(matrix)
        chain = dh_chain(part.at("DH", keys.DH))
        if chain is None:
            return None
        if len(chain.links) > JOINT_ROOM or chain.links[0].joint_type != "prismatic":
            part.error("DH", "the first joint must be prismatic", f"up to {JOINT_ROOM} rows, the first one prismatic")
            return None
        return chain, poses[0], poses[1]

    def _pots(self, part: Opened[MeasuredArmKeys], joints: int) -> Pots | None:
        """Conversions of both potentiometers of every joint, and the weight of the first; empty if KINEMATIC.

        None with errors.
        """
        if self.is_kinematic:
            return (), (), ()
        made, fine = [], True
        for name in ("primary", "secondary"):
            rows = [(f"{name}_{what}", getattr(part.content, f"{name}_{what}")) for what in ("scales", "offsets")]
            for key, values in rows:
                if values is None:
                    part.error(key, "this key is required", f"{joints or JOINT_ROOM} numbers")
                elif joints and len(values) != joints:
                    part.error(key, f"{len(values)} numbers for {joints} joints", f"{joints} numbers")
                fine = fine and values is not None and len(values) == joints
            made.append(tuple(zip(*(values or () for _, values in rows), strict=False)))
        weight = _weight(part, joints)
        return (made[0], made[1], weight) if fine and weight else None


def _has_pots_elsewhere(content: SiSetupFile) -> bool:
    """Whether the file has the geometry only: potentiometers are in one file an arm, as since 2026."""
    rows = (value for arm in content.arms for value in (arm.primary_scales, arm.primary_offsets, arm.secondary_scales,
                                                        arm.secondary_offsets, arm.arduino_mac))
    return content.base_arduino_mac is None and all(value is None for value in rows)


def _missing(names: Iterable[str], there: Collection[str]) -> str:
    return ", ".join(name for name in names if name not in there)


def _weight(part: Opened[MeasuredArmKeys], joints: int) -> tuple[float, ...]:
    given = part.content.primary_secondary_weight
    values = list(given) if isinstance(given, list | tuple) else [given] * joints
    good = [float(v) for v in values if isinstance(v, int | float) and not isinstance(v, bool) and 0.0 <= v <= 1.0]
    if len(good) != joints or len(values) != joints:
        part.error("primary_secondary_weight", f"not the weight of the primary potentiometers: {given}",
                   f"a number from 0 to 1, or {joints} of them")
        return ()
    return tuple(good)


def check_cart(opened: Opened[SetupFile | SiSetupFile | FixedSetupFile], kind: str) -> None:
    """Check a file of setup joints by itself, without the io of its potentiometers."""
    measured = any(row.has("primary_offsets") for row in opened.each("arms", opened.content.arms))
    keys = ArmKeys.model_validate({"name": "SUJ", "type": f"SUJ_{kind}", "arm_file": str(opened.source.path),
                                   "simulation": "NONE" if measured else KINEMATIC})
    system = SystemFiles(opened.context, opened.source, SystemFile.model_construct(), TrocarSection(), emulated=False)
    _CartLoader(system, system.at(("arms", 0), keys), {}).load(None)


def _check_plugs(opened: Opened[SetupFile]) -> None:
    """Check that no two arms have the same plug."""
    taken: dict[int, str] = {}
    for index, part in enumerate(opened.each("arms", opened.content.arms)):
        plug = part.content.plug
        if plug in taken:
            part.error("plug_number", f"{plug} is also the plug of {taken[plug]}", "a different one for every arm")
        taken[plug] = f"arms[{index}]"
