"""A system file with everything it names becomes one document, or a list of everything that is wrong with it."""

from __future__ import annotations

import dataclasses
import grp
import pwd
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from trocar.procs.config.loading import convert
from trocar.procs.config.loading.arms import LoadedArm, load_arm
from trocar.procs.config.loading.bridges import load_foxglove, load_gui, load_socket
from trocar.procs.config.loading.buses import BusFiles, add_devices, check_buses, load_buses, watchdog_s
from trocar.procs.config.loading.carts import load_carts, with_base_frames, with_brakes
from trocar.procs.config.loading.components import warn_of_components
from trocar.procs.config.loading.consoles import Operation, load_consoles
from trocar.procs.config.loading.context import Context
from trocar.procs.config.loading.emulated import build_emulation, default_addresses, ports_of
from trocar.procs.config.loading.focus import load_focus
from trocar.procs.config.loading.instances import build_processes, placement, with_period
from trocar.procs.config.loading.kinematic_arms import KINEMATIC, KINEMATIC_IO
from trocar.procs.config.loading.overrides import SECTION, apply_overrides
from trocar.procs.config.loading.placement import Core
from trocar.procs.config.loading.setup_joints import with_setup_joints
from trocar.procs.config.loading.tasks import with_tasks
from trocar.procs.config.loading.third_parties import load_third_parties
from trocar.procs.config.loading.user_processes import by_name, load_user_processes
from trocar.procs.config.models.system_file import PERIOD_S, PROTOCOLS, RESERVED, SystemFile
from trocar.procs.config.models.trocar_section import RecorderKeys, RosOptions, TrocarSection
from trocar.procs.config.read.problem import ERROR, WARNING, FileProblem
from trocar.procs.config.read.search import SearchPath, expanded, search_beside, search_path
from trocar.procs.config.read.source import SourceFile, read_source
from trocar.procs.config.read.validate import validate
from trocar.procs.document import system as document
from trocar.procs.machine.paths import PROJECT_CONFIGS, is_folder

_NAME = re.compile(r"[A-Za-z0-9_-]{1,40}\Z")
_SIMULATED = (document.PACED, document.LOCKSTEP)
_OLD_KEYS = {"arms", "console", "io", "psm-teleops", "ecm-teleop", "suj"}
_SYSTEM_ID = "dvrk-system.schema.json"


@dataclass(frozen=True, slots=True)
class Loaded:
    """A loaded system: no document when there are errors."""

    system: document.SystemConfig | None
    warnings: tuple[FileProblem, ...]
    errors: tuple[FileProblem, ...]


def load_system(
    path: Path | str,
    *,
    search: Sequence[Path] = (),
    boards: str | None = None,
    sets: Mapping[str, str] | Sequence[str] = (),
    name: str | None = None,
    configs: Path = PROJECT_CONFIGS,
    bus_address: Callable[[int], str] | None = None,
    cores: Sequence[Core] = (),
    records: bool = False,
) -> Loaded:
    """Load a system file (JSON or YAML) and all files it names; nothing is written.

    `search` is what `--path` gives, `boards` "emulated" or None (as the file says), `sets` the `--set` options, `name`
    the system's name (default: the file's), `bus_address` gives the 127/8 address of every emulated bus by its index,
    `cores` the processors of each core of this machine, where processes are to be placed on them; `records`: there is a
    recorder where the file does not say.
    """
    context = Context(search_beside([Path(path)], search, configs))
    source, problems = read_source(Path(path))
    context.problems += problems
    system = None
    if source is not None:
        system = _load(context, source, boards, sets, name, bus_address, cores, records)
    unique = tuple(dict.fromkeys(context.problems))
    errors = tuple(problem for problem in unique if problem.severity == ERROR)
    warnings = tuple(problem for problem in unique if problem.severity == WARNING)
    return Loaded(None if errors else system, warnings, errors)


