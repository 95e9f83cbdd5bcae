"""`trocar attach`: a look into a system, live or dead, on the whole terminal; q leaves."""

from __future__ import annotations

import sys
from typing import Annotated

import typer

from trocar.tools.monitor.overview import identity_of
from trocar.tools.output.errors import Misuse, Problem
from trocar.tools.output.printing import emit
from trocar.tools.output.terminal import redraws
from trocar.tools.systems.find import chosen_system, left_over
from trocar.tools.verbs.options import JsonOption, SystemOption


def attach(
    once: Annotated[bool, typer.Option("--once", help="Print everything once as text, and exit.")] = False,
    as_json: JsonOption = False,
    system: SystemOption = None,
) -> int:
    """Open the full-screen live monitor: processes, topics, values, events, arms and commands.

    The monitor only reads. It can be opened at any time, and needs no configuration. Keys: 1 to 6 or Tab select a page,
    / searches, f freezes, q quits. If a system has crashed, the monitor shows the data left in shared memory, and marks
    the processes as dead. With --json, the output is one object. Without a terminal, the monitor prints everything once
    as text.

    Example: trocar attach

    Example: trocar attach --json
    """
    if once and as_json:
        raise Misuse("cannot combine --once and --json: --json implies --once")
    name = _meant(system)
    if not identity_of(name):
        raise Problem(f"system {name} is not in shared memory; trocar up starts one")
    if as_json:
        from trocar.tools.monitor.snapshot import document

        emit(document(name))
    elif once or not all(map(redraws, (sys.stdin, sys.stdout, sys.stderr))):  # it draws on the last
        from trocar.tools.monitor.snapshot import print_once

        print_once(name)
    else:
        from trocar.tools.monitor.app import InspectorApp

        InspectorApp(name).run()
    return 0


def _meant(system: str | None) -> str:
    """The system meant: the named one, the only one up, or the only one that a dead supervisor left."""
    try:
        return chosen_system(system)
    except Problem:
        dead = left_over() if system is None else []
        if len(dead) != 1:
            raise
        return dead[0]
