"""The operation of a system: consoles with their inputs, teleoperations between arms, the focus controller, and
third-party programs in place of arms (`_GENERIC` types) and pedals (`COMPONENTS`)."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from typing import Final

from trocar.procs.config.loading.arms import base_frame_of
from trocar.procs.config.loading.buses import BusFiles, SystemFiles
from trocar.procs.config.loading.convert import by_name
from trocar.procs.config.models.hid_file import load_hid
from trocar.procs.config.models.system_file import (
    RESERVED,
    ConsoleKeys,
    InterfaceKeys,
    IoDeviceKeys,
    SystemFile,
    TeleopEcmKeys,
    TeleopEcmParameters,
    TeleopPsmKeys,
    TeleopPsmParameters,
)
from trocar.procs.config.read.problem import KeyPath
from trocar.procs.config.read.validate import is_name
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

GENERIC: Final = "_GENERIC"
COMPONENTS: Final = "COMPONENTS"
BUTTONS: Final = ("clutch", "camera", "operator_present")
FOCUS: Final = "ISI_focus_controller"
FOCUS_NAME: Final = "focus_controller"
FOCUS_OUTPUTS: Final = ("endoscope_focus_in", "endoscope_focus_out")
FOCUS_PEDALS: Final = ("focus_plus", "focus_minus")  # in, out
_MAX_BUTTON: Final = 24  # size of the field in an event
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
    consoles = tuple(loader.console(index, keys) for index, keys in enumerate(system.content.consoles))
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

    def console(self, index: int, keys: ConsoleKeys) -> Console:
        """Load one entry of the list."""
        key: KeyPath = ("consoles", index)
        for name in _NEEDS[keys.input_type]:
            if not getattr(keys, name):
                self.system.error((*key, name), f"this key is required with input_type {keys.input_type}")
        for name, types in _USED_BY.items():
            if getattr(keys, name) and keys.input_type not in types:
                self.system.error((*key, name), f"not used with input_type {keys.input_type}",
                                  f"input_type {' or '.join(types)}, or no such key")
        ecms = [self._ecm((*key, "teleop_ECMs", place), keys.name, row) for place, row in enumerate(keys.teleop_ECMs)]
        psms = [self._psm((*key, "teleop_PSMs", place), keys.name, row) for place, row in enumerate(keys.teleop_PSMs)]
        self.ecms += [row for row in ecms if row is not None]
        self.psms += [row for row in psms if row is not None]
        names = tuple(row.name for row in (*ecms, *psms) if row is not None)
        return self._with_inputs(key, keys, names)

    # -- inputs --------------------------------------------------------------------------------------------------------

    def _with_inputs(self, key: KeyPath, keys: ConsoleKeys, teleops: tuple[str, ...]) -> Console:
        period_s = self.system.own(keys.name).period_s or PERIOD_S
        if keys.input_type == COMPONENTS:
            clutch, camera, present = (self._component((*key, button), getattr(keys, button)) for button in BUTTONS)
            return Console(keys.name, keys.input_type, period_s, teleops, clutch, camera, (present,) if present else ())
        wired = keys.input_type.startswith("PEDALS")
        pedals = keys.IO_pedals if wired else None
        clutch, camera = (self._input((*key, PEDALS), pedals, name) for name in ("clutch", "camera"))
        seen: tuple[WiredInput, ...] = ()
        count, turn_off = 1, None
        if keys.input_type == "PEDALS_ONLY":
            coag = self._input((*key, PEDALS), pedals, "coag")
            seen = (coag,) if coag else ()
        elif keys.input_type == "PEDALS_ISI_HEAD_SENSOR" and keys.IO_head_sensor is not None:
            beams = [self._input((*key, HEAD), keys.IO_head_sensor, beam) for beam in BEAMS]
            seen, count = tuple(beam for beam in beams if beam), BEAMS_NEEDED
            turn_off = self._turn_off(keys.IO_head_sensor)
        elif keys.input_type == "PEDALS_DVRK_HEAD_SENSOR" and keys.IO_head_sensor is not None:
            head = self._head_input((*key, HEAD), keys.IO_head_sensor)
            seen = (head,) if head else ()
        return Console(keys.name, keys.input_type, period_s, teleops, clutch, camera, seen, count, turn_off,
                       self._head_on_usb(key, keys.HID_file) if keys.input_type == GOOVIS else None)

    def _head_on_usb(self, key: KeyPath, name: str) -> HidSensor | None:
        path = self.system.find((*key, "HID_file"), name) if name else None
        return load_hid(self.system.context, path) if path is not None else None

    def _component(self, key: KeyPath, keys: InterfaceKeys | None) -> WiredInput | None:
        """A digital input of an io, or a button of a third-party program."""
        if keys is None:
            return None
        bus = self.system.buses.get(keys.component)
        if bus is None:
            return WiredInput(place_of(self.system.content, keys), keys.interface)
        names = [row.name for content in bus.contents() for row in content.digital_inputs]
        if keys.interface not in names:
            self.system.error((*key, "interface"), f"{keys.component} has no such digital input",
                               f"one of {', '.join(names)}" if names else "an IO whose files have digital inputs")
            return None
        return WiredInput(keys.component, keys.interface)

    def _names(self, device: IoDeviceKeys, outputs: bool = False) -> list[str] | None:
        """Digital inputs (or outputs) of a device's own file; None when that file has errors."""
        file = self.system.file_of(device)
        if file is None:
            return None
        return [row.name for row in (file.digital_outputs if outputs else file.digital_inputs)]

    def _input(self, key: KeyPath, device: IoDeviceKeys | None, name: str) -> WiredInput | None:
        names = self._names(device) if device is not None else None
        if device is None or names is None:
            return None
        if name not in names:
            text = f"{device.IO_file} has no digital input {name}: it cannot be pressed"
            allowed = f"a file that has it; this one has {', '.join(names) or 'none'}"
            self.system.warning((*key, "IO_file"), text, allowed)
            return None
        return WiredInput(device.IO, name)

    def _head_input(self, key: KeyPath, device: IoDeviceKeys) -> WiredInput | None:
        """The input of a dVRK head sensor: that with the device's name, else the only one with `head` in its name, or
        the only one at all.
        """
        names = self._names(device)
        if names is None:
            return None
        heads = [name for name in names if _HEAD_NAME.search(name)] or names
        if device.name in names:
            heads = [device.name]
        if len(heads) != 1:
            text = f"{device.IO_file} has {len(heads)} digital inputs that may be the head sensor"
            allowed = f"the name of one of {', '.join(names)}" if names else "a file with a digital input"
            self.system.error((*key, "name"), text, allowed)
            return None
        return WiredInput(device.IO, heads[0])

    def _turn_off(self, device: IoDeviceKeys) -> WiredInput | None:
        return WiredInput(device.IO, TURN_OFF) if TURN_OFF in (self._names(device, True) or ()) else None

    # -- teleoperations -----------------------------------------------------------------------------------------------

    def _psm(self, key: KeyPath, console: str, keys: TeleopPsmKeys) -> TeleopPsmConfig | None:
        given = keys.configure_parameter or TeleopPsmParameters()
        where = (*key, "configure_parameter")
        if given.align_MTM and not given.MTM_is_haptic:
            self.system.error((*where, "align_MTM"), "an MTM that is not haptic cannot align", "false")
        if given.gripper_scaling.zero == given.gripper_scaling.max:
            text = "equal to zero's value"
            self.system.error((*where, "gripper_scaling", "max"), text, "another angle")
        name = self._named(key, console, {"MTM": keys.MTM, "PSM": keys.PSM})
        if not self._runs(name, keys, (keys.MTM, keys.PSM)):
            return None
        frame = keys.PSM_base_frame
        if frame is not None and not self._has_base_frame(name, (*key, "PSM_base_frame"), frame):
            return None
        return by_name(
            TeleopPsmConfig, keys, given, name=name, period_s=self._period_s(name, keys), console=console,
            gripper_zero=given.gripper_scaling.zero, gripper_max=given.gripper_scaling.max,
            base_frame_from=frame.component if frame else "", base_frame_interface=frame.interface if frame else "",
            wrench_timeout_s=self.system.options.arm.effort_timeout_s)

    def _ecm(self, key: KeyPath, console: str, keys: TeleopEcmKeys) -> TeleopEcmConfig | None:
        given = keys.configure_parameter or TeleopEcmParameters()
        name = self._named(key, console, {"MTML": keys.MTML, "MTMR": keys.MTMR, "ECM": keys.ECM})
        if keys.MTML == keys.MTMR:
            self.system.error((*key, "MTMR"), "the same arm as MTML", "another MTM")
        if not self._runs(name, keys, (keys.MTML, keys.MTMR, keys.ECM)):
            return None
        return by_name(TeleopEcmConfig, keys, given, name=name, period_s=self._period_s(name, keys), console=console)

    def _period_s(self, name: str, keys: TeleopPsmKeys | TeleopEcmKeys) -> float:
        return self.system.own(name).period_s or keys.period

    def _has_base_frame(self, teleop: str, key: KeyPath, frame: InterfaceKeys) -> bool:
        """Check that the PSM's base frame is from a running arm, or a setup arm (`interface`) of a `component`.

        False, with a note, if it may be from an unsupported component: without that frame the PSM would move elsewhere.
        """
        if frame.component in self.setups:
            known = self.setups[frame.component]
            if frame.interface not in known:
                self.system.error((*key, "interface"), f"{frame.component} has no such setup arm",
                                   f"one of {', '.join(known)}")
        elif frame.component not in self.arms and self.system.content.component_manager:
            self.system.note(f"not started: teleop {teleop} (its PSM_base_frame is from {frame.component}, no "
                                      "arm and no setup joints; components of component_manager are left out)")
            return False
        elif frame.component not in self.arms:
            running = ", ".join((*self.setups, *self.arms))
            self.system.error((*key, "component"), "no arm and no setup joints of this name are started",
                               f"one of {running}")
        return True

    def _named(self, key: KeyPath, console: str, parts: dict[str, str]) -> str:
        """The teleoperation's name, made of its arms' names; errors when these are unknown, or the name is taken."""
        for role, arm in parts.items():
            self._check_arm((*key, role), role, arm)
        name = "_".join(parts.values())
        content = self.system.content
        others = {row.name for rows in (content.IOs, content.arms, content.consoles) for row in rows}
        if name in self.taken:
            text = f"teleop {name} is listed twice, first in {self.taken[name]}"
            self.system.error(key, text)
        elif name in others:
            text = f"teleop {name} has the name of something else in this file"
            self.system.error(key, text, "a unique name for every IO, arm, console and teleop")
        elif len(name) > MAX_NAME:
            text = f"teleop {name} has a name of {len(name)} letters"
            self.system.error(key, text, f"arms whose names are at most {MAX_NAME} letters together")
        self.taken.setdefault(name, f"console {console}")
        return name

    def _check_arm(self, key: KeyPath, role: str, arm: str) -> None:
        family = role[:3]
        families = {row.name: row.type.split("_")[0] for row in self.system.content.arms}
        if families.get(arm) == family:
            return
        known = [name for name, other in families.items() if other == family]
        text = f"no {family}" if arm in families else "no arm of this name"
        self.system.error(key, text, f"one of {', '.join(known)}" if known else
                           f"a {family} listed under arms")

    def _runs(self, name: str, keys: TeleopPsmKeys | TeleopEcmKeys, arms: tuple[str, ...]) -> bool:
        """Whether a teleoperation can be started; a note if not."""
        absent = [arm for arm in arms if arm not in self.arms]
        if keys.type.endswith("_GENERIC"):
            self.system.note(
                f"not started: teleop {name} ({keys.type}): {keys.component or 'its component'} is for the original "
                "software; for your own teleoperation, write a program that reads and commands arms (docs/python.md), "
                "or use Trocar's with your own arm (docs/third-party-masters.md)")
            return False
        if keys.type.endswith("_DERIVED"):
            self.system.note(f"teleop {name} ({keys.type}) is started as {keys.type.removesuffix('_DERIVED')}:"
                                      f" {keys.component or 'its component'} is for the original software")
        if absent:
            self.system.note(f"not started: teleop {name} ({', '.join(absent)} not started)")
        given = keys.configure_parameter if isinstance(keys, TeleopPsmKeys) else None
        generic = arms[0] in [row.name for row in self.system.content.arms if row.type.endswith(GENERIC)]
        if generic and isinstance(keys, TeleopPsmKeys) and (given is None or given.MTM_is_haptic):
            self.system.note(f"teleop {name}: {arms[0]} is a third-party program; unless that carries "
                                      "out move_cp and body/servo_cf, say MTM_is_haptic: false and align_MTM: false")
        return not absent


