"""`trocar recordings`: which there are of a system, the newest first."""

from __future__ import annotations

import os
from datetime import datetime
from pathlib import Path
from typing import Annotated, Any

import typer

from trocar.procs.recordings import names
from trocar.procs.recordings.reading import RecordingError, open_recording
from trocar.tools.analysis.places import folder_of
from trocar.tools.output.errors import Problem
from trocar.tools.output.printing import emit, note, table, tell
from trocar.tools.systems.find import chosen_or_earlier, chosen_system
from trocar.tools.verbs.options import JsonOption, SystemOption

COLUMNS = ("file", "kind", "time", "real s", "MB", "code", "why")


def recordings(
    kinds: Annotated[list[str] | None, typer.Argument(
        metavar="[KIND]…", help="Only these: fault, dump, died (dumps of crashed systems), named, box.")] = None,
    as_json: JsonOption = False,
    system: SystemOption = None,
) -> int:
    """List recordings: those of the last minutes (box), of faults with their reasons, and those that you made.

    A fault is listed with the code and the text of the error that caused it. The recorder keeps 10 files of faults
    (`recorder.faults`); it deletes those first whose fault followed from an earlier one. Times are local, those in file
    names UTC. The column "real s" is the real time between the first and the last message (`record --for` counts
    seconds of the system's time). In a fault or dump file the first message can be an event or command that is older
    than the first sample. For a system that is down, name it with --system. `logs`, `scope`, `compare`, `export` and
    `replay` read recordings.

    Example: trocar recordings fault
    """
    folder = folder_of(system if system and folder_of(system).is_dir() else chosen_system(system) if system else
                       chosen_or_earlier("recordings"))
    if unknown := [kind for kind in kinds or () if kind not in names.WORDS]:
        raise Problem(f"kind {unknown[0]}: there are {', '.join(names.WORDS)}")
    if folder.is_dir() and not os.access(folder, os.R_OK | os.X_OK):
        raise Problem(f"{folder}: may not be read")
    found, unread = described(folder)
    rows = [row for row in found if not kinds or {row["kind"], row["file"].partition("-")[0]} & {*kinds}]
    for problem in unread:
        note(problem)
    if as_json:
        emit(*rows)
        return 0
    if not rows:
        tell(f"no recordings{' of this kind' if kinds else ''} in {folder}")
        return 0
    table(str(folder), COLUMNS, (
        (row["file"], row["kind"], f"{datetime.fromtimestamp(row['time_ns'] * 1e-9):%Y-%m-%d %H:%M:%S}",
         f"{row['seconds']:.1f}", f"{row['bytes'] / 1e6:.1f}", row["code"], row["reason"])
        for row in rows), ("real s", "MB"))
    return 0


def described(folder: Path) -> tuple[list[dict[str, Any]], list[str]]:
    """Each recording: what it says of itself; and what is wrong with those that cannot be read."""
    found, unread = [], []
    for path in folder.glob("*.mcap"):
        try:
            with open_recording(path) as recording:
                facts = recording.metadata.get(names.SYSTEM, {})
                found.append({"file": path.name, "kind": facts.get("kind", ""),
                              "time_ns": names.time_in(path.name) or recording.begin_ns,
                              "begin_ns": recording.begin_ns, "end_ns": recording.end_ns,
                              "seconds": (recording.end_ns - recording.begin_ns) * 1e-9, "bytes": path.stat().st_size,
                              "code": facts.get(names.CODE, ""), "reason": facts.get("reason", ""),
                              "first": bool(facts.get(names.FIRST)), "path": str(path)})
        except RecordingError as error:  # with its path
            unread.append(str(error))
        except OSError as error:
            unread.append(f"{path}: {error.strerror or error}")
    return sorted(found, key=lambda row: row["time_ns"], reverse=True), sorted(unread)
