"""The processes of a system: one row an instance, in the order in which they start."""

from __future__ import annotations

import dataclasses

from procs.lib import document
from procs.lib.config.context import Context
from procs.lib.config.source import Source
from procs.lib.config.trocar_section import TrocarSection

BOARDS = "boards"
RESERVED = frozenset({BOARDS, "supervisor", "system", "gui", "ros_bridge", "socket_bridge", "recorder"})


def build_processes(
    context: Context,
    source: Source,
    ios: tuple[document.Io, ...],
    arms: tuple[document.Arm, ...],
    carts: tuple[document.Cart, ...],
    emulation: document.Emulation | None,
    options: TrocarSection,
) -> tuple[document.Process, ...]:
    """Boards first, every io that has any after them, arms and carts after their io; single options last."""
    rows: list[document.Process] = []
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
    known = [row.name for row in rows]
    for name in options.processes:
        if name not in known:
            allowed = f"one of {', '.join(known)}"
            context.error(source, ("trocar", "processes", name), "no process of this name is started", allowed)
    return tuple(_with_options(row, options) for row in rows)


def _with_options(row: document.Process, options: TrocarSection) -> document.Process:
    own = options.processes.get(row.name)
    given = {name: value for name, value in own.model_dump().items() if value is not None} if own else {}
    return dataclasses.replace(row, **given)
