"""The `IOs` of a system with all their IO files, which arms, consoles and the IOs themselves name.

Other parts of an arm than its robot are found in IO files by their names, which begin with that of the arm:
PSM1_arm_clutch, PSM1_dallas.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from trocar.procs.config.loading.context import Context, Opened
from trocar.procs.config.loading.io_checks import board_ids, check_bus, check_io_file
from trocar.procs.config.models.io_file import DallasKeys, IoFile, RobotKeys
from trocar.procs.config.models.lookup_file import load_tables
from trocar.procs.config.models.system_file import IoDeviceKeys, IoKeys, SystemFile
from trocar.procs.config.models.trocar_section import ProcessKeys, TrocarSection
from trocar.procs.config.read.problem import KeyPath
from trocar.procs.document import system as document
from trocar.procs.fpga.port_name import PortName, PortNameError

MAX_PERIOD_S = 0.001
MAX_WATCHDOG_S = 0.3

INPUTS = {
    "clutch": "arm_clutch",
    "adapter": "adapter",
    "tool": "tool",
    "suj_clutch": "SUJ_clutch",
    "suj_clutch_2": "SUJ_clutch_2",
}
"""Fields of `document.ArmInputs`, and the last parts of these inputs' names."""


@dataclass(slots=True)
class BusFiles:
    """One bus with its key in the system file, and its IO files by path."""

    keys: IoKeys
    key: KeyPath
    files: dict[Path, Opened[IoFile] | None] = field(default_factory=dict)
    tables: dict[tuple[Path, int], str] = field(default_factory=dict)  # of digital potentiometers, by file and robot

    def opened(self) -> list[Opened[IoFile]]:
        """The readable files, in order."""
        return [opened for opened in self.files.values() if opened is not None]

    def contents(self) -> list[IoFile]:
        """The contents of the readable files."""
        return [opened.content for opened in self.opened()]

    def add(self, context: Context, path: Path | None) -> Opened[IoFile] | None:
        """Read an IO file once."""
        if path is None:
            return None
        if path not in self.files:
            opened = context.open(IoFile, path)
            if opened is not None:
                check_io_file(opened)
                self.tables |= load_tables(opened)
            self.files[path] = opened
        return self.files[path]

    def robots(self) -> Iterator[tuple[Path, int, RobotKeys]]:
        """All robots with their files, and their indices there."""
        for opened in self.opened():
            for index, robot in enumerate(opened.content.robots):
                yield opened.source.path, index, robot

    @property
    def has_boards(self) -> bool:
        """Whether any file uses a board."""
        return any(map(board_ids, self.contents()))


@dataclass(frozen=True, slots=True)
class SystemFiles(Opened[SystemFile]):
    """A system file with its `trocar:` section, and the files of its buses; `emulated`: with emulated boards."""

    options: TrocarSection
    emulated: bool
    buses: dict[str, BusFiles] = field(default_factory=dict)

    def own(self, name: str) -> ProcessKeys:
        """The keys of a process in `trocar.processes`."""
        return self.options.processes.get(name) or ProcessKeys()

    def find_bus(self, key: KeyPath, name: str) -> BusFiles | None:
        """The bus called `name`; None with an error at `key`."""
        bus = self.buses.get(name)
        if bus is None:
            known = ", ".join(self.buses)
            self.error(key, "no IO of this name", f"one of {known}" if known else "a name listed under IOs")
        return bus

    def file_of(self, device: IoDeviceKeys) -> IoFile | None:
        """The content of a device's own IO file; None when that has errors."""
        bus, path = self.buses.get(device.IO), self.context.search.find(device.IO_file)
        opened = bus.files.get(path) if bus is not None and path is not None else None
        return opened.content if opened is not None else None


