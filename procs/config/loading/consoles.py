"""The operation of a system: consoles with their inputs, teleoperations between arms, the focus controller, and
third-party programs in place of arms (`_GENERIC` types) and pedals (`COMPONENTS`)."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

from trocar.procs.config.loading.buses import BusFiles, SystemFiles
from trocar.procs.config.loading.context import Opened
from trocar.procs.config.loading.convert import by_name
from trocar.procs.config.loading.third_parties import BUTTONS, COMPONENTS, GENERIC, is_from_ros, place_of
from trocar.procs.config.models.io_file import HidFile
from trocar.procs.config.models.system_file import (
    RESERVED,
    ConsoleKeys,
    InterfaceKeys,
    IoDeviceKeys,
    TeleopEcmKeys,
    TeleopEcmParameters,
    TeleopPsmKeys,
    TeleopPsmParameters,
)
from trocar.procs.config.read.sections import is_name
from trocar.procs.document.arms import ThirdParty
from trocar.procs.document.cart import Cart
from trocar.procs.document.consoles import (
    GOOVIS,
    Console,
    Focus,
    HidSensor,
    TeleopEcmConfig,
    TeleopPsmConfig,
    WiredInput,
)

FOCUS: Final = "ISI_focus_controller"
FOCUS_NAME: Final = "focus_controller"
FOCUS_OUTPUTS: Final = ("endoscope_focus_in", "endoscope_focus_out")
FOCUS_PEDALS: Final = ("focus_plus", "focus_minus")  # in, out
PERIOD_S: Final = 0.01
PEDALS: Final = "IO_pedals"
HEAD: Final = "IO_head_sensor"
BEAMS: Final = tuple(f"dv_head_sensor_{beam}" for beam in range(1, 5))
BEAMS_NEEDED: Final = 3
TURN_OFF: Final = "head_sensor_turn_off"
MAX_NAME: Final = 40

_NEEDS = {
    "PEDALS_ONLY": (PEDALS,),
    "PEDALS_ISI_HEAD_SENSOR": (PEDALS, HEAD),
    "PEDALS_DVRK_HEAD_SENSOR": (PEDALS, HEAD),
    "PEDALS_GOOVIS_HEAD_SENSOR": (PEDALS, "HID_file"),
    "SIMULATED": (),
    "COMPONENTS": BUTTONS,
}
_USED_BY = {key: tuple(kind for kind, needed in _NEEDS.items() if key in needed)
            for key in (HEAD, "HID_file", *BUTTONS)}
_USED_BY[PEDALS] = (*(kind for kind in _NEEDS if kind.startswith("PEDALS")), COMPONENTS)  # there, as an IO file
_HEAD_NAME = re.compile(r"head", re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class Operation:
    """The consoles, teleoperations and focus controller of a system."""

    consoles: tuple[Console, ...]
    teleop_psms: tuple[TeleopPsmConfig, ...]
    teleop_ecms: tuple[TeleopEcmConfig, ...]
    focuses: tuple[Focus, ...]


def load_consoles(system: SystemFiles, arms: Sequence[str], carts: Sequence[Cart],
                  third_parties: tuple[ThirdParty, ...]) -> Operation:
    """All consoles with their teleoperations; those whose arms do not run are noted and left out.

    `arms`: names of our running arms. Missing parts, unknown arms and teleoperations listed twice are errors.
    """
    running = [*arms, *(row.name for row in third_parties if row.type)]
    setups = {cart.name: [arm.name for arm in cart.arms] for cart in carts}
    loader = _ConsoleLoader(system, running, setups)
    consoles = tuple(map(loader.console, system.each("consoles", system.content.consoles)))
    rows: list[Console | TeleopPsmConfig | TeleopEcmConfig | ThirdParty] = [
        *consoles, *loader.psms, *loader.ecms, *third_parties]
    focuses = _load_focus(system, {row.name for row in rows})
    return Operation(consoles, tuple(loader.psms), tuple(loader.ecms), focuses)


@dataclass(slots=True)
class _ConsoleLoader:
    """Loads all consoles of one file."""

    system: SystemFiles
    arms: Collection[str]
    setups: dict[str, list[str]]  # setup arms by the setup joints that run
    taken: dict[str, str] = field(default_factory=dict)
    psms: list[TeleopPsmConfig] = field(default_factory=list)
    ecms: list[TeleopEcmConfig] = field(default_factory=list)

    def console(self, part: Opened[ConsoleKeys]) -> Console:
        """Load one entry of the list."""
        keys = part.content
        for name in _NEEDS[keys.input_type]:
            if not getattr(keys, name):
                part.error(name, f"this key is required with input_type {keys.input_type}")
        for name, types in _USED_BY.items():
            if getattr(keys, name) and keys.input_type not in types:
                part.error(name, f"not used with input_type {keys.input_type}",
                           f"input_type {' or '.join(types)}, or no such key")
        ecms = [self._ecm(row, keys.name) for row in part.each("teleop_ECMs", keys.teleop_ECMs)]
        psms = [self._psm(row, keys.name) for row in part.each("teleop_PSMs", keys.teleop_PSMs)]
        self.ecms += filter(None, ecms)
        self.psms += filter(None, psms)
        made = Console(keys.name, keys.input_type, self.system.own(keys.name).period_s or PERIOD_S,
                       tuple(row.name for rows in (ecms, psms) for row in rows if row is not None))
        return dataclasses.replace(made, **self._inputs(part))

    # -- inputs --------------------------------------------------------------------------------------------------------

    def _inputs(self, part: Opened[ConsoleKeys]) -> dict[str, Any]:
        """Fields of `Console` for the inputs of this type of console."""
        keys, kind = part.content, part.content.input_type
        if kind == COMPONENTS:
            clutch, camera, present = (self._component(part.at(button, getattr(keys, button))) for button in BUTTONS)
            return {"clutch": clutch, "camera": camera, "operator_present": (present,) if present else ()}
        if not kind.startswith("PEDALS"):
            return {}
        pedals, head = part.at(PEDALS, keys.IO_pedals), part.at(HEAD, keys.IO_head_sensor)
        found: dict[str, Any] = {"clutch": self._input(pedals, "clutch"), "camera": self._input(pedals, "camera")}
        seen: list[WiredInput | None] = []
        if kind == "PEDALS_ONLY":
            seen = [self._input(pedals, "coag")]
        elif kind == "PEDALS_ISI_HEAD_SENSOR" and head.content is not None:
            seen = [self._input(head, beam) for beam in BEAMS]
            found |= {"present_count": BEAMS_NEEDED, "turn_off": self._turn_off(head.content)}
        elif kind == "PEDALS_DVRK_HEAD_SENSOR" and head.content is not None:
            seen = [self._head_input(head.at("", head.content))]
        elif kind == GOOVIS and keys.HID_file:
            opened = part.open(HidFile, "HID_file", keys.HID_file)
            found["head"] = by_name(HidSensor, opened.content) if opened is not None else None
        return found | {"operator_present": tuple(row for row in seen if row)}

    def _component(self, part: Opened[InterfaceKeys | None]) -> WiredInput | None:
        """A digital input of an io, or a button of a third-party program."""
        keys = part.content
        if keys is None:
            return None
        bus = self.system.buses.get(keys.component)
        if bus is None:
            return WiredInput(place_of(self.system.content, keys), keys.interface)
        names = [row.name for content in bus.contents() for row in content.digital_inputs]
        if keys.interface not in names:
            part.unlisted("interface", f"{keys.component} has no such digital input", names,
                          "an IO whose files have digital inputs")
            return None
        return WiredInput(keys.component, keys.interface)

    def _names(self, device: IoDeviceKeys, outputs: bool = False) -> list[str] | None:
        """Digital inputs (or outputs) of a device's own file; None when that file has errors."""
        file = self.system.file_of(device)
        if file is None:
            return None
        return [row.name for row in (file.digital_outputs if outputs else file.digital_inputs)]

    def _input(self, part: Opened[IoDeviceKeys | None], name: str) -> WiredInput | None:
        device = part.content
        names = self._names(device) if device is not None else None
        if device is None or names is None:
            return None
        if name not in names:
            text = f"{device.IO_file} has no digital input {name}: it cannot be pressed"
            part.warning("IO_file", text, f"a file that has it; this one has {', '.join(names) or 'none'}")
            return None
        return WiredInput(device.IO, name)

    def _head_input(self, part: Opened[IoDeviceKeys]) -> WiredInput | None:
        """The input of a dVRK head sensor: that with the device's name, else the only one with `head` in its name, or
        the only one at all.
        """
        device, names = part.content, self._names(part.content)
        if names is None:
            return None
        heads = [name for name in names if _HEAD_NAME.search(name)] or names
        if device.name in names:
            heads = [device.name]
        if len(heads) != 1:
            text = f"{device.IO_file} has {len(heads)} digital inputs that may be the head sensor"
            allowed = f"the name of one of {', '.join(names)}" if names else "a file with a digital input"
            part.error("name", text, allowed)
            return None
        return WiredInput(device.IO, heads[0])

    def _turn_off(self, device: IoDeviceKeys) -> WiredInput | None:
        return WiredInput(device.IO, TURN_OFF) if TURN_OFF in (self._names(device, True) or ()) else None

    # -- teleoperations -----------------------------------------------------------------------------------------------

    def _psm(self, part: Opened[TeleopPsmKeys], console: str) -> TeleopPsmConfig | None:
        keys, given = part.content, part.content.configure_parameter or TeleopPsmParameters()
        frame, scaling = keys.PSM_base_frame, given.gripper_scaling
        made = by_name(
            TeleopPsmConfig, keys, given, **self._of_all(part, console, (keys.MTM, keys.PSM)),
            gripper_zero=scaling.zero, gripper_max=scaling.max, base_frame_from=frame.component if frame else "",
            base_frame_interface=frame.interface if frame else "",
            wall_force=self.system.options.arm.wall_force, wrench_timeout_s=self.system.options.arm.effort_timeout_s)
        if made.align_mtm and not made.mtm_is_haptic:
            part.error("configure_parameter.align_MTM", "an MTM that is not haptic cannot align", "false")
        if scaling.zero == scaling.max:
            part.error("configure_parameter.gripper_scaling.max", "equal to the value of the key zero", "another angle")
        self._check_roles(part, console, made.name, ("MTM", "PSM"), made.arms)
        runs = self._runs(made, keys)
        if frame is not None and runs:
            runs = self._has_base_frame(made.name, part.at("PSM_base_frame", frame))
        return made if runs else None

    def _ecm(self, part: Opened[TeleopEcmKeys], console: str) -> TeleopEcmConfig | None:
        keys, given = part.content, part.content.configure_parameter or TeleopEcmParameters()
        made = by_name(TeleopEcmConfig, keys, given,
                       **self._of_all(part, console, (keys.MTML, keys.MTMR, keys.ECM)))
        self._check_roles(part, console, made.name, ("MTML", "MTMR", "ECM"), made.arms)
        if keys.MTML == keys.MTMR:
            part.error("MTMR", "the same arm as MTML", "another MTM")
        return made if self._runs(made, keys) else None

    def _of_all(self, part: Opened[TeleopPsmKeys | TeleopEcmKeys], console: str, arms: tuple[str, ...]) -> \
            dict[str, Any]:
        name = "_".join(arms)
        return {"name": name, "period_s": self.system.own(name).period_s or part.content.period, "console": console}

    def _has_base_frame(self, teleop: str, part: Opened[InterfaceKeys]) -> bool:
        """Check that the PSM's base frame is from a running arm, or a setup arm (`interface`) of a `component`.

        False, with a note, if it may be from an unsupported component: without that frame the PSM would move elsewhere.
        """
        frame = part.content
        if frame.component in self.setups:
            known = self.setups[frame.component]
            if frame.interface not in known:
                part.unlisted("interface", f"{frame.component} has no such setup arm", known)
        elif frame.component not in self.arms and self.system.content.component_manager:
            self.system.note(f"not started: teleop {teleop} (its PSM_base_frame is from {frame.component}, not an "
                             "arm and no setup joints; components of component_manager are left out)")
            return False
        elif frame.component not in self.arms:
            part.unlisted("component", "no arm and no setup joints of this name are started",
                          (*self.setups, *self.arms))
        return True

    def _check_roles(self, part: Opened[object], console: str, name: str, roles: tuple[str, ...],
                     arms: tuple[str, ...]) -> None:
        """Errors when the arms of a teleoperation are unknown, or its name, which is made of theirs, is taken."""
        for role, arm in zip(roles, arms, strict=True):
            self._check_arm(part, role, arm)
        content = self.system.content
        others = {row.name for rows in (content.IOs, content.arms, content.consoles) for row in rows}
        if name in self.taken:
            part.error("", f"teleop {name} is listed twice, first in {self.taken[name]}")
        elif name in others:
            part.error("", f"teleop {name} has the name of something else in this file",
                       "a unique name for every IO, arm, console and teleop")
        elif len(name) > MAX_NAME:
            part.error("", f"teleop {name} has a name of {len(name)} letters",
                       f"arm names of at most {MAX_NAME} letters in total")
        self.taken.setdefault(name, f"console {console}")

    def _check_arm(self, part: Opened[object], role: str, arm: str) -> None:
        family = role[:3]
        families = {row.name: row.type.split("_")[0] for row in self.system.content.arms}
        if families.get(arm) != family:
            known = [name for name, other in families.items() if other == family]
            part.unlisted(role, f"not of type {family}" if arm in families else "no arm of this name", known,
                          f"a {family} listed under arms")

    def _runs(self, made: TeleopPsmConfig | TeleopEcmConfig, keys: TeleopPsmKeys | TeleopEcmKeys) -> bool:
        """Whether a teleoperation can be started; a note if not."""
        name, note = made.name, self.system.note
        component = keys.component or "its component"
        if keys.type.endswith(GENERIC):
            note(f"not started: teleop {name} ({keys.type}): {component} is for the original software; for your own "
                 "teleoperation, write a program that reads and commands arms (docs/python.md), or use Trocar's with "
                 "your own arm (docs/third-party-masters.md)")
            return False
        if keys.type.endswith("_DERIVED"):
            note(f"teleop {name} ({keys.type}) is started as {keys.type.removesuffix('_DERIVED')}: {component} is for "
                 "the original software")
        absent = [arm for arm in made.arms if arm not in self.arms]
        if absent:
            note(f"not started: teleop {name} ({', '.join(absent)} not started)")
        if isinstance(made, TeleopPsmConfig) and made.mtm_is_haptic and any(
                row.name == made.mtm and row.type.endswith(GENERIC) and not is_from_ros(self.system.content, row)
                for row in self.system.content.arms):
            note(f"teleop {name}: {made.mtm} is a third-party program; unless that carries out move_cp and "
                 "body/servo_cf, say MTM_is_haptic: false and align_MTM: false")
        return not absent


