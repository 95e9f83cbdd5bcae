"""The `IOs` of a system with all their IO files, which arms, consoles and the IOs themselves name.

Other parts of an arm than its robot are found in IO files by their names, which begin with that of the arm:
PSM1_arm_clutch, PSM1_dallas.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from trocar.procs.config.loading import convert
from trocar.procs.config.loading.context import Context, Opened
from trocar.procs.config.loading.io_checks import board_ids, check_bus, check_io_file, robots_of
from trocar.procs.config.models.io_file import IoFile, RobotKeys
from trocar.procs.config.models.lookup_file import Tables, load_tables
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
_ENDS = tuple(f"_{end}" for end in INPUTS.values())


@dataclass(slots=True)
class BusFiles:
    """One bus, with its part of the system file, and its IO files by path."""

    part: Opened[IoKeys]
    files: dict[Path, Opened[IoFile] | None] = field(default_factory=dict)
    tables: Tables = field(default_factory=dict)

    @property
    def keys(self) -> IoKeys:
        """Its keys in the system file."""
        return self.part.content

    def opened(self) -> list[Opened[IoFile]]:
        """The readable files, in order."""
        return [opened for opened in self.files.values() if opened is not None]

    def contents(self) -> list[IoFile]:
        """The contents of the readable files."""
        return [opened.content for opened in self.opened()]

    def add(self, path: Path | None) -> Opened[IoFile] | None:
        """Read an IO file once."""
        if path is None:
            return None
        if path not in self.files:
            self.files[path], tables = open_io(self.part.context, path)
            self.tables |= tables
        return self.files[path]

    def robot(self, part: Opened[RobotKeys]) -> document.Robot:
        """A robot of these files for the document."""
        return convert.robot(part, self.tables.get((part.source.path, part.key), ""))

    def robots(self) -> Iterator[Opened[RobotKeys]]:
        """All robots with their files."""
        return (robot for opened in self.opened() for robot in robots_of(opened))

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
            self.unlisted(key, "no IO of this name", self.buses, "a name listed under IOs")
        return bus

    def file_of(self, device: IoDeviceKeys) -> IoFile | None:
        """The content of a device's own IO file; None when that has errors."""
        bus, path = self.buses.get(device.IO), self.context.search.find(device.IO_file)
        opened = bus.files.get(path) if bus is not None and path is not None else None
        return opened.content if opened is not None else None


def open_io(context: Context, path: Path) -> tuple[Opened[IoFile] | None, Tables]:
    """An IO file with all checks of it alone, and the tables of its digital potentiometers."""
    opened = context.open(IoFile, path)
    if opened is None:
        return None, {}
    check_io_file(opened)
    return opened, load_tables(opened)


def load_buses(system: SystemFiles) -> None:
    """Load all buses with their own files, and those of pedals, head sensors and the focus controller."""
    for part in system.each("IOs", system.content.IOs):
        _check_numbers(part)
        if not system.emulated:
            _check_port(part)
        bus = system.buses.setdefault(part.content.name, BusFiles(part))
        for name in part.each("configuration_files", part.content.configuration_files):
            bus.add(name.find("", name.content))
    devices = [console.at(name, getattr(console.content, name)) for name in ("IO_pedals", "IO_head_sensor")
               for console in system.each("consoles", system.content.consoles)]
    for device in (*devices, system.at("ISI_focus_controller", system.content.ISI_focus_controller)):
        if device.content is not None:
            found = system.find_bus(device.path("IO"), device.content.IO)
            path = device.find("IO_file", device.content.IO_file)
            if found is not None:
                found.add(path)


def check_buses(system: SystemFiles) -> None:
    """Check the files of each bus for conflicts, and for inputs of arms that do not exist."""
    arms = {name for arm in system.content.arms for name in (arm.name, arm.name_on_IO)}
    for bus in system.buses.values():
        check_bus(bus.opened())
        robots = {row.name for content in bus.contents() for row in content.robots}
        owners = tuple(f"{name}_" for name in sorted(robots.union(filter(None, arms))))
        for row in _inputs(bus):
            if row.content.name.endswith(_ENDS) and not row.content.name.startswith(owners):
                row.warning("name", "no arm or robot of this bus uses this input",
                            f"a name that begins with {' or '.join(owners)}")


def _inputs(bus: BusFiles | None) -> Iterator[Opened[document.DigitalInput]]:
    return (row for opened in (bus.opened() if bus else ())
            for row in opened.each("digital_inputs", opened.content.digital_inputs))


def _check_port(part: Opened[IoKeys]) -> None:
    try:
        PortName.parse(part.content.port)
    except PortNameError as error:
        part.error("port", error.what, f"{error.allowed}, or emulated boards (--boards)")


def _check_numbers(part: Opened[IoKeys]) -> None:
    if part.content.period > MAX_PERIOD_S:
        part.warning("period", "slow: gains and safety checks are made for 1 ms or less", f"up to {MAX_PERIOD_S} s")
    watchdog = part.content.watchdog_timeout
    if watchdog > MAX_WATCHDOG_S:
        part.warning("watchdog_timeout", f"{MAX_WATCHDOG_S} s is used instead", f"up to {MAX_WATCHDOG_S} s")
    if watchdog <= 0.0:
        text = "the watchdog of the boards is off: motors stay powered when this computer dies"
        part.warning("watchdog_timeout", text, f"above 0, up to {MAX_WATCHDOG_S} s")


def watchdog_s(keys: IoKeys) -> float:
    """The watchdog time to write to the boards; 0: off."""
    return min(max(keys.watchdog_timeout, 0.0), MAX_WATCHDOG_S)


def inputs_of(bus: BusFiles | None, arm: str, robot: str) -> document.ArmInputs:
    """The digital inputs of an arm with this robot; a warning for one whose name is likely misspelt."""
    there = {row.content.name: row for row in _inputs(bus)}
    found = {field: next((name for name in _names(arm, robot, end) if name in there), "")
             for field, end in INPUTS.items()}
    missing = [name for field, end in INPUTS.items() if not found[field] for name in _names(arm, robot, end)]
    for name, row in there.items():
        own = [meant for meant in missing if name.startswith((f"{arm}_", f"{robot}_")) and name not in found.values()]
        for meant in difflib.get_close_matches(name, own, n=1, cutoff=0.8):
            row.warning("name", f"the arm {arm} has no such input", f"perhaps {meant}")
    return document.ArmInputs(**found)


def reader_of(bus: BusFiles | None, arm: str, robot: str, keys: RobotKeys | None) -> str:
    """The reader of an arm's instrument memory: by its name, else the only one on the boards of its robot."""
    readers = [row for content in (bus.contents() if bus else ()) for row in content.dallas_chips]
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