def load_third_parties(system: SystemFiles) -> tuple[ThirdParty, ...]:
    """Generic arms, then other components with inputs of consoles, each with its required buttons."""
    content = system.content
    found = {row.name: ThirdParty(row.name, row.type, (), base_frame_of(system, ("arms", index), row),
                                  (row.base_frame.reference_frame or "") if row.base_frame else "")
             for index, row in enumerate(content.arms) if row.type.endswith(GENERIC)}
    for index, row in enumerate(content.arms):
        if row.name in found and row.base_frame is not None and row.base_frame.transform is None:
            system.warning(("arms", index, "base_frame"), "the program that provides this arm has to apply it "
                           "itself", "reference_frame and transform")
    for index, console in enumerate(content.consoles):
        for button in BUTTONS if console.input_type == COMPONENTS else ():
            _ask_button(system, ("consoles", index, button), getattr(console, button), found)
    return tuple(found.values())


def place_of(content: SystemFile, button: InterfaceKeys) -> str:
    """The process or place of a button: a generic arm may be named by its component, too.

    Of several arms of one component, the one whose interface begins the button's (`MTMR/A`); "" if there is none.
    """
    arms = [row for row in content.arms if row.type.endswith(GENERIC) and button.component == row.component]
    if len(arms) > 1:
        return next((row.name for row in arms if button.interface.startswith(f"{row.interface or row.name}/")), "")
    return arms[0].name if arms else button.component