def _load_focus(system: SystemFiles, operators: Collection[str]) -> tuple[Focus, ...]:
    """The focus controller; empty without one or with errors; `operators`: further names in use."""
    keys, content = system.content.ISI_focus_controller, system.content
    if keys is None:
        return ()
    name = keys.name or FOCUS_NAME
    taken = RESERVED | {row.name for rows in (content.IOs, content.arms) for row in rows}.union(operators)
    if name in taken or not is_name(name):
        system.error((FOCUS, "name"), "not a unique name", "letters, digits, _ and -, at most 40")
        return ()
    file = system.file_of(keys)
    if file is None:
        return ()  # reported already
    outputs = [row.name for row in file.digital_outputs]
    missing = [output for output in FOCUS_OUTPUTS if output not in outputs]
    if missing:
        system.error((FOCUS, "IO_file"), f"{keys.IO_file} has no digital output {', '.join(missing)}",
                     f"a file with {' and '.join(FOCUS_OUTPUTS)}; this one has {', '.join(outputs) or 'none'}")
        return ()
    pedals = [_pedal(system.buses, pedal) for pedal in FOCUS_PEDALS]
    found = tuple(pedal for pedal in pedals if pedal is not None)
    if len(found) < len(FOCUS_PEDALS):  # a single pedal could not move the lens back
        system.note(f"{name}: no pedals {' and '.join(FOCUS_PEDALS)}, only commands move the lens")
        found = ()
    return (Focus(name, PERIOD_S, keys.IO, FOCUS_OUTPUTS, found),)


def _pedal(buses: dict[str, BusFiles], name: str) -> WiredInput | None:
    """The first digital input of that name."""
    return next((WiredInput(io, name) for io, bus in buses.items() for content in bus.contents()
                 for row in content.digital_inputs if row.name == name), None)
