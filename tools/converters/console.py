"""Console files from before dVRK 2.4 (`console*.json`) to system files: one bus, the arms, one console."""

from __future__ import annotations

from dataclasses import dataclass, field

from trocar.procs.config import HEADS
from trocar.procs.config.models.system_file import ConsoleKeys, IoKeys, SystemFile
from trocar.procs.config.read.jsontext import Parsed
from trocar.procs.config.read.problem import value_text
from trocar.procs.fpga.port_name import PortName, PortNameError
from trocar.tools.converters.consolearm import Arms
from trocar.tools.converters.keys import Keys
from trocar.tools.converters.names import today
from trocar.tools.converters.report import ConversionReport, Json
from trocar.tools.converters.teleops import ecm_teleop, psm_teleop

BUS = "IO1"
CONSOLE = "console"

_OLD_BUS = "io"
_PROTOCOLS = {"broadcast-read-write": "broadcast-query-read-write"}
_TODAY = {  # behaviour of a bus without its keys, where that was different
    "protocol": ("broadcast-query-read-write", "today's default; it was sequential-read-broadcast-write"),
    "close_all_relays": ("true", "the default since 2.3.1; before, it was false"),
}
_INPUTS = ("clutch", "camera", "operator_present")
_PEDALS = {"clutch": "clutch", "camera": "camera", "operator_present": "coag"}
_TELEOP_KEYS = {"psm-teleops", "ecm-teleop"}
_INPUT_KEYS = {"console-inputs", "operator-present"}
_BUS_KEYS = {"endoscope-focus", "custom-components", "component-manager", "io"}
_ONLY_OLD = _TELEOP_KEYS | _INPUT_KEYS | _BUS_KEYS
_SETUP_JOINTS = {"measured-cp", "DH", "primary-offsets", "simulated-position"}  # of their arms; no format has changed
_ONLY_NEW = {"IOs", "consoles", "$id", "$version", "$schema"}


def looks_like_console(data: dict[str, object]) -> bool:
    """Whether an object is a console file: arms, and nothing that only today's files, or setup joints, have."""
    arms = data.get("arms")
    first = next((row for row in arms if isinstance(row, dict)), {}) if isinstance(arms, list) else {}
    if _ONLY_NEW & set(data) or _SETUP_JOINTS & {str(key).replace("_", "-") for key in first}:
        return False
    return "arms" in data or bool(_ONLY_OLD & set(data))


@dataclass(frozen=True, slots=True)
class ConsoleFiles:
    """The system file, and the arm files with keys from the old one, by their names."""

    system: Json
    arms: dict[str, Json] = field(default_factory=dict)


def convert_console(parsed: Parsed, system_name: str, report: ConversionReport) -> ConsoleFiles:
    """The new files; `system_name` is the name of the first, without suffix. Of no use when the report has problems."""
    for key, line in parsed.repeated:
        report.dropped(line, ".".join(str(part) for part in key), "", "the key occurs twice: the last one counts")
    top = Keys(parsed.data, parsed.lines, report)
    arms = Arms(top.items("arms"), BUS, system_name)
    system: Json = dict(HEADS["system"])
    io = top.inside("io")
    bus = _bus(top, io)
    pedals = io.file("footpedals") if io is not None else ""
    console = _console(top, io, pedals)
    psms = [psm_teleop(keys) for name in ("psm-teleops", "teleop_PSMs") for keys in top.items(name)]
    ecm = top.inside("ecm-teleop")
    ecms = [ecm_teleop(keys) for keys in ([ecm] if ecm is not None else []) + top.items("teleop_ECMs")]
    console |= top.keep(ConsoleKeys)
    uses_bus = arms.use_bus or bool(pedals) or "configuration_files" in bus or "IO_head_sensor" in console
    focus = top.inside("endoscope-focus")
    if focus is not None:
        bus_file = focus.file("io")
        system["ISI_focus_controller"] = {"name": "focus_controller", "IO": BUS, "IO_file": bus_file}
        uses_bus = True
    if uses_bus:
        system["IOs"] = [bus]
        for name, (new, why) in _TODAY.items():
            if name not in bus:
                top.defaulted(f"IOs[0].{name}", new, why)
    elif io is not None:
        left = {name: value for name, value in bus.items() if name != "name"}
        report.dropped(io.line(), io.key(), value_text(left), "no arm needs it")
    system["arms"] = arms.rows
    if psms or ecms or len(console) > 1:
        row: Json = {"name": CONSOLE, **console}
        row |= {"teleop_PSMs": psms} if psms else {}
        row |= {"teleop_ECMs": ecms} if ecms else {}
        system["consoles"] = [row]
        top.defaulted("consoles[0].name", CONSOLE, "there was one console, without a name")
    system |= _rest(top, [f"{row['MTM']}-{row['PSM']}" for row in psms])
    top.finish()
    return ConsoleFiles(system, arms.files)