def _load(
    context: Context,
    source: SourceFile,
    boards: str | None,
    sets: Mapping[str, str] | Sequence[str],
    name: str | None,
    bus_address: Callable[[int], str] | None,
    cores: Sequence[Core],
    records: bool,
) -> document.SystemConfig | None:
    if _is_old_console(source):
        text = "this is a console file from before dVRK 2.4, which is not read"
        allowed = (f'a system file with "$id": "{_SYSTEM_ID}" and "$version": "1"; '
                   f"trocar convert {source.path} makes one of it")
        context.problems.append(FileProblem(str(source.path), 1, "$id", "", text, allowed))
        return None
    source, problems = apply_overrides(by_name(context, source), sets)
    context.problems += problems
    content, problems = validate(SystemFile, source)
    context.problems += problems
    options = _options(context, source)
    if content is None or options is None:
        return None
    context.search = _with_settings(context, source, content)
    context.calibration_mode = options.calibration_mode
    if options.calibration_mode:
        context.notes.append("calibration mode: potentiometers are not compared with encoders")
    warn_of_components(context, source, content.component_manager)
    _check_names(context, source, content)
    _check_accounts(context, source, options)
    emulated = (boards or options.boards) == "emulated"
    if boards not in (None, "real", "emulated"):
        context.problems.append(FileProblem("--boards", 0, "", str(boards), "no such boards", "real or emulated"))
    if options.clock in _SIMULATED and content.IOs and not emulated:
        context.error(source, (SECTION, "clock"), "real boards don't wait", "wall, or emulated boards (--boards)")
    buses = load_buses(context, source, content, emulated=emulated)
    add_devices(context, source, content, buses)
    arms = []
    for index, keys in enumerate(content.arms):
        arm = load_arm(context, source, index, keys, buses, options)
        if arm is not None:
            arms.append(_with_period(arm, options))
    carts = load_carts(context, source, content, buses, options, emulated)
    check_buses(context, buses)
    third_parties = load_third_parties(context, source, content)
    if options.clock in _SIMULATED and third_parties:
        text = f"{', '.join(row.name for row in third_parties)}: a third-party program does not wait for us"
        context.error(source, (SECTION, "clock"), text, "wall")
    running = [loaded.arm.name for loaded in arms if loaded.starts] + [row.name for row in third_parties if row.type]
    operation = load_consoles(context, source, content, buses, running, carts)
    operation.third_parties = third_parties
    operation.focuses = load_focus(context, source, content, buses, operation.names)
    system = _assemble(context, source, list(buses.values()), arms, carts, operation, options, emulated, name,
                       bus_address, cores, records)
    system = dataclasses.replace(system, audio_volume=content.settings.audio_volume) if system is not None else None
    return with_setup_joints(context, source, content, system)


def _is_old_console(source: SourceFile) -> bool:
    return "$id" not in source.data and bool(_OLD_KEYS & set(source.data))


def _options(context: Context, source: SourceFile) -> TrocarSection | None:
    if not source.has((SECTION,)):
        return TrocarSection()
    options, problems = validate(TrocarSection, source, (SECTION,), unknown=ERROR)
    context.problems += problems
    return options


def _check_accounts(context: Context, source: SourceFile, options: TrocarSection) -> None:
    """Who else may attach must be known to this machine, or shared memory could not be given to them."""
    groups, users = ("group", options.group, grp.getgrnam), ("service_user", options.service_user, pwd.getpwnam)
    for key, name, find in (groups, users):
        what = key.removeprefix("service_")
        try:
            if name:
                find(name)
        except KeyError:
            context.error(source, (SECTION, key), f"this machine has no such {what}", f"a {what} of this machine")


def _with_settings(context: Context, source: SourceFile, content: SystemFile) -> SearchPath:
    """settings.path comes after the folder of the system file, and is meant relative to it or to the working folder."""
    folders = context.search.folders
    beside = source.path.parent
    more: list[Path] = []
    for index, text in enumerate(content.settings.path):
        given = expanded(text)
        hits = [folder for folder in (given, beside / given) if is_folder(folder)]
        if not hits:
            context.warning(source, ("settings", "path", index), "no such folder", "a folder")
        more += hits
    at = 2 if len(folders) > 1 and folders[1].resolve() == beside.resolve() else 1
    return search_path((*folders[:at], *more, *folders[at:]))


