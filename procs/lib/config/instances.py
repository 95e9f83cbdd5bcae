"""The processes of a system: one row an instance, in the order in which they start."""

from __future__ import annotations

import dataclasses
from typing import Final, TypeVar

from procs.lib import document
from procs.lib.config.consoles import Operation
from procs.lib.config.context import Context
from procs.lib.config.source import Source
from procs.lib.config.trocar_section import TrocarSection

BOARDS = "boards"
EXTERNAL: Final = "external"
EXTERNAL_PERIOD_S: Final = 0.005
STARTED: Final = frozenset({"teleop", "console", "system"})  # those whose processes exist
SYSTEM_PERIOD_S: Final = 0.01
HIGHEST: Final = 98


def build_processes(
    context: Context,
    source: Source,
    ios: tuple[document.Io, ...],
    arms: tuple[document.Arm, ...],
    carts: tuple[document.Cart, ...],
    operation: Operation,
    emulation: document.Emulation | None,
    options: TrocarSection,
) -> tuple[document.Process, ...]:
    """Boards first, every io that has any after them, arms and carts after their io, then who operates them.

    Programs of somebody else are listed, too: nobody here starts them, but they have places of their own.
    """
    rows = [document.Process(row.name, EXTERNAL, EXTERNAL_PERIOD_S) for row in operation.externals]
    if emulation is not None:
        boards = options.emulation
        rows.append(document.Process(BOARDS, "boards", boards.period_s, priority=boards.priority, cpu=boards.cpu))
    for io in ios:
        before = (BOARDS,) if emulation is not None and io.port else ()
        rows.append(
            document.Process(io.name, "io", io.period_s, before, priority=options.io.priority, cpu=options.io.cpu)
        )
    for arm in arms:
        period = arm.period_s
        rows.append(
            document.Process(arm.name, "arm", period, (arm.io,), priority=options.arm.priority, cpu=options.arm.cpu)
        )
    for cart in carts:
        after = (cart.io,) if cart.io else ()
        rows.append(document.Process(cart.name, "suj", cart.period_s, after, priority=options.arm.priority,
                                     cpu=options.arm.cpu))
    for focus in operation.focuses:
        wired = dict.fromkeys((focus.io, *(pedal.io for pedal in focus.pedals)))
        rows.append(document.Process(focus.name, "focus", focus.period_s, tuple(wired), priority=_least(options)))
    rows += _operators(context, rows, operation, options)
    known = [row.name for row in rows]
    for name in options.processes:
        if name not in known:
            allowed = f"one of {', '.join(known)}"
            context.error(source, ("trocar", "processes", name), "no process of this name is started", allowed)
    return tuple(_with_options(row, options) for row in rows)


def _operators(
    context: Context, rows: list[document.Process], operation: Operation, options: TrocarSection
) -> list[document.Process]:
    """Tele-operations after their arms, consoles after those, the system after everything."""
    wanted: list[document.Process] = []
    for ecm in operation.teleop_ecms:
        wanted.append(document.Process(ecm.name, "teleop", ecm.period_s, (ecm.mtml, ecm.mtmr, ecm.ecm),
                                       priority=options.arm.priority, cpu=options.arm.cpu))
    for psm in operation.teleop_psms:
        wanted.append(document.Process(psm.name, "teleop", psm.period_s, (psm.mtm, psm.psm),
                                       priority=options.arm.priority, cpu=options.arm.cpu))
    for console in operation.consoles:
        after = tuple(dict.fromkeys((*console.teleops, *(one.io for one in console.operator_present))))
        # Above the arms: it takes little, and an operator who cannot be seen for 30 ms counts as gone.
        above = min(options.arm.priority + 5, HIGHEST) if options.arm.priority else 0
        wanted.append(document.Process(console.name, "console", console.period_s, after, priority=above,
                                       cpu=options.arm.cpu))
    if operation.consoles:
        after = tuple(row.name for row in (*rows, *wanted) if row.kind in ("arm", "suj", "console"))
        wanted.append(document.Process("system", "system", SYSTEM_PERIOD_S, after, priority=_least(options)))
    for row in wanted:
        if row.kind not in STARTED:
            context.notes.append(f"not started yet: {row.name if row.kind == row.name else f'{row.kind} {row.name}'}")
    started = [row for row in wanted if row.kind in STARTED]
    names = {row.name for row in (*rows, *started)}
    return [dataclasses.replace(row, after=tuple(name for name in row.after if name in names)) for row in started]


def _least(options: TrocarSection) -> int:
    """Below all that move robots, and above the other programs of the machine: those must not hold it up."""
    return min(options.arm.priority, 1)


Row = TypeVar("Row", document.Console, document.TeleopPsm, document.TeleopEcm)


def with_period(row: Row, options: TrocarSection) -> Row:
    """The row with the period that `trocar.processes` gives it, if any."""
    own = options.processes.get(row.name)
    return dataclasses.replace(row, period_s=own.period_s) if own is not None and own.period_s else row


def _with_options(row: document.Process, options: TrocarSection) -> document.Process:
    own = options.processes.get(row.name)
    given = {name: value for name, value in own.model_dump().items() if value is not None} if own else {}
    return dataclasses.replace(row, **given)