def _ask_button(system: SystemFiles, key: KeyPath, keys: InterfaceKeys | None, found: dict[str, ThirdParty]) -> None:
    """Add the button of one console input to a third-party program, unless the input is an io's."""
    content = system.content
    if keys is None or keys.component in [row.name for row in content.IOs]:
        return
    name = place_of(content, keys)
    if not name:
        arms = [row for row in content.arms if row.type.endswith(GENERIC) and row.component == keys.component]
        system.error((*key, "interface"), f"{keys.component} provides {', '.join(row.name for row in arms)}: whose "
                     "button is it?", " or ".join(f"{row.interface or row.name}/{keys.interface}" for row in arms)
                     + ", or the name of the arm as component")
        return
    if name not in found:
        taken = RESERVED | {row.name for rows in (content.arms, content.consoles) for row in rows}
        for console in content.consoles:
            taken |= {f"{row.MTM}_{row.PSM}" for row in console.teleop_PSMs}
            taken |= {f"{row.MTML}_{row.MTMR}_{row.ECM}" for row in console.teleop_ECMs}
        if name in taken or not is_name(name):
            text = "something else that has no buttons" if name in taken else "not a name for a place in the system"
            system.error((*key, "component"), text, "an IO, an arm of a _GENERIC type, or a unique name of "
                         "letters, digits, _ and -, at most 40, for your own program")
            return
        found[name] = ThirdParty(name, "")
    if not 0 < len(keys.interface.encode()) <= _MAX_BUTTON:
        system.error((*key, "interface"), "not a name for a button", f"1 to {_MAX_BUTTON} bytes")
    elif keys.interface not in found[name].inputs:
        found[name] = dataclasses.replace(found[name], inputs=(*found[name].inputs, keys.interface))


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
