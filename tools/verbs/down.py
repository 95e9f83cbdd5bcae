"""`trocar down`: stop a system, and clear what dead ones have left in shared memory."""

from __future__ import annotations

from functools import partial
from typing import Annotated

import typer

from trocar.shm.system.directory import systems
from trocar.tools.output.printing import emit, progress, tell
from trocar.tools.systems.dumping import keep_left_over
from trocar.tools.systems.ending import STOP_S, stop_system
from trocar.tools.systems.find import chosen_system, left_over, those_up
from trocar.tools.verbs.options import JsonOption, SystemOption


def down(
    timeout: Annotated[float, typer.Option("--timeout", min=0.1, help="Seconds to wait until it is down.")] = STOP_S,
    as_json: JsonOption = False,
    system: SystemOption = None,
) -> int:
    """Stop a system: robots lose power in order, every process ends. Clears what dead systems left, too.

    It is down when this says so: nothing of it runs, nothing of it lies in shared memory. Else exit code 1.

    Example: trocar down
    """
    cleared, stopped = {}, None
    for name in left_over(system):
        with progress(f"clearing {name}") as say:
            cleared[name] = stop_system(name, say, timeout, partial(keep_left_over, say=say))
    if not cleared or those_up(name for name in systems() if system in (None, name)):
        stopped = chosen_system(system)
        with progress(f"stopping {stopped}") as say:
            left = stop_system(stopped, say, timeout, partial(keep_left_over, say=say))
        if left:
            cleared[stopped] = left
    if as_json:
        emit({"stopped": stopped, "cleared": cleared})
        return 0
    for name, count in cleared.items():
        tell(f"cleared {count} segments that {name} left behind")
    if stopped:
        tell(f"system {stopped} is down")
    return 0

