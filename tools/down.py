"""`trocar down`: stop a system, and clear what dead ones have left in shared memory."""

from __future__ import annotations

from typing import Annotated

import typer

from shm.directory import systems
from tools.options import JsonOption, SystemOption
from tools.printing import emit, progress
from tools.supervising import STOP_S, stop_system
from tools.systems import chosen_system, clear, is_up, left_over


def down(
    timeout: Annotated[float, typer.Option("--timeout", min=0.1, help="Seconds to wait for its end.")] = STOP_S,
    as_json: JsonOption = False,
    system: SystemOption = None,
) -> int:
    """Stop a system: robots lose power in order, every process ends. Clears what dead systems left, too.

    Example: trocar down
    """
    cleared = {name: clear(name) for name in left_over(system)}
    stopped = None
    if not cleared or any(is_up(name) for name in systems() if system in (None, name)):
        stopped = chosen_system(system)
        with progress(f"stopping {stopped}") as say:
            stop_system(stopped, say, timeout)
        if stopped in left_over(stopped):
            cleared[stopped] = clear(stopped)
    if as_json:
        emit({"stopped": stopped, "cleared": cleared})
        return 0
    for name, count in cleared.items():
        print(f"cleared {count} segments that {name} left when it died")
    if stopped:
        print(f"system {stopped} is down")
    return 0