def load_buses(system: SystemFiles) -> None:
    """Load all buses with their own files, and those of pedals, head sensors and the focus controller."""
    for index, keys in enumerate(system.content.IOs):
        key: KeyPath = ("IOs", index)
        _check_numbers(system, key, keys)
        if not system.emulated:
            _check_port(system, (*key, "port"), keys.port)
        bus = system.buses.setdefault(keys.name, BusFiles(keys, key))
        for number, name in enumerate(keys.configuration_files):
            bus.add(system.context, system.find((*key, "configuration_files", number), name))
    devices: list[tuple[KeyPath, IoDeviceKeys | None]] = []
    for index, console in enumerate(system.content.consoles):
        devices += [(("consoles", index, "IO_pedals"), console.IO_pedals),
                    (("consoles", index, "IO_head_sensor"), console.IO_head_sensor)]
    for key, device in (*devices, (("ISI_focus_controller",), system.content.ISI_focus_controller)):
        if device is not None:
            found = system.find_bus((*key, "IO"), device.IO)
            path = system.find((*key, "IO_file"), device.IO_file)
            if found is not None:
                found.add(system.context, path)


def check_buses(system: SystemFiles) -> None:
    """Check the files of each bus for conflicts."""
    for bus in system.buses.values():
        check_bus(bus.opened())


def _check_port(system: SystemFiles, key: KeyPath, port: str) -> None:
    try:
        PortName.parse(port)
    except PortNameError as error:
        system.error(key, error.what, f"{error.allowed}, or emulated boards (--boards)")


def _check_numbers(system: SystemFiles, key: KeyPath, keys: IoKeys) -> None:
    if keys.period > MAX_PERIOD_S:
        text = "slow: gains and safety checks are made for 1 ms or less"
        system.warning((*key, "period"), text, f"up to {MAX_PERIOD_S} s")
    watchdog = keys.watchdog_timeout
    if watchdog > MAX_WATCHDOG_S:
        system.warning((*key, "watchdog_timeout"), f"{MAX_WATCHDOG_S} s is used instead", f"up to {MAX_WATCHDOG_S} s")
    if watchdog <= 0.0:
        text = "the watchdog of the boards is off: motors stay powered when this computer dies"
        system.warning((*key, "watchdog_timeout"), text, f"above 0, up to {MAX_WATCHDOG_S} s")


def watchdog_s(keys: IoKeys) -> float:
    """The watchdog time to write to the boards; 0: off."""
    return min(max(keys.watchdog_timeout, 0.0), MAX_WATCHDOG_S)


def inputs_of(bus: BusFiles | None, arm: str, robot: str) -> document.ArmInputs:
    """The digital inputs of an arm with this robot; a warning for one whose name is likely misspelt."""
    there = {row.name: (opened, index) for opened in (bus.opened() if bus else ())
             for index, row in enumerate(opened.content.digital_inputs)}
    found = {field: next((name for name in _names(arm, robot, end) if name in there), "")
             for field, end in INPUTS.items()}
    missing = [name for field, end in INPUTS.items() if not found[field] for name in _names(arm, robot, end)]
    for name, (opened, index) in there.items():
        own = [meant for meant in missing if name.startswith((f"{arm}_", f"{robot}_")) and name not in found.values()]
        for meant in difflib.get_close_matches(name, own, n=1, cutoff=0.8):
            opened.warning(("digital_inputs", index, "name"), f"the arm {arm} has no such input", f"{meant}, if meant")
    return document.ArmInputs(**found)


def reader_of(bus: BusFiles | None, arm: str, robot: str, keys: RobotKeys | None) -> str:
    """The reader of an arm's instrument memory: by its name, else the only one on the boards of its robot."""
    readers: list[DallasKeys] = [row for content in (bus.contents() if bus else ()) for row in content.dallas_chips]
    for name in _names(arm, robot, "dallas"):
        if any(row.name == name for row in readers):
            return name
    boards = {actuator.board_id for actuator in keys.actuators} if keys is not None else set()
    own = [row.name for row in readers if row.board_id in boards]
    return own[0] if len(own) == 1 else ""


def gripper_of(gripper_file: IoFile | None, arm: str, robot: str) -> str:
    """The robot of a master's gripper: by its name, else the only one of its file."""
    robots = [row.name for row in gripper_file.robots] if gripper_file is not None else []
    for name in _names(arm, robot, "gripper"):
        if name in robots:
            return name
    return robots[0] if len(robots) == 1 else ""


def _names(arm: str, robot: str, end: str) -> tuple[str, ...]:
    return f"{robot}_{end}", f"{arm}_{end}"