def _bus(top: Keys, io: Keys | None) -> Json:
    row: Json = {"name": BUS}
    if io is None:
        return row | {"port": "fw"}
    row["port"] = _port(io)
    protocol = io.text("firewire-protocol")
    if protocol:
        row["protocol"] = _PROTOCOLS.get(protocol, protocol)
        if row["protocol"] != protocol:
            io.converted("firewire-protocol", protocol, str(row["protocol"]), "today's name")
    row |= io.read(IoKeys, skip=(*row, "protocol", "configuration_files"))
    files = io.take("configuration-files")
    if isinstance(files, list):
        row["configuration_files"] = [io.followed("configuration-files", str(name)) for name in files]
    elif files is not None:
        io.report.error(io.line(), io.key("configuration-files"), value_text(files), "wrong type", "a list of files")
    io.drop("physical-footpedals-required", "the console's input_type says it")
    io.drop("has-footpedals", "the console's input_type says it")
    return row


def _port(io: Keys) -> str:
    found = io.take("port")
    if isinstance(found, int) and not isinstance(found, bool):
        new = f"fw:{found}" if found else "fw"
        io.converted("port", str(found), new, "a number was a FireWire port")
        return new
    if found is None:
        return "fw"
    try:
        PortName.parse(str(found))
    except PortNameError as error:
        io.report.error(io.line("port"), io.key("port"), value_text(found), error.what, error.allowed)
    return str(found)


def _console(top: Keys, io: Keys | None, pedals: str) -> Json:
    """Sources of clutch, camera and operator."""
    sensor = top.inside("operator-present")
    given = top.inside("console-inputs")
    sources = {name: _interface(given, name.replace("_", "-")) for name in _INPUTS} if given is not None else {}
    if sensor is not None and sensor.has("component"):  # the first versions: an input of the arms' own IO files
        sources["operator_present"] = _own(sensor)
        sources |= {name: {"component": BUS, "interface": name} for name in ("clutch", "camera")}
    sources = {name: source for name, source in sources.items() if source}
    if sources:
        if pedals:
            for name in _INPUTS:
                sources.setdefault(name, {"component": BUS, "interface": _PEDALS[name]})
        for name in _INPUTS:
            if name not in sources:
                reason = "today's consoles need it: specify its source"
                top.report.lost(top.line(), f"console-inputs.{name}", "", reason)
        row: Json = {"input_type": "COMPONENTS", **sources}
        return row | ({"IO_pedals": _device(pedals)} if pedals else {})
    if not pedals:
        if sensor is not None:
            sensor.lose("io", "a head sensor needs foot pedals beside it today")
        return {"input_type": "SIMULATED"}
    row = {"input_type": "PEDALS_ONLY", "IO_pedals": _device(pedals)}
    if sensor is not None and sensor.has("io"):
        return row | {"input_type": "PEDALS_ISI_HEAD_SENSOR", "IO_head_sensor": _device(sensor.file("io"))}
    if sensor is not None and sensor.has("hid"):
        return row | {"input_type": "PEDALS_GOOVIS_HEAD_SENSOR", "HID_file": sensor.text("hid")}
    return row


def _device(file: str) -> Json:
    return {"IO": BUS, "IO_file": file}


def _interface(keys: Keys, name: str) -> Json | None:
    inside = keys.inside(name)
    return _own(inside) if inside is not None else None


def _own(keys: Keys) -> Json:
    component, interface = keys.text("component"), keys.text("interface")
    if component != _OLD_BUS:
        return {"component": component, "interface": interface}
    keys.converted("component", component, BUS, "the bus has a name now")
    if today(interface) != interface:
        keys.converted("interface", interface, today(interface), "today's name")
    return {"component": BUS, "interface": today(interface)}


def _rest(top: Keys, teleops: list[str]) -> Json:
    """Keys not about arms or the console; `teleops` are the names of components for teleoperations."""
    row = top.keep(SystemFile)
    chatty, settings = top.flag("chatty"), row.get("settings", {})
    if chatty is not None and isinstance(settings, dict):
        row["settings"] = {"chatty": chatty, **settings}
    manager = row.pop("component_manager", None) or top.take("component-manager")
    custom = top.take("custom-components")
    if custom is not None:
        top.converted("custom-components", "a list", "component_manager.components", "the same list")
        manager = {"components": custom} if manager is None else manager
    if manager is not None:
        row["component_manager"] = _renamed(manager, teleops, top)
    return row


def _renamed(data: object, names: list[str], top: Keys) -> object:
    """The same, with the names of teleoperations as they are today: `MTMR_PSM1`, not `MTMR-PSM1`."""
    if isinstance(data, dict):
        return {key: _renamed(value, names, top) for key, value in data.items()}
    if isinstance(data, list):
        return [_renamed(item, names, top) for item in data]
    if isinstance(data, str) and data in names:
        new = data.replace("-", "_")
        top.converted("component-manager", data, new, "today's name of a teleoperation")
        return new
    return data
