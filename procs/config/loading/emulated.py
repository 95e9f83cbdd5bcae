"""Emulated boards in place of real ones: their buses, addresses and robots."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Sequence
from ipaddress import IPv4Address

from trocar.procs.config.loading.arms import LoadedArm
from trocar.procs.config.loading.buses import BusFiles, SystemFiles
from trocar.procs.config.loading.context import Opened
from trocar.procs.config.loading.controllers import (
    BOARDS,
    EMULATION,
    BusPlace,
    check_broadcasts,
    check_hub_memory,
    controllers,
)
from trocar.procs.config.loading.convert import by_name
from trocar.procs.config.models.arm_file import PLUGS, SetupArmKeys, SetupFile
from trocar.procs.config.models.io_file import IoFile, RobotKeys
from trocar.procs.config.models.system_file import PROTOCOLS
from trocar.procs.config.models.trocar_section import EVERYWHERE, RAW, EmulatedBusKeys
from trocar.procs.config.read.sections import is_name
from trocar.procs.document import emulated
from trocar.procs.document import system as document
from trocar.procs.document.cart import LIFT_OUTPUTS, MULTIPLEXER_OUTPUTS
from trocar.procs.document.catalogue import find
from trocar.procs.document.emulated_names import names_on_boards

MAX_BUSES = 15  # addresses 127.x.y.16 to 127.x.y.240
LAST_OCTET = 254
OUTPUTS = (*MULTIPLEXER_OUTPUTS, *LIFT_OUTPUTS)
_ROOM = {"QLA1": 4, "DQLA": 8}  # axes and outputs alike


def default_addresses(system_name: str) -> Callable[[int], str]:
    """Addresses of buses by index 0, 1, …, in a part of 127/8 that depends on the name of the system."""
    digest = hashlib.sha256(system_name.encode()).digest()
    first, second = 1 + digest[0] % 254, digest[1]
    return lambda index: f"127.{first}.{second}.{16 * (index + 1)}"


def build_emulation(
    system: SystemFiles, arms: list[LoadedArm], address: Callable[[int], str]
) -> document.EmulationConfig | None:
    """The emulation of all buses, or, without any, of those in the section; notes the replaced ports.

    None when there is no controller.
    """
    options = system.options.emulation
    rows: list[document.BusConfig] = []
    places = list(_places(system))
    if len(places) > MAX_BUSES:
        key = ("IOs",) if system.buses else (*EMULATION, "buses")
        system.error(key, f"{len(places)} buses with emulated boards", f"at most {MAX_BUSES}")
        return None
    for place in places:
        bus, files = _bus(place, address(len(rows))), system.buses.get(place.name)
        if bus.controllers:
            rows.append(bus)
            _note(place, bus, files)
            check_hub_memory(place, bus.controllers)
        if files is not None:
            if bus.address.startswith(RAW):
                _check_raw_port(place, bus, files)
            check_broadcasts(place, bus.controllers, PROTOCOLS[files.keys.protocol])
    _check_addresses(places, rows)
    if not rows:
        return None
    return by_name(
        document.EmulationConfig, options, buses=tuple(rows), instruments=_instruments(system, arms),
        model_variations=_model_variations(system))


def ports_of(buses: Iterable[document.BusConfig]) -> dict[str, str]:
    """Ports of emulated buses by IO, for hosts on this machine; without those on raw Ethernet."""
    return {bus.io: _port_of(bus) for bus in buses if not bus.address.startswith(RAW)}


def _port_of(bus: document.BusConfig) -> str:
    address = "127.0.0.1" if bus.address == EVERYWHERE else bus.address
    forced = bus.network == "bridge" and _could_do_without_firewire(bus)
    return f"udpfw:{address}" if forced else f"udp:{address}"


def _could_do_without_firewire(bus: document.BusConfig) -> bool:
    """Whether its boards can be addressed without FireWire; then the host does so unless the port forces FireWire."""
    return bus.controllers[0].firmware >= 9 and bus.controllers[0].fpga == "V3"


def _places(system: SystemFiles) -> Iterable[BusPlace]:
    given = system.options.emulation.buses
    names: dict[str, list[Opened[IoFile]]] = {name: bus.opened() for name, bus in system.buses.items()}
    names = names or {name: [] for name in given}
    for name in given:
        part = system.at((*EMULATION, "buses", name), given[name])
        if name not in names:
            part.unlisted("", "no IO of this name", names)
        elif not is_name(name):
            part.error("", "not a name for a bus", "letters, digits, _ and -, at most 40")
        elif not system.buses and not part.content.controllers:
            part.error("controllers", "a bus without an IO needs controllers", 'e.g. {"0": {}}')
    for name, files in names.items():
        keys = given.get(name, EmulatedBusKeys())
        yield BusPlace(system, name, system.at((*EMULATION, "buses", name), keys), files)


def _bus(place: BusPlace, address: str) -> document.BusConfig:
    rows = controllers(place)
    testboard = bool(place.of_bus.testboard)
    without = [row.board_id for row in rows if row.hardware == "dRA1"]
    if testboard and without:
        text = f"the test board fits a QLA, not a dRA1 (board {', '.join(map(str, without))} of {place.name})"
        place.system.error(place.where("testboard"), text, "false")
    return document.BusConfig(io=place.name, address=place.keys.address or address, controllers=rows,
                              network="ethernet" if place.ethernet else "bridge", testboard=testboard)


def _note(place: BusPlace, bus: document.BusConfig, files: BusFiles | None) -> None:
    stays = bus.address.startswith(RAW)
    replaced = f"port {files.keys.port} replaced by " if files is not None and not stays else ""
    boards = ", ".join(str(board) for board in sorted(row.board_id for row in bus.controllers))
    text = f"{bus.io}: {replaced}emulated boards {boards} at {bus.address}"
    if bus.testboard:
        text += ", wired to the test board instead of robots"
    place.system.note(text)


def _check_raw_port(place: BusPlace, bus: document.BusConfig, files: BusFiles) -> None:
    """Check the port of a bus on raw Ethernet, which is not replaced: only the system file knows the interface."""
    if not files.keys.port.startswith("eth"):
        text = f"the emulated boards of {place.name} are on raw Ethernet ({bus.address})"
        files.part.error("port", text, "eth:INTERFACE, the interface at the other end of their cable")
    elif bus.network == "bridge" and not files.keys.port.startswith("ethfw") and _could_do_without_firewire(bus):
        files.part.error("port", f"the boards of {place.name} would be read without FireWire", "ethfw:INTERFACE")


def _check_addresses(places: list[BusPlace], rows: list[document.BusConfig]) -> None:
    """Check that addresses of buses do not overlap: from Rev 9 on a board has the address of its bus plus its id."""
    taken: dict[IPv4Address, str] = {}
    interfaces: dict[str, str] = {}
    place_of = {place.name: place for place in places}
    for bus in rows:
        part = place_of[bus.io].part
        if bus.address == EVERYWHERE:
            if len(rows) > 1:
                part.error("address", f"{EVERYWHERE} leaves no address for the other buses", "127.x.y.z")
            continue
        if bus.address.startswith(RAW):
            if bus.address in interfaces:
                text = f"{bus.address} belongs to {interfaces[bus.address]}"
                part.error("address", text, "a different interface for every bus")
            interfaces[bus.address] = bus.io
            continue
        base = IPv4Address(bus.address)
        shift = max((row.board_id for row in bus.controllers if row.firmware >= 9), default=0)
        room = LAST_OCTET - int(base) % 256
        if shift > room:
            text = f"board {shift} of {bus.io} has this address plus {shift}: it leaves its block"
            part.error("address", text, f"up to {base + room - shift}")
        count = BOARDS if bus.network == "ethernet" else shift + 1  # broadcasts are recognized by their sender there
        for own in (base + number for number in range(count)):
            if own in taken:
                part.error("address", f"{own} belongs to {taken[own]}", "different addresses for every bus")
                break
            taken[own] = bus.io


def _robots(system: SystemFiles) -> dict[str, RobotKeys]:
    """All robots on the buses, by their names on the boards."""
    robots = {(io, part.content.name): part.content for io, bus in system.buses.items() for part in bus.robots()}
    names = names_on_boards(robots)
    return {names[place]: robot for place, robot in robots.items()}


def _instruments(system: SystemFiles, arms: list[LoadedArm]) -> tuple[tuple[str, str], ...]:
    instruments = {item.arm.name: item.arm.tool.name for item in arms if item.arm.tool is not None}
    tools = {item.arm.name: item.arm.tools for item in arms}
    for arm, tool in system.options.emulation.instruments.items():
        if arm not in tools:
            system.unlisted((*EMULATION, "instruments", arm), "no arm of this name is emulated", tools, "nothing")
        found = find(tool, tools.get(arm, ())).entry
        instruments[arm] = found.name if found is not None else tool  # otherwise already reported
    return tuple(sorted(instruments.items()))


def _model_variations(system: SystemFiles) -> tuple[document.ModelVariation, ...]:
    robots = _robots(system)
    found = tuple(by_name(document.ModelVariation, keys, robot=name)
                  for name, keys in system.options.emulation.robots.items())
    for made in found:
        key, robot = (*EMULATION, "robots", made.robot), robots.get(made.robot)
        if robot is None:
            system.unlisted(key, "no robot of this name is emulated", robots, "nothing")
        else:
            for what, given, allowed in made.wrong_sizes(len(robot.actuators), len(robot.brakes)):
                system.error((*key, what), f"{given} values", allowed)
    return found


# -- Classic setup joints: their file, and the outputs and axes that reach them ----------------------------------------


def setup_joints_of(
    system: SystemFiles, emulation: document.EmulationConfig, ios: Sequence[document.IoConfig]
) -> tuple[emulated.EmulatedSetupJoints, ...]:
    """The Classic setup joints on the emulated boards of `ios`."""
    found = []
    for part in system.each("arms", system.content.arms):
        keys = part.content
        if keys.type == "SUJ_Classic" and keys.IO and keys.arm_file and keys.simulation == "NONE":
            opened = part.open(SetupFile, "arm_file", keys.arm_file)
            if opened is None:
                continue
            places = [(io, robot) for io in ios if io.name == keys.IO
                      for robot in io.robots if robot.name == (keys.name_on_IO or keys.name)]
            made = _fitted(emulation, *places[0], opened.content) if places else None
            if made is not None:
                found.append(made)
            else:
                need = f"{PLUGS} actuators and the outputs {', '.join(OUTPUTS)}, all on one QLA1 or DQLA"
                part.warning("", f"emulated without setup joints: {keys.IO} lacks what they need", need)
    return tuple(found)


def _fitted(
    emulation: document.EmulationConfig, io: document.IoConfig, robot: document.Robot, content: SetupFile
) -> emulated.EmulatedSetupJoints | None:
    """The setup joints on the board that has their actuators and outputs; None when no board has them all."""
    named = {row.name: row for row in io.digital_outputs}
    outputs = [named[name] for name in OUTPUTS if name in named]
    boards = [actuator.board_id for actuator in robot.actuators] + [output.board_id for output in outputs]
    axes, bits = [actuator.axis_id for actuator in robot.actuators], [output.bit_id for output in outputs]
    if len(set(boards)) != 1 or len(axes) != PLUGS or len(bits) != len(OUTPUTS):
        return None
    hardware = [row.hardware for bus in emulation.buses if bus.io == io.name
                for row in bus.controllers if row.board_id == boards[0]]
    if not hardware or max(*axes, *bits) >= _ROOM.get(hardware[0], 0):
        return None
    arms = tuple(map(_setup_arm, content.arms))
    reset, increment, pwm, disable = bits
    return emulated.EmulatedSetupJoints(robot.name, io.name, boards[0], tuple(axes), reset, increment, pwm, disable,
                                        arms)


def _setup_arm(keys: SetupArmKeys) -> emulated.EmulatedSetupArm:
    return by_name(
        emulated.EmulatedSetupArm, keys, lifts=keys.lifts, position=keys.simulated_position or (),
        primary=tuple(zip(keys.primary_scales or (), keys.primary_offsets or (), strict=False)),
        secondary=tuple(zip(keys.secondary_scales or (), keys.secondary_offsets or (), strict=False)))
