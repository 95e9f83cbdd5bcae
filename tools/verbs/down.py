"""`trocar down`: stop a system, and clear what dead ones have left in shared memory."""

from __future__ import annotations

from functools import partial
from typing import Annotated

import typer

from trocar.tools.output.printing import emit, progress, tell
from trocar.tools.systems.dumping import keep_left_over
from trocar.tools.systems.ending import STOP_S, stop_system
from trocar.tools.systems.find import all_up, chosen_system, left_over, those_up
from trocar.tools.verbs.options import JsonOption, SystemOption


def down(
    timeout: Annotated[float, typer.Option("--timeout", min=0.1, help="Seconds to wait until it is down.")] = STOP_S,
    as_json: JsonOption = False,
    system: SystemOption = None,
) -> int:
    """Stop a system: robots are powered off properly, then every process ends. Also cleans up after crashed systems.

    Exit code 0: no process of the system runs, and none of its shared memory remains. Exit code 1: something remains.

    Example: trocar down
    """
    cleared, stopped = {}, None
    for name in left_over(system):
        with progress(f"clearing {name}") as say:
            cleared[name] = stop_system(name, say, timeout, partial(keep_left_over, say=say))
    if not cleared or (all_up() if system is None else those_up([system])):
        stopped = chosen_system(system)
        with progress(f"stopping {stopped}") as say:
            left = stop_system(stopped, say, timeout, partial(keep_left_over, say=say))
        if left:
            cleared[stopped] = left
    if as_json:
        emit({"stopped": stopped, "cleared": cleared})
        return 0
    for name, count in cleared.items():
        tell(f"removed {count} shared-memory segments left by {name}")
    if stopped:
        tell(f"system {stopped} is down")
    return 0

