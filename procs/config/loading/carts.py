"""The setup joints of a system: their files, the arms they carry, and their rows for io."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Final, TypeAlias, TypeVar

from trocar.procs.config.loading import convert
from trocar.procs.config.loading.buses import BusFiles, SystemFiles
from trocar.procs.config.loading.chains import KINEMATIC, check_dh, convention_of
from trocar.procs.config.loading.context import Context, Opened
from trocar.procs.config.models.setup_file import FixedSetupFile, SetupArmKeys, SetupFile, SiArmKeys, SiSetupFile
from trocar.procs.config.models.system_file import ArmKeys, SystemFile
from trocar.procs.config.models.trocar_section import TrocarSection
from trocar.procs.config.read.matrices import check_rigid
from trocar.procs.config.read.problem import KeyPath, count
from trocar.procs.config.read.validate import Section
from trocar.procs.document import cart
from trocar.procs.document import system as document
from trocar.procs.fpga import registers

PERIOD_S: Final = 0.002  # no joint moves by itself; base frames follow the reference arm's tip at this rate
ECM_JOINTS: Final = 4
SI_JOINTS: Final = (4, 5)
FIXED_LINKS: Final = 2  # of Si, after the joints with potentiometers
BASE_POTS: Final = ("PSM3", "ECM", "PSM2", "PSM1")  # in the order of their wiring to the base's board
JOINT_ROOM: Final = 8

FileType = TypeVar("FileType", bound=Section)
Geometry: TypeAlias = tuple[document.Chain, document.Matrix, document.Matrix]


def load_carts(system: SystemFiles) -> tuple[cart.Cart, ...]:
    """All setup joints of the system, except those with errors."""
    carries = _carried(system.content)
    found = []
    for index, keys in enumerate(system.content.arms):
        if keys.type.startswith("SUJ"):
            made = _CartLoader(system, index, keys, carries.get(keys.name, {})).load(system.buses.get(keys.IO))
            if made is not None:
                found.append(made)
    _check_base_frames(system, found)
    return tuple(found)


def with_base_frames(
    arms: Sequence[document.ArmConfig], carts: Sequence[cart.Cart]
) -> tuple[document.ArmConfig, ...]:
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
    arms = system.content.arms
    carts, listed = {one.name: one for one in found}, {keys.name for keys in arms if keys.type[:3] == "SUJ"}
    taken: dict[tuple[str, str], str] = {}
    for index, keys in enumerate(arms):
        frame = keys.base_frame
        if frame is None or frame.component is None or frame.interface is None or frame.transform is not None:
            continue
        where: KeyPath = ("arms", index, "base_frame")
        if frame.component not in listed:
            system.note(f"not started yet: base frame of {keys.name} from {frame.component}/{frame.interface}")
            continue
        names = [arm.name for arm in carts[frame.component].arms] if frame.component in carts else []
        if names and frame.interface not in names:
            text = f"{frame.component} has no setup arm {frame.interface}"
            system.error((*where, "interface"), text, f"one of {', '.join(names)}")
        place = (frame.component, frame.interface)
        if place in taken:
            text = f"{frame.component}/{frame.interface} carries {taken[place]} already"
            system.error((*where, "interface"), text, "a different setup arm for every arm")
        taken.setdefault(place, keys.name)


@dataclasses.dataclass(slots=True)
class _CartLoader:
    """Loads one entry of the `arms` list as a cart."""

    system: SystemFiles
    index: int
    keys: ArmKeys
    carries: dict[str, str]

    @property
    def is_kinematic(self) -> bool:
        """Whether it is KINEMATIC, i.e. without measurements."""
        return self.keys.simulation == KINEMATIC

    def load(self, bus: BusFiles | None) -> cart.Cart | None:
        """Load the cart; None with errors."""
        before = len(self.system.context.problems)
        match self.keys.type:
            case "SUJ_Classic":
                made = self._classic(bus)
            case "SUJ_Si":
                made = self._si()
            case _:
                made = self._fixed()
        return None if count(self.system.context.problems[before:]) else made

    def _open(self, model: type[FileType]) -> Opened[FileType] | None:
        where: KeyPath = ("arms", self.index, "arm_file")
        if not self.keys.arm_file:
            self.system.error(where, f"this key is required for {self.keys.type}", "a file")
            return None
        return self.system.open(model, where, self.keys.arm_file)

    def _cart(self, kind: str, opened: Opened[object], found: Sequence[cart.CartArm | None],
              reference: str) -> cart.Cart:
        made = tuple(arm for arm in found if arm is not None)
        names = [arm.name for arm in made]
        if reference not in names and reference != "ECM":  # the default may be missing: no reference arm then
            opened.error(("reference_arm",), f"no setup arm {reference}", f"one of {', '.join(names)}")
        for place, name in enumerate(names):
            if name in names[:place]:
                text = f"{name} is also the name of arms[{names.index(name)}]"
                opened.error(("arms", place, "name"), text, "a different one for every arm")
        stated = self.keys.period if "period" in self.keys.model_fields_set else PERIOD_S
        return cart.Cart(self.keys.name, kind, self.keys.simulation, self.system.own(self.keys.name).period_s or stated,
                         made, reference, source=str(opened.source.path))

    # -- Classic -------------------------------------------------------------------------------------------------------

    def _classic(self, bus: BusFiles | None) -> cart.Cart | None:
        opened = self._open(SetupFile)
        if opened is None:
            return None
        _check_plugs(opened)
        arms = [self._classic_arm(opened, place, keys) for place, keys in enumerate(opened.content.arms)]
        made = self._cart(cart.CLASSIC, opened, arms, opened.content.reference_arm)
        if self.is_kinematic or bus is None:
            return made
        robot = self.keys.name_on_IO or self.keys.name
        self._check_bus(bus, robot, any(arm.lifts for arm in made.arms))
        return dataclasses.replace(made, io=self.keys.IO, robot=robot)

    def _classic_arm(self, opened: Opened[SetupFile], place: int, keys: SetupArmKeys) -> cart.CartArm | None:
        where: KeyPath = ("arms", place)
        geometry = self._geometry(opened, where, keys)
        joints = len(geometry[0].links) if geometry else 0
        pots = self._pots(opened, where, keys, joints)
        if geometry is None or pots is None:
            return None
        chain, world, tip = geometry
        primary, secondary, weight = pots
        if keys.type == "ECM":  # it has only these joints, even if the file has more
            primary, secondary = ((*row[:ECM_JOINTS], *((0.0, 0.0),) * len(row[ECM_JOINTS:])) for row in pots[:2])
        return cart.CartArm(
            keys.name, self.carries.get(keys.name, ""), chain, joints, world, tip,
            self._position(opened, where, keys.simulated_position, joints), None, primary, secondary, weight,
            keys.plug_number, keys.brake_release_current, keys.brake_engaged_current, keys.type == "Motorized PSM")

    def _check_bus(self, bus: BusFiles, name: str, lifts: bool) -> None:
        where: KeyPath = ("arms", self.index, "IO")
        file = f"no file of {bus.keys.name}"
        robot = next((robot for _, _, robot in bus.robots() if robot.name == name), None)
        if robot is None or len(robot.actuators) != 4 or any(a.axis_id > 3 for a in robot.actuators):
            text = f"{file} has a robot {name} with an actuator for each of 4 plugs, axes 0 to 3"
            self.system.error(where, text, "an IO_file that has it")
        outputs = {row.name for content in bus.contents() for row in content.digital_outputs}
        missing = [row for row in cart.MULTIPLEXER_OUTPUTS + (cart.LIFT_OUTPUTS if lifts else ()) if row not in outputs]
        if missing:
            self.system.error(where, f"{file} has the digital outputs {', '.join(missing)}", "an IO_file that has them")
        inputs = {row.name for content in bus.contents() for row in content.digital_inputs}
        clutches = [f"SUJ_clutch_{plug}" for plug in range(1, 5)]
        absent = [name for name in clutches + (["motor_up", "motor_down"] if lifts else []) if name not in inputs]
        if absent:
            text = f"{file} has the buttons {', '.join(absent)}: they cannot be pressed"
            self.system.warning(where, text, "digital inputs of these names")

    # -- Si ------------------------------------------------------------------------------------------------------------

    def _si(self) -> cart.Cart | None:
        opened = self._open(SiSetupFile)
        if opened is None:
            return None
        content = opened.content
        arms = [self._si_arm(opened, place, keys) for place, keys in enumerate(content.arms)]
        made = self._cart(cart.SI, opened, arms, content.reference_arm)
        if self.is_kinematic:
            return made
        if content.base_arduino_mac is None:
            text = "this key is required: the first joint of every arm hangs on the base's board"
            opened.error(("base_arduino_mac",), text, "a Bluetooth address")
        emulated = self.system.emulated
        if emulated:
            self.system.note(f"{made.name}: potentiometer boards emulated, no Bluetooth is used")
        return dataclasses.replace(made, base_board=content.base_arduino_mac or "", emulated=emulated)

    def _si_arm(self, opened: Opened[SiSetupFile], place: int, keys: SiArmKeys) -> cart.CartArm | None:
        where: KeyPath = ("arms", place)
        geometry = self._geometry(opened, where, keys)
        if geometry is None:
            return None
        chain, world, tip = geometry
        joints = len(chain.links) - FIXED_LINKS
        if joints not in SI_JOINTS:
            rows = " or ".join(str(count + FIXED_LINKS) for count in SI_JOINTS)
            opened.error((*where, "DH"), f"{len(chain.links)} rows", f"{rows} rows, the last two fixed")
        pots = self._pots(opened, where, keys, joints)
        if keys.name not in BASE_POTS:
            opened.error((*where, "name"), "no Si setup arm", f"one of {', '.join(BASE_POTS)}")
        elif not self.is_kinematic and keys.arduino_mac is None:
            opened.error((*where, "arduino_mac"), "this key is required", "a Bluetooth address")
        if pots is None or keys.name not in BASE_POTS:
            return None
        primary, secondary, weight = pots
        return cart.CartArm(
            keys.name, self.carries.get(keys.name, ""), chain, joints, world, tip,
            self._position(opened, where, keys.simulated_position, joints), None, primary, secondary, weight,
            board=keys.arduino_mac or "", base_pot=BASE_POTS.index(keys.name))

    # -- fixed ---------------------------------------------------------------------------------------------------------

    def _fixed(self) -> cart.Cart | None:
        opened = self._open(FixedSetupFile)
        if opened is None:
            return None
        arms = [cart.CartArm(keys.name, self.carries.get(keys.name, ""), pose=keys.measured_cp)
                for place, keys in enumerate(opened.content.arms)
                if check_rigid(opened, ("arms", place, "measured_cp"), keys.measured_cp)]
        reference = opened.content.reference_arm_as_before or opened.content.reference_arm
        return self._cart(cart.FIXED, opened, arms, reference)

    # -- parts of an arm -----------------------------------------------------------------------------------------------

    def _geometry(self, opened: Opened[object], where: KeyPath, keys: SetupArmKeys | SiArmKeys) -> Geometry | None:
        missing = [name for name in ("DH", "world_origin_to_SUJ", "SUJ_tip_to_tool_origin") if not getattr(keys, name)]
        for name in missing:
            opened.error((*where, name), "this key is required", "an object")
        if keys.DH is None or keys.world_origin_to_SUJ is None or keys.SUJ_tip_to_tool_origin is None:
            return None
        poses = []
        for name, frame in (("world_origin_to_SUJ", keys.world_origin_to_SUJ),
                            ("SUJ_tip_to_tool_origin", keys.SUJ_tip_to_tool_origin)):
            rows = tuple((*row, x) for row, x in zip(frame.Rotation, frame.Translation, strict=False))
            matrix: document.Matrix = (*rows, (0.0, 0.0, 0.0, 1.0))
            if not check_rigid(opened, (*where, name, "Rotation"), matrix):
                return None
            poses.append(matrix)
        links = convert.links(keys.DH)
        if not check_dh(opened, (*where, "DH"), keys.DH):
            return None
        if len(links) > JOINT_ROOM or not links or links[0].joint_type != "prismatic":
            text = "the first joint must be prismatic" if links else "no rows"
            opened.error((*where, "DH"), text, f"up to {JOINT_ROOM} rows, the first one prismatic")
            return None
        return document.Chain(convention_of(keys.DH), links, source=str(opened.source.path)), poses[0], poses[1]

    def _pots(
        self, opened: Opened[object], where: KeyPath, keys: SetupArmKeys | SiArmKeys, joints: int
    ) -> tuple[tuple[cart.Linear, ...], tuple[cart.Linear, ...], tuple[float, ...]] | None:
        """Conversions of both potentiometers of every joint, and the weight of the first; empty if KINEMATIC.

        None with errors.
        """
        if self.is_kinematic:
            return (), (), ()
        made, fine = [], True
        for name in ("primary", "secondary"):
            scales, offsets = getattr(keys, f"{name}_scales"), getattr(keys, f"{name}_offsets")
            for what, values in (("scales", scales), ("offsets", offsets)):
                key = (*where, f"{name}_{what}")
                if values is None:
                    opened.error(key, "this key is required", f"{joints or JOINT_ROOM} numbers")
                elif joints and len(values) != joints:
                    opened.error(key, f"{len(values)} numbers for {joints} joints", f"{joints} numbers")
                fine = fine and values is not None and len(values) == joints
            made.append(tuple(zip(scales or (), offsets or (), strict=False)))
        weight = _weight(opened, (*where, "primary_secondary_weight"), keys.primary_secondary_weight, joints)
        return (made[0], made[1], weight) if fine and weight else None

    def _position(self, opened: Opened[object], where: KeyPath, given: tuple[float, ...] | None,
                  joints: int) -> tuple[float, ...]:
        if given is not None and len(given) != joints and joints:
            key = (*where, "simulated_position")
            opened.error(key, f"{len(given)} numbers for {joints} joints", f"{joints} numbers")
        return tuple(given or ())


def _weight(opened: Opened[object], key: KeyPath, given: object, joints: int) -> tuple[float, ...]:
    values = list(given) if isinstance(given, list | tuple) else [given] * joints
    good = [float(v) for v in values if isinstance(v, int | float) and not isinstance(v, bool) and 0.0 <= v <= 1.0]
    if len(good) != joints or len(values) != joints:
        allowed = f"a number from 0 to 1, or {joints} of them"
        opened.error(key, f"not the weight of the primary potentiometers: {given}", allowed)
        return ()
    return tuple(good)


def check_cart(context: Context, path: Path, kind: str) -> None:
    """Check a file of setup joints by itself, without the io of its potentiometers."""
    read = context.read(path)
    if read is None:
        return
    arms = read.source.data.get("arms")
    rows = arms if isinstance(arms, list) else []
    measured = any(isinstance(arm, dict) and "primary_offsets" in arm for arm in rows)
    keys = ArmKeys.model_validate({"name": "SUJ", "type": f"SUJ_{kind}", "arm_file": str(path),
                                   "simulation": "NONE" if measured else KINEMATIC})
    system = SystemFiles(context, read.source, SystemFile.model_construct(), TrocarSection(), emulated=False)
    _CartLoader(system, 0, keys, {}).load(None)


def _check_plugs(opened: Opened[SetupFile]) -> None:
    """Check that no two arms have the same plug."""
    taken: dict[int, str] = {}
    for index, arm in enumerate(opened.content.arms):
        if arm.plug_number in taken:
            text = f"{arm.plug_number} is also the plug of {taken[arm.plug_number]}"
            opened.error(("arms", index, "plug_number"), text, "a different one for every arm")
        taken[arm.plug_number] = f"arms[{index}]"
