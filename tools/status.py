"""`trocar status`: the processes of a system."""

from __future__ import annotations

import dataclasses

from procs.rights import lacking
from tools.options import JsonOption, SystemOption
from tools.printing import emit, table
from tools.processes import COLUMNS, RIGHT, cells, lives, remarks
from tools.systems import chosen_system


def status(as_json: JsonOption = False, system: SystemOption = None) -> int:
    """Show every process: state, rate, missed deadlines, restarts, why it last ended. Exit code 1: one is in trouble.

    Example: trocar status --json
    """
    name = chosen_system(system)
    found = lives(name)
    if as_json:
        emit({"system": name, "processes": [dataclasses.asdict(life) for life in found]})
    else:
        table(f"system {name}", COLUMNS, [cells(life) for life in found], RIGHT)
        for life in found:
            if remarks(life):
                print(f" {life.name}: {remarks(life)}")
        if rights := lacking({life.name: life.scheduling for life in found}):
            print(rights)
    return 1 if any(life.trouble for life in found) else 0
