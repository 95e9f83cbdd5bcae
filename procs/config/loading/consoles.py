"""The `consoles` of a system: their inputs, and the teleoperations that join arms, as rows of the document."""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from typing import Final

from trocar.procs.config.loading.buses import BusFiles, file_of_device
from trocar.procs.config.loading.context import Context
from trocar.procs.config.loading.third_parties import COMPONENTS, GENERIC, place_of
from trocar.procs.config.models.hid_file import load_hid
from trocar.procs.config.models.system_file import (
    ConsoleKeys,
    InterfaceKeys,
    IoDeviceKeys,
    SystemFile,
    TeleopEcmKeys,
    TeleopEcmParameters,
    TeleopPsmKeys,
    TeleopPsmParameters,
)
from trocar.procs.config.read.problem import Key
from trocar.procs.config.read.source import SourceFile
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
from trocar.procs.document.third_party import ThirdParty

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
    "COMPONENTS": ("clutch", "camera", "operator_present"),
}
_HEAD_NAME = re.compile(r"head", re.IGNORECASE)


@dataclass(slots=True)
class Operation:
    """Who operates a system, and with what: its consoles came to the first three."""

    consoles: tuple[Console, ...] = ()
    teleop_psms: tuple[TeleopPsmConfig, ...] = ()
    teleop_ecms: tuple[TeleopEcmConfig, ...] = ()
    third_parties: tuple[ThirdParty, ...] = ()
    focuses: tuple[Focus, ...] = ()

    @property
    def names(self) -> set[str]:
        """Names of all of them."""
        rows: list[Console | TeleopPsmConfig | TeleopEcmConfig | ThirdParty | Focus] = [
            *self.consoles, *self.teleop_psms, *self.teleop_ecms, *self.third_parties, *self.focuses]
        return {row.name for row in rows}


def load_consoles(
    context: Context, source: SourceFile, content: SystemFile, buses: dict[str, BusFiles], arms: Collection[str],
    carts: Sequence[Cart] = (),
) -> Operation:
    """All consoles with their teleoperations; those whose arms do not run are noted and left out.

    `arms` are the names of those that run. Missing parts, unknown arms and teleoperations listed twice are errors.
    """
    setups = {cart.name: [arm.name for arm in cart.arms] for cart in carts}
    loader = _ConsoleLoader(context, source, content, buses, arms, setups)
    made = tuple(loader.console(index, keys) for index, keys in enumerate(content.consoles))
    return Operation(made, tuple(loader.psms), tuple(loader.ecms))


