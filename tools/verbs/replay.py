"""`trocar replay FILE`: what was recorded once more."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import typer

from tools.errors import Misuse
from tools.options import JsonOption
from tools.printing import emit, note, progress
from tools.recorded.choosing import opened
from tools.recorded.comparing import DIFFERENT, Comparing, as_dict
from tools.recorded.differences import STAMP
from tools.replay.fresh import run_again
from tools.verbs.compare import show


def replay(
    file: Annotated[Path, typer.Argument(help="A recording.")],
    fresh: Annotated[bool, typer.Option("--fresh", help="Start what was recorded, and ask for the same.")] = False,
    into: Annotated[Path | None, typer.Option("--into", metavar="FILE.mcap", help="Where the new run is kept.")] = None,
    as_json: JsonOption = False,
) -> int:
    """Do again what was recorded.

    Example: trocar replay monday.mcap --fresh --into again.mcap
    """
    if not fresh:
        raise Misuse("say --fresh")
    again = into or file.with_name(f"{file.stem}-again.mcap")
    if again.exists():
        raise Misuse(f"{again} is there already; --into names another file")
    with opened(file) as recording, progress(f"replay {file.name}") as say:
        run = run_again(recording, again, f"replay{os.getpid()}", say)
        with opened(again) as other:
            found = Comparing(STAMP, common=True).of(recording, other, say=say)
    for text in run.notes:
        note(text)
    if as_json:
        emit({"file": str(run.file), "commands": run.commands, "simulated_s": run.simulated_s, "real_s": run.real_s,
              "notes": run.notes, "difference": as_dict(found)})
    else:
        print(f"{run.file}: {run.commands} commands in {run.simulated_s:.1f} s of simulated time, {run.real_s:.1f} s")
        show(found)
    return 1 if found.outcome == DIFFERENT else 0
