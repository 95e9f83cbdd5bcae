"""Emulated boards in the place of real ones: which buses, at which address, instead of what, and with which robots."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable, Iterable
from ipaddress import IPv4Address

from trocar.procs.config.loading.arms import LoadedArm
from trocar.procs.config.loading.buses import BusFiles
from trocar.procs.config.loading.context import Context
from trocar.procs.config.loading.controllers import (
    BOARDS,
    EMULATION,
    BusPlace,
    bus_files,
    check_broadcasts,
    check_hub_memory,
    controllers,
)
from trocar.procs.config.models.emulation_section import EVERYWHERE, RAW, EmulatedBusKeys, EmulationOptions
from trocar.procs.config.models.io_file import RobotKeys
from trocar.procs.config.models.system_file import PROTOCOLS
from trocar.procs.config.read.problem import Key
from trocar.procs.config.read.source import SourceFile
from trocar.procs.document import system as document
from trocar.procs.document.catalogue import find
from trocar.procs.document.emulated_names import names_on_boards

MAX_BUSES = 15  # addresses 127.x.y.16 to 127.x.y.240
LAST_OCTET = 254
_NAME = re.compile(r"[A-Za-z0-9_-]{1,40}\Z")


def default_addresses(system_name: str) -> Callable[[int], str]:
    """Address of the bus with index 0, 1, …: in a part of 127/8 that depends on the name of the system."""
    digest = hashlib.sha256(system_name.encode()).digest()
    first, second = 1 + digest[0] % 254, digest[1]
    return lambda index: f"127.{first}.{second}.{16 * (index + 1)}"


def build_emulation(
    context: Context,
    source: SourceFile,
    buses: list[BusFiles],
    arms: list[LoadedArm],
    options: EmulationOptions,
    address: Callable[[int], str],
) -> document.EmulationConfig | None:
    """The emulation of all `buses`, or, without any, of those the section names; says in the notes what it replaced.

    None when there is no controller at all.
    """
    rows: list[document.BusConfig] = []
    places = list(_places(context, source, buses, options))
    if len(places) > MAX_BUSES:
        key = ("IOs",) if buses else (*EMULATION, "buses")
        context.error(source, key, f"{len(places)} buses with emulated boards", f"at most {MAX_BUSES}")
        return None
    by_name = {bus.keys.name: bus for bus in buses}
    for place in places:
        bus = _bus(place, address(len(rows)))
        if bus.controllers:
            rows.append(bus)
            _note(place, bus, by_name.get(place.name))
            check_hub_memory(place, bus.controllers)
        if place.name in by_name:
            if bus.address.startswith(RAW):
                _check_raw_port(place, bus, by_name[place.name])
            check_broadcasts(place, bus.controllers, PROTOCOLS[by_name[place.name].keys.protocol])
    _check_addresses(places, rows)
    robots = _robots(buses)
    if not rows:
        return None
    return document.EmulationConfig(
        period_s=options.period_s,
        buses=tuple(rows),
        seed=options.seed,
        pot_noise_v=options.pot_noise_v,
        instruments=_instruments(context, source, arms, options),
        model_variations=_model_variations(context, source, robots, options),
    )


def ports_of(buses: Iterable[document.BusConfig]) -> dict[str, str]:
    """By IO, the ports under which a host on this machine finds emulated buses, but for those on raw Ethernet."""
    return {bus.io: _port_of(bus) for bus in buses if not bus.address.startswith(RAW)}


def _port_of(bus: document.BusConfig) -> str:
    address = "127.0.0.1" if bus.address == EVERYWHERE else bus.address
    forced = bus.network == "bridge" and _could_do_without_firewire(bus)
    return f"udpfw:{address}" if forced else f"udp:{address}"


def _could_do_without_firewire(bus: document.BusConfig) -> bool:
    """And would, where the port does not say otherwise."""
    return bus.controllers[0].firmware >= 9 and bus.controllers[0].fpga == "V3"


def _places(
    context: Context, source: SourceFile, buses: list[BusFiles], options: EmulationOptions
) -> Iterable[BusPlace]:
    names = {bus.keys.name: bus_files(bus) for bus in buses}
    if not buses:
        names = dict.fromkeys(options.buses, ())
    for name in options.buses:
        key = (*EMULATION, "buses", name)
        if name not in names:
            context.error(source, key, "no IO of this name", f"one of {', '.join(names)}")
        elif not _NAME.match(name):
            context.error(source, key, "not a name for a bus", "letters, digits, _ and -, at most 40")
        elif not buses and not options.buses[name].controllers:
            context.error(source, (*key, "controllers"), "a bus without an IO needs controllers", 'e.g. {"0": {}}')
    for name, files in names.items():
        yield BusPlace(context, source, name, options.buses.get(name, EmulatedBusKeys()), options, files)


def _bus(place: BusPlace, address: str) -> document.BusConfig:
    rows = controllers(place)
    testboard = bool(place.of_bus.testboard)
    without = [row.board_id for row in rows if row.hardware == "dRA1"]
    if testboard and without:
        text = f"the test board fits a QLA, not a dRA1 (board {', '.join(map(str, without))} of {place.name})"
        place.error(place.where("testboard"), text, "false")
    return document.BusConfig(
        io=place.name,
        address=place.keys.address or address,
        controllers=rows,
        network="ethernet" if place.ethernet else "bridge",
        testboard=testboard,
    )


def _note(place: BusPlace, bus: document.BusConfig, files: BusFiles | None) -> None:
    stays = bus.address.startswith(RAW)
    replaced = f"port {files.keys.port} replaced by " if files is not None and not stays else ""
    boards = ", ".join(str(board) for board in sorted(row.board_id for row in bus.controllers))
    text = f"{bus.io}: {replaced}emulated boards {boards} at {bus.address}"
    if bus.testboard:
        text += ", wired to the test board instead of robots"
    place.context.notes.append(text)


def _check_raw_port(place: BusPlace, bus: document.BusConfig, files: BusFiles) -> None:
    """Nobody but the system file can know at which interface the host hears the boards: its port stays."""
    key: Key = (*files.key, "port")
    if not files.keys.port.startswith("eth"):
        text = f"the emulated boards of {place.name} are on raw Ethernet ({bus.address})"
        place.error(key, text, "eth:INTERFACE, the other end of their cable")
    elif bus.network == "bridge" and not files.keys.port.startswith("ethfw") and _could_do_without_firewire(bus):
        place.error(key, f"the boards of {place.name} would be asked without FireWire", "ethfw:INTERFACE")


def _check_addresses(places: list[BusPlace], rows: list[document.BusConfig]) -> None:
    """From Rev 9 on a board's address is that of its bus plus its board id; no two buses may meet there."""
    taken: dict[IPv4Address, str] = {}
    interfaces: dict[str, str] = {}
    place_of = {place.name: place for place in places}
    for bus in rows:
        place = place_of[bus.io]
        key: Key = (*place.key, "address")
        if bus.address == EVERYWHERE:
            if len(rows) > 1:
                place.error(key, f"{EVERYWHERE} leaves no address to the other buses", "127.x.y.z")
            continue
        if bus.address.startswith(RAW):
            if bus.address in interfaces:
                place.error(key, f"{bus.address} belongs to {interfaces[bus.address]}", "an interface for every bus")
            interfaces[bus.address] = bus.io
            continue
        base = IPv4Address(bus.address)
        shift = max((row.board_id for row in bus.controllers if row.firmware >= 9), default=0)
        room = LAST_OCTET - int(base) % 256
        if shift > room:
            allowed = f"up to {base + room - shift}"
            place.error(key, f"board {shift} of {bus.io} has this address plus {shift}: it leaves its block", allowed)
        count = BOARDS if bus.network == "ethernet" else shift + 1  # what is for all is known by its sender there
        for own in (base + number for number in range(count)):
            if own in taken:
                place.error(key, f"{own} belongs to {taken[own]}", "addresses of its own for every bus")
                break
            taken[own] = bus.io


