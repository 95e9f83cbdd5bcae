"""Loads a system file, with all files that it names, into one document, or into a list of all problems."""

from __future__ import annotations

import dataclasses
import grp
import pwd
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from trocar.procs.config.loading import convert
from trocar.procs.config.loading.arms import LoadedArm, load_arms
from trocar.procs.config.loading.bridges import (
    Free,
    at_free_defaults,
    load_foxglove,
    load_gui,
    load_recorder,
    load_ros,
    load_socket,
)
from trocar.procs.config.loading.buses import BusFiles, SystemFiles, check_buses, load_buses, watchdog_s
from trocar.procs.config.loading.carts import load_carts, with_base_frames, with_brakes
from trocar.procs.config.loading.chains import KINEMATIC, KINEMATIC_IO
from trocar.procs.config.loading.consoles import load_consoles
from trocar.procs.config.loading.context import NO_FOLDER, Context, Opened
from trocar.procs.config.loading.emulated import build_emulation, default_addresses, ports_of, setup_joints_of
from trocar.procs.config.loading.overrides import SECTION, apply_overrides, with_named_processes
from trocar.procs.config.loading.processes import Core, build_processes, placement
from trocar.procs.config.loading.third_parties import (
    check_components,
    load_third_parties,
    programs_of,
    warn_of_components,
)
from trocar.procs.config.loading.user_code import load_user_processes, with_tasks
from trocar.procs.config.loading.walls import with_walls
from trocar.procs.config.models.system_file import (
    PERIOD_S,
    PROTOCOLS,
    RESERVED,
    ArmKeys,
    ConsoleKeys,
    IoKeys,
    SystemFile,
)
from trocar.procs.config.models.trocar_section import TrocarSection
from trocar.procs.config.read.problem import ERROR, WARNING, FileProblem
from trocar.procs.config.read.search import SearchPath, expanded, search_path
from trocar.procs.config.read.sections import is_name
from trocar.procs.config.read.validate import validate
from trocar.procs.document import system as document
from trocar.procs.machine.extras import missing
from trocar.procs.machine.paths import PROJECT_CONFIGS, is_folder

_SIMULATED = (document.PACED, document.LOCKSTEP)
_OLD_KEYS = {"arms", "console", "io", "psm-teleops", "ecm-teleop", "suj"}
_SYSTEM_ID = "dvrk-system.schema.json"


@dataclass(frozen=True, slots=True)
class Loaded:
    """A loaded system; no document if there are errors."""

    system: document.SystemConfig | None
    warnings: tuple[FileProblem, ...]
    errors: tuple[FileProblem, ...]


@dataclass(frozen=True, slots=True)
class Machine:
    """What a system gets from this machine.

    `bus_address`: the 127/8 address of each emulated bus by index; `free`: ports and ROS domains, for those that the
    file does not choose; `cores`: the processors of each core, to place processes on them.
    """

    bus_address: Callable[[int], str] | None = None
    free: Free | None = None
    cores: Sequence[Core] = ()


def load_system(
    path: Path | str, *, search: Sequence[Path] = (), boards: str | None = None,
    sets: Sequence[str] = (), name: str | None = None, configs: Path = PROJECT_CONFIGS,
    machine: Machine | None = None, records: bool = False,
) -> Loaded:
    """Load a system file (JSON or YAML) and all files it names; nothing is written.

    `search`: folders of `--path`; `boards`: "emulated", or None for the file's setting; `sets`: the `--set` options;
    `name`: the system's name (default: the file's); `records`: whether there is a recorder by default.
    """
    context, machine = Context.beside([Path(path)], search, configs), machine or Machine()
    read = context.read(Path(path))
    system = _opened(read, boards, sets, machine.free) if read is not None else None
    made = _load(system, name, machine, records) if system is not None else None
    unique = tuple(dict.fromkeys(context.problems))
    errors = tuple(problem for problem in unique if problem.severity == ERROR)
    warnings = tuple(problem for problem in unique if problem.severity == WARNING)
    return Loaded(None if errors else made, warnings, errors)


def _opened(
    read: Opened[None], boards: str | None, sets: Sequence[str], free: Free | None,
) -> SystemFiles | None:
    """The system file with its `trocar:` section; None if errors prevent loading."""
    context = read.context
    if "$id" not in read.source.data and _OLD_KEYS & set(read.source.data):
        text = "this is a console file from before dVRK 2.4, which is not read"
        allowed = (f'a system file with "$id": "{_SYSTEM_ID}" and "$version": "1"; '
                   f"trocar convert {read.source.path} makes one of it")
        context.problems.append(FileProblem(str(read.source.path), 1, "$id", "", text, allowed))
        return None
    source, problems = apply_overrides(with_named_processes(read), sets)
    context.problems += problems
    content, problems = validate(SystemFile, source, in_part=True)
    context.problems += problems
    options: TrocarSection | None = TrocarSection()
    if source.has((SECTION,)):
        options, problems = validate(TrocarSection, source, (SECTION,), unknown=ERROR, in_part=True)
        context.problems += problems
    if content is None or options is None:
        return None
    if free is not None:
        options = at_free_defaults(context, content, options, free)
    system = SystemFiles(context, source, content, options, (boards or options.boards) == "emulated")
    context.search = _with_settings(system)
    context.rehearsed = "" if system.emulated else ERROR
    context.calibration_mode = options.calibration_mode
    if options.calibration_mode:
        system.note("calibration mode: potentiometers are not compared with encoders")
    warn_of_components(system)
    _check_names(system)
    _check_accounts(system)
    if boards not in (None, "real", "emulated"):
        context.problems.append(FileProblem("--boards", 0, "", str(boards), "no such boards", "real or emulated"))
    if options.clock in _SIMULATED and content.IOs and not system.emulated:
        system.error((SECTION, "clock"), "real boards don't wait", "wall, or emulated boards (--boards)")
    return system


