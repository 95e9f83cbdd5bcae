"""`trocar dump [FILE]`: what shared memory holds of a system, as a recording."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Annotated

import typer

from trocar.procs.recordings.names import DUMP
from trocar.tools.output.printing import answer, note, progress
from trocar.tools.systems.dumping import dump as dumped
from trocar.tools.systems.dumping import dump_by_time
from trocar.tools.systems.find import chosen_system, is_up
from trocar.tools.verbs.options import JsonOption, SystemOption


def dump(
    file: Annotated[Path | None, typer.Argument(metavar="[FILE]", help="A new .mcap file; default: among the system's "
                                                "recordings, named after the time.")] = None,
    as_json: JsonOption = False,
    system: SystemOption = None,
) -> int:
    """Save all rings of a system at full rate: the last seconds of every state, all events and commands.

    This also works for a system that crashed, or whose processes hang; `up` and `down` do it by themselves before they
    clean up after a crashed system. Changes nothing in the system. Exit code 1: a part could not be read; the rest is
    in the file.

    Example: trocar dump before.mcap
    """
    name = chosen_system(system)
    with progress(f"reading {name}") as say:
        reason = "requested" if is_up(name) else "its supervisor crashed"
        found = dump_by_time(name, DUMP, reason, say) if file is None else dumped(name, file, reason, say)
    for problem in found.problems:
        note(problem)
    answer(dataclasses.asdict(found) | {"file": str(found.file)},
           f"{found.file}: {sum(found.records.values())} records of {len(found.records)} rings, "
           f"{found.bytes / 1e6:.1f} MB", as_json)
    return 1 if found.problems else 0