@dataclass(slots=True)
class _ConsoleLoader:
    """All consoles of one file."""

    context: Context
    source: SourceFile
    content: SystemFile
    buses: dict[str, BusFiles]
    arms: Collection[str]
    setups: dict[str, list[str]]  # setup arms by the setup joints that run
    taken: dict[str, str] = field(default_factory=dict)
    psms: list[TeleopPsmConfig] = field(default_factory=list)
    ecms: list[TeleopEcmConfig] = field(default_factory=list)

    def console(self, index: int, keys: ConsoleKeys) -> Console:
        """One entry of the list."""
        key: Key = ("consoles", index)
        for name in _NEEDS[keys.input_type]:
            if not getattr(keys, name):
                self.context.error(self.source, (*key, name),
                                   f"this key is required with input_type {keys.input_type}")
        ecms = [self._ecm((*key, "teleop_ECMs", place), keys.name, row) for place, row in enumerate(keys.teleop_ECMs)]
        psms = [self._psm((*key, "teleop_PSMs", place), keys.name, row) for place, row in enumerate(keys.teleop_PSMs)]
        self.ecms += [row for row in ecms if row is not None]
        self.psms += [row for row in psms if row is not None]
        names = tuple(row.name for row in (*ecms, *psms) if row is not None)
        return self._with_inputs(key, keys, names)

    # -- inputs --------------------------------------------------------------------------------------------------------

    def _with_inputs(self, key: Key, keys: ConsoleKeys, teleops: tuple[str, ...]) -> Console:
        if keys.input_type == COMPONENTS:
            clutch, camera, present = (self._component((*key, button), getattr(keys, button))
                                       for button in ("clutch", "camera", "operator_present"))
            return Console(keys.name, keys.input_type, PERIOD_S, teleops, clutch, camera, (present,) if present else ())
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
        return Console(keys.name, keys.input_type, PERIOD_S, teleops, clutch, camera, seen, count, turn_off,
                       self._head_on_usb(key, keys.HID_file) if keys.input_type == GOOVIS else None)

    def _head_on_usb(self, key: Key, name: str) -> HidSensor | None:
        path = self.context.find(self.source, (*key, "HID_file"), (name,)) if name else None
        return load_hid(self.context, path) if path is not None else None

    def _component(self, key: Key, keys: InterfaceKeys | None) -> WiredInput | None:
        """A digital input of an io, or a button of somebody's program."""
        bus = self.buses.get(keys.component) if keys is not None else None
        if keys is None or bus is None:
            return WiredInput(place_of(self.content, keys.component), keys.interface) if keys is not None else None
        names = [row.name for file in bus.opened() for row in file.content.digital_inputs]
        if keys.interface not in names:
            self.context.error(self.source, (*key, "interface"), f"{keys.component} has no such digital input",
                               f"one of {', '.join(names)}" if names else "an IO whose files have digital inputs")
            return None
        return WiredInput(keys.component, keys.interface)

    def _names(self, device: IoDeviceKeys, outputs: bool = False) -> list[str] | None:
        """Digital inputs (or outputs) of a device's own file; None when that has errors of its own."""
        file = file_of_device(self.context, device, self.buses)
        if file is None:
            return None
        return [row.name for row in (file.digital_outputs if outputs else file.digital_inputs)]

    def _input(self, key: Key, device: IoDeviceKeys | None, name: str) -> WiredInput | None:
        names = self._names(device) if device is not None else None
        if device is None or names is None:
            return None
        if name not in names:
            text = f"{device.IO_file} has no digital input {name}: nobody can press it"
            allowed = f"a file that has it; this one has {', '.join(names) or 'none'}"
            self.context.warning(self.source, (*key, "IO_file"), text, allowed)
            return None
        return WiredInput(device.IO, name)

    def _head_input(self, key: Key, device: IoDeviceKeys) -> WiredInput | None:
        """The one input of a dVRK head sensor: called as the device is, or the only one whose name says head."""
        names = self._names(device)
        if names is None:
            return None
        heads = [name for name in names if _HEAD_NAME.search(name)] or names
        if device.name in names:
            heads = [device.name]
        if len(heads) != 1:
            text = f"{device.IO_file} has {len(heads)} digital inputs that may be the head sensor"
            allowed = f"the name of one of {', '.join(names)}" if names else "a file with a digital input"
            self.context.error(self.source, (*key, "name"), text, allowed)
            return None
        return WiredInput(device.IO, heads[0])

    def _turn_off(self, device: IoDeviceKeys) -> WiredInput | None:
        return WiredInput(device.IO, TURN_OFF) if TURN_OFF in (self._names(device, True) or ()) else None

    # -- teleoperations -----------------------------------------------------------------------------------------------

    def _psm(self, key: Key, console: str, keys: TeleopPsmKeys) -> TeleopPsmConfig | None:
        given = keys.configure_parameter or TeleopPsmParameters()
        where = (*key, "configure_parameter")
        if given.align_MTM and not given.MTM_is_haptic:
            self.context.error(self.source, (*where, "align_MTM"), "an MTM that is not haptic cannot align", "false")
        if given.gripper_scaling.zero == given.gripper_scaling.max:
            text = "equal to zero's value"
            self.context.error(self.source, (*where, "gripper_scaling", "max"), text, "another angle")
        name = self._named(key, console, {"MTM": keys.MTM, "PSM": keys.PSM})
        if not self._runs(name, keys, (keys.MTM, keys.PSM)):
            return None
        frame = keys.PSM_base_frame
        if frame is not None and not self._has_base_frame(name, (*key, "PSM_base_frame"), frame):
            return None
        return TeleopPsmConfig(
            name, keys.MTM, keys.PSM, keys.period, console, given.scale, given.rotation_locked,
            given.translation_locked, given.align_MTM, given.start_orientation_tolerance,
            given.orientation_tolerance_after_clutch, given.start_gripper_threshold, given.start_roll_threshold,
            given.ignore_jaw, given.jaw_rate, given.jaw_rate_after_clutch, given.gripper_scaling.zero,
            given.gripper_scaling.max, given.use_MTM_linear_velocity, given.use_MTM_angular_velocity,
            given.MTM_is_haptic, frame.component if frame else "", frame.interface if frame else "")

    def _ecm(self, key: Key, console: str, keys: TeleopEcmKeys) -> TeleopEcmConfig | None:
        given = keys.configure_parameter or TeleopEcmParameters()
        name = self._named(key, console, {"MTML": keys.MTML, "MTMR": keys.MTMR, "ECM": keys.ECM})
        if keys.MTML == keys.MTMR:
            self.context.error(self.source, (*key, "MTMR"), "the same arm as MTML", "another MTM")
        if not self._runs(name, keys, (keys.MTML, keys.MTMR, keys.ECM)):
            return None
        return TeleopEcmConfig(name, keys.MTML, keys.MTMR, keys.ECM, keys.period, console, given.scale,
                                  given.camera_roll_offset)

    def _has_base_frame(self, teleop: str, key: Key, frame: InterfaceKeys) -> bool:
        """What carries the PSM is an arm that runs, or a setup arm (`interface`) of setup joints (`component`).

        False, with a note, where it may be one of the components that are left out: without it a PSM goes elsewhere.
        """
        if frame.component in self.setups:
            known = self.setups[frame.component]
            if frame.interface not in known:
                self.context.error(self.source, (*key, "interface"), f"{frame.component} has no such setup arm",
                                   f"one of {', '.join(known)}")
        elif frame.component not in self.arms and self.content.component_manager:
            self.context.notes.append(f"not started: teleop {teleop} (its PSM_base_frame is from {frame.component}, no "
                                      "arm and no setup joints; components of component_manager are left out)")
            return False
        elif frame.component not in self.arms:
            running = ", ".join((*self.setups, *self.arms))
            self.context.error(self.source, (*key, "component"), "no arm and no setup joints of this name are started",
                               f"one of {running}")
        return True

    def _named(self, key: Key, console: str, parts: dict[str, str]) -> str:
        """The teleoperation's name, of its arms' names; errors when they are unknown or the name is taken."""
        for role, arm in parts.items():
            self._check_arm((*key, role), role, arm)
        name = "_".join(parts.values())
        others = {row.name for rows in (self.content.IOs, self.content.arms, self.content.consoles) for row in rows}
        if name in self.taken:
            text = f"teleop {name} is listed twice, first in {self.taken[name]}"
            self.context.error(self.source, key, text)
        elif name in others:
            text = f"teleop {name} has the name of something else in this file"
            self.context.error(self.source, key, text, "a name of its own for every IO, arm, console and teleop")
        elif len(name) > MAX_NAME:
            text = f"teleop {name} has a name of {len(name)} letters"
            self.context.error(self.source, key, text, f"arms whose names are at most {MAX_NAME} letters together")
        self.taken.setdefault(name, f"console {console}")
        return name

    def _check_arm(self, key: Key, role: str, arm: str) -> None:
        family = role[:3]
        families = {row.name: row.type.split("_")[0] for row in self.content.arms}
        if families.get(arm) == family:
            return
        known = [name for name, other in families.items() if other == family]
        text = f"no {family}" if arm in families else "no arm of this name"
        self.context.error(self.source, key, text, f"one of {', '.join(known)}" if known else
                           f"a {family} listed under arms")

    def _runs(self, name: str, keys: TeleopPsmKeys | TeleopEcmKeys, arms: tuple[str, ...]) -> bool:
        """Whether it can be started; a note when it cannot."""
        absent = [arm for arm in arms if arm not in self.arms]
        if keys.type.endswith("_GENERIC"):
            self.context.notes.append(
                f"not started: teleop {name} ({keys.type}): {keys.component or 'its component'} is for the original "
                "software; a teleoperation of your own is a program that reads arms and asks them (docs/python.md), "
                "or one of ours with an arm of your own (docs/third-party-masters.md)")
            return False
        if keys.type.endswith("_DERIVED"):
            self.context.notes.append(f"teleop {name} ({keys.type}) is started as {keys.type.removesuffix('_DERIVED')}:"
                                      f" {keys.component or 'its component'} is for the original software")
        if absent:
            self.context.notes.append(f"not started: teleop {name} ({', '.join(absent)} not started)")
        given = keys.configure_parameter if isinstance(keys, TeleopPsmKeys) else None
        generic = arms[0] in [row.name for row in self.content.arms if row.type.endswith(GENERIC)]
        if generic and isinstance(keys, TeleopPsmKeys) and (given is None or given.MTM_is_haptic):
            self.context.notes.append(f"teleop {name}: {arms[0]} is a third-party program; unless that carries "
                                      "out move_cp and body/servo_cf, say MTM_is_haptic: false and align_MTM: false")
        return not absent