def _load(system: SystemFiles, name: str | None, machine: Machine, records: bool) -> document.SystemConfig | None:
    """The document of all files that the system names, loaded in the order of their references."""
    options = system.options
    load_buses(system)
    arms, carts = load_arms(system), load_carts(system)
    check_buses(system)
    check_components(system)
    third_parties = load_third_parties(system)
    if options.clock in _SIMULATED and third_parties:
        text = f"{', '.join(row.name for row in third_parties)}: a third-party program does not wait for us"
        system.error("trocar.clock", text, "wall")
    rows = with_walls(system, with_base_frames([loaded.commanded for loaded in arms if loaded.starts], carts))
    operation = load_consoles(system, [row.name for row in rows], carts, third_parties)
    system_name = name or re.sub(r"[^A-Za-z0-9_-]", "_", system.source.path.stem)[:40]
    if not is_name(system_name):
        system.context.problems.append(FileProblem("--system", 0, "", system_name, "not a name for a system",
                                                   "letters, digits, _ and -, at most 40"))
        return None
    ios, emulation = _with_boards(system, arms, carts, machine.bus_address or default_addresses(system_name))
    if any(row.jerk_time_s for row in rows) and (lacks := missing("ruckig", "a jerk limit")):
        system.error("trocar.arm", f"{lacks}; to start without it: --set arm.jerk_time_s=0")
    users = load_user_processes(system, [arm.name for arm in rows if arm.derived], [row.name for row in third_parties])
    made = convert.by_name(
        document.SystemConfig, operation, options, system.content.settings,
        name=system_name, source=str(system.source.path),
        clock=options.clock or _usual_clock(system, ios, carts, third_parties), ios=ios, arms=rows, emulation=emulation,
        processes=(), carts=carts, third_parties=third_parties, users=(*users, *programs_of(system, third_parties)),
        ros=load_ros(system), socket=load_socket(system), foxglove=load_foxglove(system), gui=load_gui(system),
        recorder=load_recorder(system, records),
        logs=convert.by_name(document.Logs, options.logs, max_bytes=round(options.logs.size_mb * 1e6),
                             max_age_s=options.logs.days * 86400.0),
        notes=tuple(dict.fromkeys(system.context.notes)))
    places = placement(system, made, machine.cores)
    processes = build_processes(system, made, places)
    if emulation is not None:  # the file of setup joints is read last
        joints = setup_joints_of(system, emulation, emulation.ios or ios)
        emulation = dataclasses.replace(emulation, setup_joints=joints)
    return dataclasses.replace(made, emulation=emulation, processes=processes, cpus=places.others)


def _check_accounts(system: SystemFiles) -> None:
    """Check that the configured group and user exist on this machine, so that they can be given access."""
    options = system.options
    groups, users = ("group", options.group, grp.getgrnam), ("service_user", options.service_user, pwd.getpwnam)
    for key, name, find in (groups, users):
        what = key.removeprefix("service_")
        try:
            if name:
                find(name)
        except KeyError:
            system.error((SECTION, key), f"this machine has no such {what}", f"a {what} of this machine")


def _with_settings(system: SystemFiles) -> SearchPath:
    """The search path with settings.path, after the system file's folder; relative to that or the working folder."""
    folders = system.context.search.folders
    beside = system.source.path.parent
    more: list[Path] = []
    for index, text in enumerate(system.content.settings.path):
        given = expanded(text)
        hits = [folder for folder in (given, beside / given) if is_folder(folder)]
        if not hits:
            system.error(("settings", "path", index), *NO_FOLDER)
        more += hits
    at = 2 if len(folders) > 1 and folders[1].resolve() == beside.resolve() else 1
    return search_path((*folders[:at], *more, *folders[at:]))


