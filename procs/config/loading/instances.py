"""The processes of a system: one row an instance, in the order in which they start."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Final, TypeVar

from trocar.procs.config.loading.context import Context
from trocar.procs.config.loading.placement import Core, Placement, placed
from trocar.procs.config.models.trocar_section import TrocarSection
from trocar.procs.config.read.source import SourceFile
from trocar.procs.document import system as document
from trocar.procs.document.process import ELSEWHERE, ON_DEMAND
from trocar.procs.tables.manifest import PROCS, proc

HIGHEST: Final = 98
ABOVE: Final = 5
_DECLARED: Final = {"module", "topics", "commands", "properties", "host"}  # of a process of one's own


def build_processes(
    context: Context, source: SourceFile, system: document.SystemConfig, options: TrocarSection, places: Placement
) -> tuple[document.Process, ...]:
    """All instances of all kinds, see `trocar.procs.tables.manifest`; `places`: what `placement` says.

    third-party programs are listed, too: nobody here starts them, but they have places of their own.
    """
    found = [(kind, row) for kind in PROCS for row in kind.instances(system)]
    known = dict.fromkeys(row.name for _, row in found)
    users = {name for row in system.users for name in (row.name, row.host) if name}
    hosts = {row.name: row.host for row in system.users}
    for name in users & {row.name for kind, row in found if not kind.declared}:
        context.error(source, ("trocar", "processes", name), "this name is taken by a process of Trocar",
                      "a name of its own")
    for name in options.processes:
        if name not in known:
            allowed = f"one of {', '.join(known)}"
            context.error(source, ("trocar", "processes", name), "no process of this name is started", allowed)
    rows = []
    for kind, row in found:
        after = tuple(name for name in dict.fromkeys(row.after) if name in known)
        priority, cpu = _scheduled(kind.priority, options)
        rows.append(document.Process(row.name, kind.kind, row.period_s or kind.period_s, after, priority=priority,
                                     cpus=places.of(kind, row.name) if cpu is None else (cpu,),
                                     start=row.start or kind.start, host=hosts.get(row.name, ""), listen=row.listen))
    given = tuple(_with_options(row, options) for row in rows)
    waits = {row.name for row in given if row.start == ON_DEMAND}  # for somebody who wants it: nobody waits for it
    given = tuple(dataclasses.replace(row, after=tuple(name for name in row.after if name not in waits))
                  for row in given)
    _check_demand(context, source, given, options)
    return given


def _check_demand(context: Context, source: SourceFile, rows: tuple[document.Process, ...],
                  options: TrocarSection) -> None:
    """What drives a robot is always there, and takes no connections; an address is one process's."""
    taken: dict[str, str] = {}
    for row in rows:
        key = ("trocar", "processes", row.name)
        if proc(row.kind).realtime and row.start == ON_DEMAND:
            context.error(source, (*key, "start"), "it drives a robot, and is always there", "always")
        if row.listen and (proc(row.kind).realtime or row.start == ELSEWHERE):
            context.error(source, (*key, "listen"), "it takes no connections", "no address")
        if row.start == ELSEWHERE and (own := options.processes.get(row.name)) is not None and own.start:
            context.error(source, (*key, "start"), "nobody here starts it", "a module, if the system is to start it")
        for address in row.listen:
            if address in taken:
                context.error(source, (*key, "listen"), f"{taken[address]} listens at {address}", "one of its own")
            taken[address] = row.name


def placement(system: document.SystemConfig, options: TrocarSection, cores: Sequence[Core]) -> Placement:
    """Where processes run whose `cpu` nobody gives: nowhere in particular unless boards and time are real."""
    if options.placement == "none" or system.emulation is not None or system.clock != document.WALL:
        return Placement()
    own = {io.name: options.processes.get(io.name) for io in system.ios if io.port}
    return placed(cores, {name: options.io.cpu if row is None or row.cpu is None else row.cpu
                          for name, row in own.items()})


def _scheduled(priority: str, options: TrocarSection) -> tuple[int, int | None]:
    """(priority, core) as the manifest names it."""
    arm = options.arm
    if priority == "least":  # above the other programs of the machine, which must not hold it up
        return min(arm.priority, 1), None
    if priority == "above arms":
        return min(arm.priority + ABOVE, HIGHEST) if arm.priority else 0, arm.cpu
    of_section = {"emulation": (options.emulation.priority, options.emulation.cpu),
                  "io": (options.io.priority, options.io.cpu), "arm": (arm.priority, arm.cpu)}
    return of_section.get(priority, (0, None))


Row = TypeVar("Row", document.Console, document.TeleopPsmConfig, document.TeleopEcmConfig)


def with_period(row: Row, options: TrocarSection) -> Row:
    """The row with the period that `trocar.processes` gives it, if any."""
    own = options.processes.get(row.name)
    return dataclasses.replace(row, period_s=own.period_s) if own is not None and own.period_s else row


def _with_options(row: document.Process, options: TrocarSection) -> document.Process:
    own = options.processes.get(row.name)
    given = own.model_dump(exclude=_DECLARED, exclude_none=True, exclude_defaults=True) if own else {}
    if (cpu := given.pop("cpu", None)) is not None:
        given["cpus"] = (cpu,)
    if "start" not in given and (row.listen or "listen" in given) and not proc(row.kind).realtime:
        given["start"] = ON_DEMAND  # the first who connects starts it
    if row.start == ELSEWHERE:
        given.pop("start", None)
    return dataclasses.replace(row, **given)