def _check_names(context: Context, source: SourceFile, content: SystemFile) -> None:
    """Every instance needs a name of its own: it names its process, its topics and its shared memory."""
    seen: dict[str, str] = dict.fromkeys(sorted(RESERVED), "a process of Trocar")
    if any(row.simulation == KINEMATIC for row in content.arms):
        seen[KINEMATIC_IO] = "the process that plays KINEMATIC arms"
    names: list[tuple[str, list[str]]] = [
        ("IOs", [row.name for row in content.IOs]),
        ("arms", [row.name for row in content.arms]),
        ("consoles", [row.name for row in content.consoles]),
    ]
    for kind, name, index in ((kind, name, index) for kind, row in names for index, name in enumerate(row)):
        if name in seen:
            text = f"this name is taken by {seen[name]}"
            context.error(source, (kind, index, "name"), text, "a name of its own for every IO, arm and console")
        seen[name] = f"{kind}[{index}]"
    robots: dict[tuple[str, str], str] = {}
    for index, arm in enumerate(content.arms):
        robot = (arm.IO, arm.name_on_IO or arm.name)
        if arm.simulation == KINEMATIC:  # nothing of it is on a bus
            continue
        if arm.IO and robot in robots:
            key = ("arms", index, "name_on_IO" if arm.name_on_IO else "name")
            context.error(source, key, f"{robots[robot]} uses this robot already", "a robot of its own for every arm")
        robots.setdefault(robot, arm.name)


def _with_period(loaded: LoadedArm, options: TrocarSection) -> LoadedArm:
    own = options.processes.get(loaded.arm.name)
    period = (own.period_s if own else None) or options.arm.period_s or loaded.arm.period_s
    return dataclasses.replace(loaded, arm=dataclasses.replace(loaded.arm, period_s=period))


def _assemble(
    context: Context,
    source: SourceFile,
    buses: list[BusFiles],
    arms: list[LoadedArm],
    carts: tuple[document.Cart, ...],
    operation: Operation,
    options: TrocarSection,
    emulated: bool,
    name: str | None,
    bus_address: Callable[[int], str] | None,
    cores: Sequence[Core],
    records: bool,
) -> document.SystemConfig | None:
    system_name = name or re.sub(r"[^A-Za-z0-9_-]", "_", source.path.stem)[:40]
    if not _NAME.match(system_name):
        text = "not a name for a system"
        context.problems.append(FileProblem("--system", 0, "", system_name, text,
                                            "letters, digits, _ and -, at most 40"))
        return None
    started = [loaded for loaded in arms if loaded.starts]
    real = [loaded for loaded in arms if not loaded.is_kinematic]
    for bus in (bus for bus in buses if not bus.has_boards):
        context.notes.append(f"not started: {bus.keys.name} (no file says what is on it)")
    used = [bus for bus in buses if bus.has_boards]
    emulation = None
    if emulated:
        address = bus_address or default_addresses(system_name)
        emulation = build_emulation(context, source, buses, real, options.emulation, address)
    ports = ports_of(emulation.buses) if emulation else {}
    ios = with_brakes([_io(bus, started, ports, options) for bus in used], carts)
    kinematic = _kinematic([loaded for loaded in arms if loaded.is_kinematic], options)
    if kinematic and options.io.tasks:
        names = ", ".join(robot.name for robot in kinematic[0].robots)
        context.notes.append(f"in-cycle tasks need boards: none runs for {names}")
    if emulation:
        every = tuple(_io(bus, real, ports, options) for bus in used)
        bodies = tuple(loaded.arm for loaded in real)
        if every != ios or kinematic or any(arm != loaded.commanded for arm, loaded in zip(bodies, real, strict=True)):
            emulation = dataclasses.replace(emulation, ios=every, arms=bodies)
    arm_rows = with_base_frames([loaded.commanded for loaded in started], carts)
    ios = with_tasks(context, source, ios, options.io.tasks) + kinematic
    system = document.SystemConfig(
        name=system_name,
        source=str(source.path),
        clock=options.clock or _usual_clock(context, ios, carts, emulated, operation.third_parties),
        ios=ios,
        arms=arm_rows,
        emulation=emulation,
        processes=(),
        carts=carts,
        consoles=tuple(with_period(row, options) for row in operation.consoles),
        teleop_psms=tuple(dataclasses.replace(with_period(row, options), wrench_timeout_s=options.arm.effort_timeout_s)
                          for row in operation.teleop_psms),
        teleop_ecms=tuple(with_period(row, options) for row in operation.teleop_ecms),
        third_parties=operation.third_parties,
        focuses=operation.focuses,
        users=load_user_processes(context, source, options, [arm.name for arm in arm_rows if arm.derived],
                                  [row.name for row in operation.third_parties]),
        ros=_ros(context, options.ros),
        socket=load_socket(context, source, options.socket),
        foxglove=load_foxglove(context, source, options.foxglove),
        gui=load_gui(context, source, options.gui),
        recorder=_recorder(options.recorder, records),
        supervisor_lost_s=options.supervisor_lost_s,
        group=options.group,
        service_user=options.service_user,
        logs=document.Logs(round(options.logs.size_mb * 1e6), options.logs.days * 86400.0, options.logs.keep),
        notes=tuple(dict.fromkeys(context.notes)),
    )
    places = placement(system, options, cores)
    return dataclasses.replace(system, processes=build_processes(context, source, system, options, places),
                               cpus=places.others)


