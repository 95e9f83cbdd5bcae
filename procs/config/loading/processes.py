"""The processes of a system, one row per instance in start order, and their placement on cores.

Each bus gets a core of its own, processes that move robots share others, and the rest uses none of these. This applies
only with real time, real boards, and at least four cores; a `cpu` in a file takes precedence. The first cores are for
the rest, because interrupts and other programs usually run there.
"""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

from trocar.procs.config.loading.buses import SystemFiles
from trocar.procs.config.loading.overrides import PROCESSES, SECTION
from trocar.procs.config.models.trocar_section import ProcessKeys, TrocarSection
from trocar.procs.config.read.problem import KeyPath
from trocar.procs.document import system as document
from trocar.procs.document.process import ELSEWHERE, ON_DEMAND
from trocar.procs.tables.manifest import PROCS, ROBOTS, Proc, ProcessInstance, proc

HIGHEST: Final = 98
ABOVE: Final = 5
_DECLARED: Final = {"module", "topics", "commands", "properties", "host"}  # of a user's process
LEAST: Final = 4
Core = tuple[int, ...]
"""Numbers of the processors of one core (two with hyper-threading)."""


@dataclass(frozen=True, slots=True)
class Placement:
    """Processors for ios, other processes that move robots, and the rest, by number; empty: any."""

    ios: Mapping[str, Core] = field(default_factory=dict)
    robots: tuple[int, ...] = ()
    others: tuple[int, ...] = ()

    def of(self, kind: Proc, name: str) -> tuple[int, ...]:
        """The processors of an instance."""
        return self.ios.get(name) or (self.robots if kind.priority in ROBOTS else self.others)


def placed(cores: Sequence[Core], ios: Mapping[str, int | None]) -> Placement:
    """The placement on these cores; none with fewer than LEAST. `ios`: buses, with processors given in files."""
    if len(cores) < LEAST or not ios:
        return Placement()
    taken = {cpu for cpu in ios.values() if cpu is not None}
    free = [core for core in cores if not taken & set(core)]
    unplaced = [name for name, cpu in ios.items() if cpu is None]
    own = free[max(len(free) - len(unplaced), 2) :]  # leaves at least two: for robots, and for the others
    if len(free) < 2 or len(own) < len(unplaced):
        return Placement()  # more buses than cores
    rest = free[: len(free) - len(own)]
    count = max(1, len(rest) // 3)
    return Placement({name: core[:1] for name, core in zip(unplaced, own, strict=True)}, _all(rest[count:]),
                     _all(rest[:count]))


def _all(cores: Sequence[Core]) -> tuple[int, ...]:
    return tuple(sorted(cpu for core in cores for cpu in core))


def build_processes(system: SystemFiles, made: document.SystemConfig,
                    places: Placement) -> tuple[document.Process, ...]:
    """All instances of all kinds, see `trocar.procs.tables.manifest`; `places`: the result of `placement`.

    Third-party programs are included: they are started elsewhere, but have places in the system.
    """
    found = [(kind, row) for kind in PROCS for row in kind.instances(made)]
    known = dict.fromkeys(row.name for _, row in found)
    users = {name for row in made.users for name in (row.name, row.host) if name}
    for name in users & {row.name for kind, row in found if not kind.declared}:
        system.error((*PROCESSES, name), "this name is taken by a process of Trocar", "a unique name")
    for name in system.options.processes:
        if name not in known:
            system.unlisted((*PROCESSES, name), "no process of this name is started", known)
    hosts = {row.name: row.host for row in made.users}
    rows = [_with_options(_usual(system, kind, row, hosts.get(row.name, ""), places), system.own(row.name))
            for kind, row in found]
    waited = known.keys() - {row.name for row in rows if row.start == ON_DEMAND}  # no process waits for one on demand
    given = tuple(dataclasses.replace(row, after=tuple(name for name in dict.fromkeys(row.after) if name in waited))
                  for row in rows)
    _check_demand(system, given)
    _check_cpus(system)
    return given


def _usual(system: SystemFiles, kind: Proc, row: ProcessInstance, host: str, places: Placement) -> document.Process:
    """A process with the values of its kind and section."""
    priority, cpu = _scheduled(kind.priority, system.options)
    return document.Process(row.name, kind.kind, row.period_s or kind.period_s, tuple(row.after), priority=priority,
                            cpus=places.of(kind, row.name) if cpu is None else (cpu,), start=row.start or kind.start,
                            host=host, listen=row.listen)


def _check_cpus(system: SystemFiles) -> None:
    """Warn of processors that this machine does not have: such a process may run on any."""
    options, count = system.options, os.cpu_count() or 0
    given: list[tuple[KeyPath, int | None]] = [((SECTION, name, "cpu"), section.cpu) for name, section in (
        ("emulation", options.emulation), ("io", options.io), ("arm", options.arm))]
    given += [((*PROCESSES, name, "cpu"), row.cpu) for name, row in options.processes.items()]
    for key, cpu in given:
        if cpu is not None and cpu >= count > 0:
            system.warning(key, f"this machine has no such processor: {count} in all", f"0 to {count - 1}")


def _check_demand(system: SystemFiles, rows: tuple[document.Process, ...]) -> None:
    """Check start and listen: processes that drive a robot run always and do not listen; addresses are unique."""
    taken: dict[str, str] = {}
    for row in rows:
        key = (*PROCESSES, row.name)
        if proc(row.kind).realtime and row.start == ON_DEMAND:
            system.error((*key, "start"), "it drives a robot, and always runs", "always")
        if row.listen and (proc(row.kind).realtime or row.start == ELSEWHERE):
            system.error((*key, "listen"), "it accepts no connections", "no address")
        if row.start == ELSEWHERE and system.own(row.name).start:
            system.error((*key, "start"), "it is started outside this system", "a module, if the system is to start it")
        for address in row.listen:
            if address in taken:
                system.error((*key, "listen"), f"{taken[address]} listens at {address}", "an unused one")
            taken[address] = row.name


def placement(system: SystemFiles, made: document.SystemConfig, cores: Sequence[Core]) -> Placement:
    """The placement of processes without a `cpu` in files: on any core, unless boards and time are real."""
    if system.options.placement == "none" or made.emulation is not None or made.clock != document.WALL:
        return Placement()
    own = {io.name: system.own(io.name).cpu for io in made.ios if io.port}
    return placed(cores, {name: system.options.io.cpu if cpu is None else cpu for name, cpu in own.items()})


def _scheduled(priority: str, options: TrocarSection) -> tuple[int, int | None]:
    """(priority, core) for a priority in the manifest."""
    arm = options.arm
    if priority == "least":  # above other programs on the machine, which must not stall it
        return min(arm.priority, 1), None
    if priority == "above arms":
        return min(arm.priority + ABOVE, HIGHEST) if arm.priority else 0, arm.cpu
    of_section = {"emulation": (options.emulation.priority, options.emulation.cpu),
                  "io": (options.io.priority, options.io.cpu), "arm": (arm.priority, arm.cpu)}
    return of_section.get(priority, (0, None))


def _with_options(row: document.Process, own: ProcessKeys) -> document.Process:
    given = own.model_dump(exclude=_DECLARED, exclude_none=True, exclude_defaults=True)
    if (cpu := given.pop("cpu", None)) is not None:
        given["cpus"] = (cpu,)
    if "start" not in given and (row.listen or "listen" in given) and not proc(row.kind).realtime:
        given["start"] = ON_DEMAND  # the first client starts it
    if row.start == ELSEWHERE:
        given.pop("start", None)
    return dataclasses.replace(row, **given)
