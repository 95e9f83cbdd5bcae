"""The `IOs` of a system with every IO file that belongs to them, from arms, consoles and their own lists."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from trocar.procs.config.loading.context import Context, Opened
from trocar.procs.config.loading.io_checks import board_ids, check_bus, check_io_file
from trocar.procs.config.models.io_file import IoFile, RobotKeys
from trocar.procs.config.models.lookup_file import load_tables
from trocar.procs.config.models.system_file import IoDeviceKeys, IoKeys, SystemFile
from trocar.procs.config.read.problem import Key
from trocar.procs.config.read.source import SourceFile
from trocar.procs.fpga.port_name import PortName, PortNameError

MAX_PERIOD_S = 0.001
MAX_WATCHDOG_S = 0.3


@dataclass(slots=True)
class BusFiles:
    """One bus, where it stands in the system file, and its IO files by path."""

    keys: IoKeys
    key: Key
    files: dict[Path, Opened[IoFile] | None] = field(default_factory=dict)
    own: list[Path] = field(default_factory=list)  # its configuration_files
    tables: dict[tuple[Path, int], str] = field(default_factory=dict)  # of digital potentiometers, by file and robot

    def opened(self) -> list[Opened[IoFile]]:
        """The files that could be read, in order."""
        return [opened for opened in self.files.values() if opened is not None]

    def add(self, context: Context, path: Path) -> Opened[IoFile] | None:
        """Read an IO file once."""
        if path not in self.files:
            opened = context.open(IoFile, path)
            if opened is not None:
                check_io_file(context, opened)
                self.tables |= load_tables(context, opened)
            self.files[path] = opened
        return self.files[path]

    def robots(self) -> Iterator[tuple[Path, int, RobotKeys]]:
        """All robots with their files and places there."""
        for opened in self.opened():
            for index, robot in enumerate(opened.content.robots):
                yield opened.source.path, index, robot

    @property
    def has_boards(self) -> bool:
        """Whether any file names a board."""
        return any(board_ids(opened.content) for opened in self.opened())

    def robot(self, path: Path, name: str) -> tuple[Opened[IoFile], int, RobotKeys] | None:
        """The robot `name` of the file `path`, with its place in the file."""
        opened = self.files.get(path)
        for index, robot in enumerate(opened.content.robots if opened else ()):
            if opened is not None and robot.name == name:
                return opened, index, robot
        return None


def load_buses(context: Context, source: SourceFile, system: SystemFile, *, emulated: bool) -> dict[str, BusFiles]:
    """All buses with the files they name themselves."""
    buses: dict[str, BusFiles] = {}
    for index, keys in enumerate(system.IOs):
        key: Key = ("IOs", index)
        _check_numbers(context, source, key, keys)
        if not emulated:
            _check_port(context, source, (*key, "port"), keys.port)
        bus = buses.setdefault(keys.name, BusFiles(keys, key))
        for number, name in enumerate(keys.configuration_files):
            path = context.find(source, (*key, "configuration_files", number), (name,))
            if path is not None:
                bus.own.append(path)
                bus.add(context, path)
    return buses


def add_devices(context: Context, source: SourceFile, system: SystemFile, buses: dict[str, BusFiles]) -> None:
    """The IO files of pedals, head sensors and the focus controller."""
    for index, console in enumerate(system.consoles):
        key: Key = ("consoles", index)
        for name, device in (("IO_pedals", console.IO_pedals), ("IO_head_sensor", console.IO_head_sensor)):
            if device is not None:
                _add_device(context, source, (*key, name), device, buses)
    if system.ISI_focus_controller is not None:
        _add_device(context, source, ("ISI_focus_controller",), system.ISI_focus_controller, buses)


def find_bus(context: Context, source: SourceFile, key: Key, name: str, buses: dict[str, BusFiles]) -> BusFiles | None:
    """The bus called `name`; None with an error at `key`."""
    bus = buses.get(name)
    if bus is None:
        known = ", ".join(buses)
        context.error(source, key, "no IO of this name", f"one of {known}" if known else "a name listed under IOs")
    return bus


def file_of_device(context: Context, device: IoDeviceKeys, buses: dict[str, BusFiles]) -> IoFile | None:
    """What a device's own IO file says; None when that has errors of its own."""
    bus, path = buses.get(device.IO), context.search.find(device.IO_file)
    opened = bus.files.get(path) if bus is not None and path is not None else None
    return opened.content if opened is not None else None


def check_buses(context: Context, buses: dict[str, BusFiles]) -> None:
    """What must hold between the files of each bus."""
    for bus in buses.values():
        check_bus(context, bus.opened())


def _add_device(context: Context, source: SourceFile, key: Key, device: IoDeviceKeys,
                buses: dict[str, BusFiles]) -> None:
    bus = find_bus(context, source, (*key, "IO"), device.IO, buses)
    path = context.find(source, (*key, "IO_file"), (device.IO_file,))
    if bus is not None and path is not None:
        bus.add(context, path)


def _check_port(context: Context, source: SourceFile, key: Key, port: str) -> None:
    try:
        PortName.parse(port)
    except PortNameError as error:
        context.error(source, key, error.what, f"{error.allowed}, or emulated boards (--boards)")


def _check_numbers(context: Context, source: SourceFile, key: Key, keys: IoKeys) -> None:
    if keys.period > MAX_PERIOD_S:
        text = "slow: gains and safety checks are made for 1 ms or less"
        context.warning(source, (*key, "period"), text, f"up to {MAX_PERIOD_S} s")
    watchdog = keys.watchdog_timeout
    if watchdog > MAX_WATCHDOG_S:
        text = f"{MAX_WATCHDOG_S} s is used instead"
        context.warning(source, (*key, "watchdog_timeout"), text, f"up to {MAX_WATCHDOG_S} s")
    if watchdog <= 0.0:
        text = "the watchdog of the boards is off: motors stay powered when this computer dies"
        context.warning(source, (*key, "watchdog_timeout"), text, f"above 0, up to {MAX_WATCHDOG_S} s")


def watchdog_s(keys: IoKeys) -> float:
    """The watchdog time as it will be written to the boards; 0 is off."""
    return min(max(keys.watchdog_timeout, 0.0), MAX_WATCHDOG_S)