def _ros(context: Context, options: RosOptions | None) -> document.RosBridge | None:
    if options is None:
        return None
    here = options.interface == "lo" or options.interface.startswith("127.")
    may_power = here if options.may_power is None else options.may_power
    if not here:
        what = "see, command, power and home" if may_power else "see and command"
        context.notes.append(f"ros: whoever is on the network of {options.interface} may {what} the robot")
    return document.RosBridge(options.domain, options.interface, options.period_s, options.namespace, may_power,
                              options.pid, options.io, options.tf, options.stats)


def _recorder(keys: RecorderKeys, usually: bool) -> document.Recorder | None:
    if not (usually if keys.on is None else keys.on):
        return None
    folder = str(expanded(keys.folder).absolute()) if keys.folder else ""
    return document.Recorder(folder, keys.rate_hz, keys.minutes, keys.size_mb, keys.compression, keys.faults)


def _usual_clock(context: Context, ios: tuple[document.IoConfig, ...], carts: tuple[document.Cart, ...], emulated: bool,
                 third_parties: tuple[document.ThirdParty, ...]) -> str:
    """The clock where none is stated: what is not real waits for a busy machine. Users' processes alone wait for none.
    """
    if not emulated and (any(io.port for io in ios) or any(cart.simulation == "NONE" for cart in carts)):
        return document.WALL
    if not emulated and not ios and not carts:
        return document.WALL
    if third_parties:
        names = ", ".join(row.name for row in third_parties)
        context.notes.append(f"clock: wall, because third-party programs do not wait for simulated time: {names}")
        return document.WALL
    return document.PACED


def _io(bus: BusFiles, arms: list[LoadedArm], ports: Mapping[str, str], options: TrocarSection) -> document.IoConfig:
    """The bus with everything in its files, robots of these arms first, and the joint controllers of these arms."""
    keys, io_options = bus.keys, options.io
    own = options.processes.get(keys.name)
    mine = sorted((loaded for loaded in arms if loaded.arm.io == keys.name), key=lambda loaded: not loaded.starts)
    robots = {loaded.robot.name: loaded.robot for loaded in mine}
    for path, index, robot in bus.robots():
        table = bus.tables.get((path, index), "")
        robots.setdefault(robot.name, convert.robot(robot, str(path), table))
    files = [file.content for file in bus.opened()]
    return document.IoConfig(
        name=keys.name,
        port=ports.get(keys.name, keys.port),
        protocol=PROTOCOLS[keys.protocol],
        period_s=(own.period_s if own else None) or io_options.period_s or keys.period,
        watchdog_s=watchdog_s(keys),
        calibration_mode=options.calibration_mode,
        close_all_relays=keys.close_all_relays,
        robots=tuple(robots.values()),
        pids=tuple(loaded.pid for loaded in mine),
        digital_inputs=tuple(convert.digital_input(row) for file in files for row in file.digital_inputs),
        instrument_readers=tuple(convert.instrument_reader(row) for file in files for row in file.dallas_chips),
        digital_outputs=tuple(convert.digital_output(row, robots) for file in files
                              for row in file.digital_outputs),
        **convert.options(io_options, document.IoConfig),
    )


def _kinematic(arms: list[LoadedArm], options: TrocarSection) -> tuple[document.IoConfig, ...]:
    """The process that plays the robots of KINEMATIC arms, where there are any; the shortest `PID_period` holds."""
    if not arms:
        return ()
    io_options, own = options.io, options.processes.get(KINEMATIC_IO)
    asked = min((loaded.pid_period_s for loaded in arms if loaded.pid_period_s > 0.0), default=PERIOD_S)
    return (document.IoConfig(
        name=KINEMATIC_IO,
        port="",
        protocol="",
        period_s=(own.period_s if own else None) or io_options.period_s or asked,
        watchdog_s=0.0,
        close_all_relays=False,
        robots=tuple(loaded.robot for loaded in arms),
        pids=tuple(loaded.pid for loaded in arms if loaded.starts),
        digital_inputs=(),
        **convert.options(io_options, document.IoConfig),
    ),)