def _robots(buses: list[BusFiles]) -> dict[str, RobotKeys]:
    """All robots on the buses, by their names on the boards."""
    robots = {(bus.keys.name, robot.name): robot
              for bus in buses for opened in bus.opened() for robot in opened.content.robots}
    names = names_on_boards(robots)
    return {names[place]: robot for place, robot in robots.items()}


def _instruments(
    context: Context, source: SourceFile, arms: list[LoadedArm], options: EmulationOptions
) -> tuple[tuple[str, str], ...]:
    instruments = {item.arm.name: item.arm.tool.name for item in arms if item.arm.tool is not None}
    names = [item.arm.name for item in arms]
    tools = {item.arm.name: item.arm.tools for item in arms}
    for arm, tool in options.instruments.items():
        if arm not in names:
            key = (*EMULATION, "instruments", arm)
            allowed = f"one of {', '.join(names)}" if names else "nothing"
            context.error(source, key, "no arm of this name is emulated", allowed)
        found = find(tool, tools.get(arm, ())).entry
        instruments[arm] = found.name if found is not None else tool  # otherwise it has been told of
    return tuple(sorted(instruments.items()))


def _model_variations(
    context: Context, source: SourceFile, robots: dict[str, RobotKeys], options: EmulationOptions
) -> tuple[document.ModelVariation, ...]:
    for name, keys in options.robots.items():
        key = (*EMULATION, "robots", name)
        robot = robots.get(name)
        if robot is None:
            allowed = f"one of {', '.join(robots)}" if robots else "nothing"
            context.error(source, key, "no robot of this name is emulated", allowed)
            continue
        count = len(robot.actuators)
        for what, values in (("backlash", keys.backlash), ("pot_offset", keys.pot_offset)):
            if values and len(values) != count:
                context.error(source, (*key, what), f"{len(values)} values", f"{count}, one an actuator")
    return tuple(document.ModelVariation(name, **keys.model_dump()) for name, keys in options.robots.items())