def _check_names(system: SystemFiles) -> None:
    """Check that instances have unique names, which are used for processes, topics and shared memory."""
    content = system.content
    seen: dict[str, str] = dict.fromkeys(sorted(RESERVED), "a process of Trocar")
    if any(row.simulation == KINEMATIC for row in content.arms):
        seen[KINEMATIC_IO] = "the process that simulates KINEMATIC arms"
    for kind in ("IOs", "arms", "consoles"):
        rows: Sequence[IoKeys | ArmKeys | ConsoleKeys] = getattr(content, kind)
        for index, row in enumerate(rows):
            if row.name in seen:
                system.error((kind, index, "name"), f"this name is taken by {seen[row.name]}",
                             "a unique name for every IO, arm and console")
            seen[row.name] = f"{kind}[{index}]"
    robots: dict[tuple[str, str], str] = {}
    for part in system.each("arms", content.arms):
        arm = part.content
        robot = (arm.IO, arm.name_on_IO or arm.name)
        if arm.simulation == KINEMATIC:  # not on a bus
            continue
        if arm.IO and robot in robots:
            part.error("name_on_IO" if arm.name_on_IO else "name", f"{robots[robot]} already uses this robot",
                       "a different robot for every arm")
        robots.setdefault(robot, arm.name)


def _with_boards(
    system: SystemFiles, arms: list[LoadedArm], carts: tuple[document.Cart, ...], address: Callable[[int], str]
) -> tuple[tuple[document.IoConfig, ...], document.EmulationConfig | None]:
    """The rows of `io` processes, for buses and KINEMATIC arms, and the emulation of boards, if any."""
    real = [loaded for loaded in arms if not loaded.is_kinematic]
    used = [bus for bus in system.buses.values() if bus.has_boards]
    for name in [name for name, bus in system.buses.items() if bus not in used]:
        system.note(f"not started: {name} (no file describes it)")
    emulation = build_emulation(system, real, address) if system.emulated else None
    ports = ports_of(emulation.buses) if emulation else {}
    every = tuple(_io(system, bus, real, ports) for bus in used)
    ios = with_brakes([_io(system, bus, [loaded for loaded in arms if loaded.starts], ports) for bus in used], carts)
    kinematic = _kinematic(system, [loaded for loaded in arms if loaded.is_kinematic])
    if emulation and (every != ios or kinematic or any(loaded.arm != loaded.commanded for loaded in real)):
        emulation = dataclasses.replace(emulation, ios=every, arms=tuple(loaded.arm for loaded in real))
    return with_tasks(system, ios) + kinematic, emulation


def _usual_clock(system: SystemFiles, ios: tuple[document.IoConfig, ...], carts: tuple[document.Cart, ...],
                 third_parties: tuple[document.ThirdParty, ...]) -> str:
    """The default clock: real time with real devices, third-party programs, or no robot at all; otherwise paced."""
    if not system.emulated and (any(io.port for io in ios) or any(cart.simulation == "NONE" for cart in carts)):
        return document.WALL
    if not system.emulated and not ios and not carts:
        return document.WALL
    if third_parties:
        names = ", ".join(row.name for row in third_parties)
        system.note(f"clock: wall, because third-party programs do not wait for simulated time: {names}")
        return document.WALL
    return document.PACED


def _io(system: SystemFiles, bus: BusFiles, arms: list[LoadedArm], ports: Mapping[str, str]) -> document.IoConfig:
    """The io of a bus: contents of its files, robots of these arms first, with the arms' joint controllers."""
    keys, options = bus.keys, system.options
    mine = sorted((loaded for loaded in arms if loaded.arm.io == keys.name), key=lambda loaded: not loaded.starts)
    robots = {loaded.robot.name: loaded.robot for loaded in mine}
    for part in bus.robots():
        robots.setdefault(part.content.name, bus.robot(part))
    files = bus.contents()
    return convert.by_name(
        document.IoConfig, keys, options.io,
        port=ports.get(keys.name, keys.port),
        protocol=PROTOCOLS[keys.protocol],
        period_s=system.own(keys.name).period_s or options.io.period_s or keys.period,
        watchdog_s=watchdog_s(keys),
        calibration_mode=options.calibration_mode,
        robots=tuple(robots.values()),
        pids=tuple(loaded.pid for loaded in mine),
        digital_inputs=tuple(row for file in files for row in file.digital_inputs),
        instrument_readers=tuple(row for file in files for row in file.dallas_chips),
        digital_outputs=tuple(convert.digital_output(row, robots) for file in files for row in file.digital_outputs),
        tasks=(),  # see `with_tasks`
    )


def _kinematic(system: SystemFiles, arms: list[LoadedArm]) -> tuple[document.IoConfig, ...]:
    """The io of KINEMATIC arms, if there are any; its period is the shortest `PID_period`."""
    if not arms:
        return ()
    options = system.options.io
    if options.tasks:
        names = ", ".join(loaded.robot.name for loaded in arms)
        system.note(f"in-cycle tasks need boards: none runs for {names}")
    asked = min((loaded.pid_period_s for loaded in arms if loaded.pid_period_s > 0.0), default=PERIOD_S)
    return (convert.by_name(
        document.IoConfig, options, name=KINEMATIC_IO, port="", protocol="",
        period_s=system.own(KINEMATIC_IO).period_s or options.period_s or asked,
        watchdog_s=0.0, current_error_a=0.0, close_all_relays=False, robots=tuple(loaded.robot for loaded in arms),
        pids=tuple(loaded.pid for loaded in arms if loaded.starts), digital_inputs=(), tasks=()),)
